"""Map and poses displaced together by a field: walls go with the scans that see them, where either alone cannot move.

The field moves every interior vertex and every pose but one that is held (:mod:`prf.kernels.poses.field`).
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.poses.change import BOX, keep_poses, readings_change, sites_are_white
from prf.kernels.poses.field import LOG_SCALED, PLACE, TURNED, displace, draw_field
from prf.kernels.poses.moves import first_free
from prf.kernels.poses.state import LOG_CHANGE, LOG_POSE_PRIOR, Poses, log_pose_prior
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex, index_edge
from prf.kernels.state.free_space import black_area, is_white
from prf.kernels.state.geometry import inside_loop, segments_meet
from prf.kernels.state.graph import Graph, other_end, outer_edge, vertex_sine_now
from prf.kernels.state.grid import walk
from prf.kernels.state.guards import GUARD_WAY, KIND, Guards, meets_any
from prf.kernels.walls.law import log_map_prior
from prf.kernels.walls.shape import wall_of

SLACK = 1e-6
"""Metres by which a box is enlarged: more than impacts are rounded by."""


@core
def warp_walls(graph: Graph, trial: Graph, poses: Poses) -> tuple[bool, float]:
    """Displace the ends of the walls, whose thickness stays; as :func:`warp_vertices`.

    The density of a wall is over length and direction: two ends are dx dy dx dy = length d(length) d(direction) dx dy.
    """
    total, window, work = 0.0, graph.window, poses.work
    for i in range(graph.counts[c.WALLS]):
        side = graph.members[c.WALLS, i]
        ax, ay, bx, by, thickness = wall_of(graph, side)
        before = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        if not displace(poses, ax, ay):
            return False, 0.0
        ax, ay, change = work[PLACE], work[PLACE + 1], work[LOG_SCALED]
        if not displace(poses, bx, by):
            return False, 0.0
        bx, by = work[PLACE], work[PLACE + 1]
        length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        if not length > thickness:
            return False, 0.0
        total += change + work[LOG_SCALED] + math.log(before / length)
        half_x, half_y = 0.5 * thickness * (by - ay) / length, -0.5 * thickness * (bx - ax) / length
        edge, v = side, graph.edge_vertices[side, 0]
        for k in range(4):
            sign = 1.0 if k < 2 else -1.0
            x = (ax if k == 0 or k == 3 else bx) + sign * half_x
            y = (ay if k == 0 or k == 3 else by) + sign * half_y
            if not (window[0] < x < window[2] and window[1] < y < window[3]):
                return False, 0.0
            trial.vertex_xy[v, 0] = x
            trial.vertex_xy[v, 1] = y
            v = other_end(graph, edge, v)
            edge = outer_edge(graph, v, edge)
    return True, total


@core
def warp_vertices(graph: Graph, trial: Graph, poses: Poses) -> tuple[bool, float]:
    """Displace the interior vertices; return whether all stay inside, and the log of the Jacobian."""
    total, window, work = 0.0, graph.window, poses.work
    if graph.counts[c.ANCHOR_BLACK] == c.NONE:
        return warp_walls(graph, trial, poses)
    for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES):
        for i in range(graph.counts[kind]):
            v = graph.members[kind, i]
            x, y = graph.vertex_xy[v, 0], graph.vertex_xy[v, 1]
            if kind == c.INTERIOR_VERTICES:
                if not displace(poses, x, y):
                    return False, 0.0
                x, y = work[PLACE], work[PLACE + 1]
                total += work[LOG_SCALED]
                if not (window[0] < x < window[2] and window[1] < y < window[3]):
                    return False, 0.0
            trial.vertex_xy[v, 0] = x
            trial.vertex_xy[v, 1] = y
    return True, total


@core
def warp_poses(poses: Poses) -> tuple[bool, float]:
    """Displace all poses but a held one; return whether that was possible, and the log of the Jacobian."""
    total, work = 0.0, poses.work
    for k in range(3):
        poses.new_pose[0, k] = poses.pose[0, k]
    for i in range(first_free(poses), poses.pose.shape[0]):
        if not displace(poses, poses.pose[i, 0], poses.pose[i, 1]):
            return False, 0.0
        poses.new_pose[i, 0], poses.new_pose[i, 1] = work[PLACE], work[PLACE + 1]
        poses.new_pose[i, 2] = poses.pose[i, 2] + work[TURNED]
        total += work[LOG_SCALED]
    return True, total


@core
def meets_listed(trial: Graph, index: EdgeIndex, edge: int, n_cells: int) -> bool:
    """Whether an edge, whose cells are in `path`, meets one listed there with which it has no vertex in common."""
    p = trial.edge_xy[edge]
    a, b = trial.edge_vertices[edge, 0], trial.edge_vertices[edge, 1]
    for k in range(n_cells):
        cell = index.path[k]
        for place in range(index.cell_count[cell]):
            other = index.cell_edges[cell, place]
            q = trial.edge_xy[other]
            u, v = trial.edge_vertices[other, 0], trial.edge_vertices[other, 1]
            is_apart = u != a and u != b and v != a and v != b
            if is_apart and segments_meet(p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]):
                return True
    return False


@core
def place_edges(trial: Graph, index: EdgeIndex, guards: Guards) -> bool:
    """Write and index the edges between displaced vertices; False where two meet, one is barred, or room is short."""
    index.cell_count[:] = 0
    for i in range(trial.counts[c.EDGES]):
        edge = trial.members[c.EDGES, i]
        xy = trial.edge_xy[edge]
        for end in range(2):
            v = trial.edge_vertices[edge, end]
            xy[2 * end] = trial.vertex_xy[v, 0]
            xy[2 * end + 1] = trial.vertex_xy[v, 1]
        trial.edge_length[edge] = math.sqrt((xy[2] - xy[0]) ** 2 + (xy[3] - xy[1]) ** 2)
        n = walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path)
        if trial.counts[c.ANCHOR_BLACK] != c.NONE and meets_listed(trial, index, edge, n):
            return False
        if guards.lists.shape[0] > 1 and meets_any(guards, xy, index.path, n, True):
            return False
        if index_edge(index, edge, xy):
            return False
    return True


@core
def find_box(graph: Graph, trial: Graph, box: Array) -> None:
    """Write the box of all edges that are displaced, before and after, a little enlarged."""
    box[0], box[1], box[2], box[3] = math.inf, math.inf, -math.inf, -math.inf
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        old, new = graph.edge_xy[edge], trial.edge_xy[edge]
        if old[0] == new[0] and old[1] == new[1] and old[2] == new[2] and old[3] == new[3]:
            continue
        for k in range(2):
            box[k] = min(box[k], min(min(old[k], old[2 + k]), min(new[k], new[2 + k])) - SLACK)
            box[2 + k] = max(box[2 + k], max(max(old[k], old[2 + k]), max(new[k], new[2 + k])) + SLACK)


@core
def place_angles(trial: Graph) -> None:
    """Write the sines of the angles at displaced vertices."""
    for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES):
        for i in range(trial.counts[kind]):
            v = trial.members[kind, i]
            trial.vertex_sine[v] = vertex_sine_now(trial, v)


@core
def anchor_after(graph: Graph, trial: Graph, loop: Array) -> int:
    """Colour of the window's centre after edges swept over it or not."""
    window = graph.window
    x, y = 0.5 * (window[0] + window[2]), 0.5 * (window[1] + window[3])
    black = graph.counts[c.ANCHOR_BLACK]
    if black == c.NONE:
        return black
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        old, new = graph.edge_xy[edge], trial.edge_xy[edge]
        for k in range(2):
            loop[0, k], loop[1, k], loop[2, k], loop[3, k] = old[k], old[2 + k], new[2 + k], new[k]
        if inside_loop(x, y, loop, 4):
            black = 1 - black
    return black


@core
def way_is_white(trial: Graph, index: EdgeIndex, guards: Guards, anchor_black: int) -> bool:
    """Whether no wall was carried over the way that was driven, to which no edge is near."""
    for guard in range(guards.shape.shape[0]):
        shape = guards.shape[guard]
        if shape[KIND] == GUARD_WAY and not is_white(trial, index, anchor_black, shape[1], shape[2], c.NONE):
            return False
    return True


@core
def keep_map(graph: Graph, index: EdgeIndex, trial: Graph, trial_index: EdgeIndex, anchor_black: int) -> None:
    """Make the displaced map the present one."""
    for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES):
        for i in range(graph.counts[kind]):
            v = graph.members[kind, i]
            graph.vertex_sine[v] = trial.vertex_sine[v]
            for k in range(2):
                graph.vertex_xy[v, k] = trial.vertex_xy[v, k]
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        graph.edge_length[edge] = trial.edge_length[edge]
        for k in range(4):
            graph.edge_xy[edge, k] = trial.edge_xy[edge, k]
    for cell in range(index.cell_count.shape[0]):
        index.cell_count[cell] = trial_index.cell_count[cell]
        for place in range(index.cell_count[cell]):
            index.cell_edges[cell, place] = trial_index.cell_edges[cell, place]
    graph.counts[c.ANCHOR_BLACK] = anchor_black


@core
def warp(chain: Chain, trial: Graph, trial_index: EdgeIndex, poses: Poses, rng: Rng) -> bool:
    """Displace map and poses by a random field.

    `trial` has arrays of its own for places, lengths and angles, `trial_index` for its lists; the rest they share.
    Not with values at points, whose colours it would change.
    """
    graph = chain.graph
    if chain.points.column.shape[1] > 0:
        return False
    last = poses.pose.shape[0] - 1
    if not draw_field(graph.window, poses, rng):
        return False
    is_inside, log_vertices = warp_vertices(graph, trial, poses)
    if not is_inside:
        return False
    is_found, log_poses = warp_poses(poses)
    if not is_found or not place_edges(trial, trial_index, chain.guards):
        return False
    anchor_black = anchor_after(graph, trial, chain.proposal.loop)
    for i in range(last + 1):
        if not sites_are_white(trial, trial_index, poses, i, anchor_black):
            return False
    if not way_is_white(trial, trial_index, chain.guards, anchor_black):
        return False
    place_angles(trial)
    map_prior = log_map_prior(trial, chain.density, chain.lines)
    if chain.density[c.FREE_SPACE] > 0.0:
        map_prior -= chain.density[c.FREE_SPACE] * black_area(graph, chain.edge_index, trial)
    pose_prior = log_pose_prior(poses, poses.new_pose, 0, last)
    change = map_prior - graph.sums[c.LOG_PRIOR] + pose_prior - poses.sums[LOG_POSE_PRIOR]
    needed = math.log(1.0 - rng.random()) - change - log_vertices - log_poses
    find_box(graph, trial, poses.work[BOX : BOX + 4])
    if not readings_change(trial, trial_index, chain.beams, chain.cones, poses, 0, last, needed):
        return False
    keep_poses(chain.beams, chain.cones, poses, 0, last)
    keep_map(graph, chain.edge_index, trial, trial_index, anchor_black)
    graph.sums[c.LOG_PRIOR] = map_prior
    graph.sums[c.LOG_LIKELIHOOD] += poses.sums[LOG_CHANGE]
    poses.sums[LOG_POSE_PRIOR] = pose_prior
    return True
