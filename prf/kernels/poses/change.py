"""What a proposal of new poses changes: colours where sensors are, beams and cones as the new poses have them."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.poses.state import LOG_CHANGE, Poses, first_edge, place_cone, place_ray
from prf.kernels.readings.beams import Beams
from prf.kernels.readings.cones import (
    CONE_LOG_LIKELIHOOD,
    EXTENT,
    MAX_DISTANCE,
    N_POSE,
    READING,
    SLACK,
    Cones,
    cells_of_cone,
    corner_at,
)
from prf.kernels.readings.laser import beam_log_likelihood
from prf.kernels.readings.sonar import SONAR_MAX, sonar_log_likelihood
from prf.kernels.readings.sonar_features import BORDER, N_LINES, see_edge, sweep
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.free_space import is_white
from prf.kernels.state.geometry import segment_meets_box
from prf.kernels.state.graph import Graph, ends_of

BOX = 40
"""Entry of ``Poses.work``: the first of x_min, y_min, x_max, y_max of all edges that a proposal displaces."""
BEYOND = 1.0
"""Metres beyond a reading in which its impact is searched first."""


@core
def sites_are_white(graph: Graph, index: EdgeIndex, poses: Poses, i: int, anchor_black: int) -> bool:
    """Whether the sensors of the new pose i are inside the window and in white."""
    pose = poses.new_pose[i]
    window = graph.window
    cosine = math.cos(pose[2])
    sine = math.sin(pose[2])
    for at in range(poses.site_start[i], poses.site_start[i + 1]):
        x = pose[0] + cosine * poses.site_local[at, 0] - sine * poses.site_local[at, 1]
        y = pose[1] + sine * poses.site_local[at, 0] + cosine * poses.site_local[at, 1]
        if not (window[0] < x < window[2] and window[1] < y < window[3]):
            return False
        if not is_white(graph, index, anchor_black, x, y, c.NONE):
            return False
    return True


@core
def most_gained(beams: Beams, poses: Poses, low: int, high: int) -> float:
    """The most that the beams of some poses can gain, nats; censored ones are bounded by probability 1."""
    most = 0.0
    for at in range(poses.beam_start[low], poses.beam_start[high + 1]):
        beam = poses.beam_of[at]
        best = beams.best[beam] if poses.returned[at] != 0 else 0.0
        most += best - beams.ray[beam, c.BEAM_LOG_LIKELIHOOD]
    return most


@core
def stays(poses: Poses, i: int) -> bool:
    """Whether the new pose i is the present one."""
    old, new = poses.pose[i], poses.new_pose[i]
    return old[0] == new[0] and old[1] == new[1] and old[2] == new[2]


@core
def is_clear(beams: Beams, poses: Poses, beam: int) -> bool:
    """Whether nothing that is displaced lies on the way of a beam up to its impact."""
    ray, box = beams.ray[beam], poses.work[BOX : BOX + 4]
    length = min(ray[c.DISTANCE], ray[c.MAX_DISTANCE])
    x, y = ray[c.ORIGIN_X] + length * ray[c.DIRECTION_X], ray[c.ORIGIN_Y] + length * ray[c.DIRECTION_Y]
    return not segment_meets_box(ray[c.ORIGIN_X], ray[c.ORIGIN_Y], x, y, box[0], box[1], box[2], box[3])


@core
def keep_beam(beams: Beams, poses: Poses, at: int) -> None:
    """Enter the beam listed at a place as it is."""
    beam = poses.beam_of[at]
    poses.new_edge[at] = beams.impact_edge[beam]
    for k in range(c.N_RAY):
        poses.new_ray[at, k] = beams.ray[beam, k]


@core
def beam_change(graph: Graph, index: EdgeIndex, beams: Beams, poses: Poses, i: int, at: int) -> float:
    """Trace the beam listed at a place from the new pose i; return the change of its log likelihood."""
    beam = poses.beam_of[at]
    old = beams.ray[beam]
    ray = poses.new_ray[at]
    ray[c.RANGE] = old[c.RANGE]
    place_ray(graph.window, beams.model, poses.new_pose[i], poses.beam_local[at], poses.returned[at], ray)
    near = old[c.RANGE] if poses.returned[at] != 0 else old[c.DISTANCE]
    edge, distance = first_edge(graph, index, ray, near + BEYOND)
    if edge == c.NONE:
        distance = beams.beyond[beam]
    poses.new_edge[at] = edge
    ray[c.DISTANCE] = distance
    ray[c.BEAM_LOG_LIKELIHOOD] = beam_log_likelihood(beams.model, beams.weight[beam], ray[c.RANGE], distance)
    return ray[c.BEAM_LOG_LIKELIHOOD] - old[c.BEAM_LOG_LIKELIHOOD]


@core
def cone_change(graph: Graph, index: EdgeIndex, cones: Cones, poses: Poses, i: int, at: int) -> float:
    """Sense with the cone listed at a place from the new pose i; return the change of its log likelihood."""
    pose = poses.new_cone[at]
    place_cone(poses, graph.window, cones.model[SONAR_MAX], poses.new_pose[i], at, pose)
    reach = pose[MAX_DISTANCE]
    index.mark[0] += 1
    cones.sight.counts[N_LINES] = 0
    for k in range(cells_of_cone(index.grid, pose, reach, poses.cells, poses.near)):
        cell = poses.cells[k]
        for place in range(index.cell_count[cell]):
            edge = index.cell_edges[cell, place]
            if index.marks[edge] != index.mark[0]:
                index.marks[edge] = index.mark[0]
                a, b = ends_of(graph, edge)
                see_edge(cones.sight, pose, reach, graph.edge_xy[edge], corner_at(graph, a), corner_at(graph, b))
    pose[EXTENT] = min(reach, SLACK * sweep(cones.sight, pose[BORDER], reach))
    pose[CONE_LOG_LIKELIHOOD] = sonar_log_likelihood(cones.model, cones.sight, pose[READING], reach)
    return pose[CONE_LOG_LIKELIHOOD] - cones.pose[poses.cone_of[at], CONE_LOG_LIKELIHOOD]


@core
def readings_change(
    graph: Graph, index: EdgeIndex, beams: Beams, cones: Cones, poses: Poses, low: int, high: int, needed: float
) -> bool:
    """Return whether the readings of the new poses `low` to `high` gain more than `needed`; `sums` take what they gain.

    It stops where the beams left cannot make up for what is missing. No bound is known on what cones gain. Beams of
    poses that stay are traced anew only where they meet the box (``BOX``) of what is displaced.
    """
    change = 0.0
    has_cones = poses.cone_start[high + 1] > poses.cone_start[low]
    spare = math.inf if has_cones else most_gained(beams, poses, low, high)
    for i in range(low, high + 1):
        stays_here = stays(poses, i)
        for at in range(poses.beam_start[i], poses.beam_start[i + 1]):
            beam = poses.beam_of[at]
            if stays_here and is_clear(beams, poses, beam):
                keep_beam(beams, poses, at)
            else:
                change += beam_change(graph, index, beams, poses, i, at)
            if not has_cones:
                best = beams.best[beam] if poses.returned[at] != 0 else 0.0
                spare -= best - beams.ray[beam, c.BEAM_LOG_LIKELIHOOD]
                if change + spare < needed:
                    return False
        for at in range(poses.cone_start[i], poses.cone_start[i + 1]):
            change += cone_change(graph, index, cones, poses, i, at)
    poses.sums[LOG_CHANGE] = change
    return needed < change


@core
def keep_poses(beams: Beams, cones: Cones, poses: Poses, low: int, high: int) -> None:
    """Make the new poses `low` to `high`, and their readings, the present ones; no list is touched."""
    for i in range(low, high + 1):
        for k in range(3):
            poses.pose[i, k] = poses.new_pose[i, k]
        for at in range(poses.beam_start[i], poses.beam_start[i + 1]):
            beam = poses.beam_of[at]
            beams.impact_edge[beam] = poses.new_edge[at]
            for k in range(c.N_RAY):
                beams.ray[beam, k] = poses.new_ray[at, k]
        for at in range(poses.cone_start[i], poses.cone_start[i + 1]):
            for k in range(N_POSE):
                cones.pose[poses.cone_of[at], k] = poses.new_cone[at, k]
