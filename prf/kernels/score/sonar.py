"""Sonar readings against finished maps: features in many cones, densities, and first hits among the cells of a grid."""

import math
from typing import NamedTuple

from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.cones import READING, cells_of_cone
from prf.kernels.readings.laser import CDF_SATURATION
from prf.kernels.readings.sonar import (
    SONAR_MAX,
    SONAR_NOISE,
    SONAR_NOISE_RELATIVE,
    sonar_log_likelihood,
    stray_density,
)
from prf.kernels.readings.sonar_features import (
    BORDER,
    N_FEATURE,
    N_FEATURES,
    N_LINES,
    POSE_COS,
    POSE_SIN,
    POSE_X,
    POSE_Y,
    Sight,
    see_edge,
    sweep,
)
from prf.kernels.score.laser import blurred_bin, blurred_tail
from prf.kernels.state.cell_lists import SegmentLists
from prf.kernels.state.grid import Grid

UNKNOWN = 0.5
"""Probability of a cell outside the grid."""


class Scene(NamedTuple):
    """One finished map as many cones look at it: its edges and scratch for one cone."""

    edges: SegmentLists
    corners: Array  # (n, 2) i4 vertices at the ends, NONE where the wall meets the border of the window
    marks: Array  # (n,) i8 the last cone that met an edge
    mark: Array  # (1,) i8 the cone in work
    cells: Array  # i4 scratch: the cells of one cone
    near: Array  # f8 scratch: where it enters them
    sight: Sight


@core
def look(scene: Scene, pose: Array, reach: float) -> None:
    """Find the features in one cone; they are left in the scratch."""
    scene.mark[0] += 1
    scene.sight.counts[N_LINES] = 0
    n = cells_of_cone(scene.edges.grid, pose, reach, scene.cells, scene.near)
    for k in range(n):
        cell = scene.cells[k]
        for place in range(scene.edges.start[cell], scene.edges.start[cell + 1]):
            edge = scene.edges.listed[place]
            if scene.marks[edge] != scene.mark[0]:
                scene.marks[edge] = scene.mark[0]
                a, b = scene.corners[edge, 0], scene.corners[edge, 1]
                see_edge(scene.sight, pose, reach, scene.edges.segments[edge], a, b)
    sweep(scene.sight, pose[BORDER], reach)


@core_entry
def add_sonar_densities(scene: Scene, model: Array, pose: Array, occupied: Array, total: Array) -> None:
    """Add the density (no return: the probability) of each reading to ``total`` (n,).

    An occupied sensor leaves the density of outliers with nothing in view.
    """
    for cone in range(pose.shape[0]):
        reading = pose[cone, READING]
        if occupied[cone]:
            total[cone] += stray_density(model, reading, model[SONAR_MAX])
        else:
            look(scene, pose[cone], model[SONAR_MAX])
            total[cone] += math.exp(sonar_log_likelihood(model, scene.sight, reading, model[SONAR_MAX]))


@core_entry
def list_features(scene: Scene, reach: float, pose: Array, start: Array, feature: Array) -> int:
    """Write the features of all cones, nearest first, into the rows of ``feature`` while there is room.

    ``start`` (n + 1,) takes where those of each cone begin. Returns how many rows all of them need.
    """
    n = 0
    for cone in range(pose.shape[0]):
        start[cone] = n
        look(scene, pose[cone], reach)
        for i in range(scene.sight.counts[N_FEATURES]):
            if n < feature.shape[0]:
                for column in range(N_FEATURE):
                    feature[n, column] = scene.sight.feature[scene.sight.rank[i], column]
            n += 1
    start[pose.shape[0]] = n
    return n


@core
def arc_probability(grid: Grid, occupancy: Array, pose: Array, radius: float) -> float:
    """Probability that some cell on the arc of a cone is occupied: 1 - prod (1 - p) over the cells that it passes.

    The arc is followed in steps of at most half a cell; outside the grid lie cells of which nothing is known.
    """
    half = math.atan(pose[BORDER])
    n = max(1, math.ceil(4.0 * half * radius / grid.cell))
    free = 1.0
    last_column = math.nan
    last_row = math.nan
    for i in range(n):
        turn = half * ((2.0 * i + 1.0) / n - 1.0)
        along = radius * math.cos(turn)
        across = radius * math.sin(turn)
        column = math.floor((pose[POSE_X] + along * pose[POSE_COS] - across * pose[POSE_SIN] - grid.x0) / grid.cell)
        row = math.floor((pose[POSE_Y] + along * pose[POSE_SIN] + across * pose[POSE_COS] - grid.y0) / grid.cell)
        if column == last_column and row == last_row:
            continue
        last_column = column
        last_row = row
        inside = 0 <= column < grid.nx and 0 <= row < grid.ny
        free *= 1.0 - (occupancy[int(row), int(column)] if inside else UNKNOWN)
    return 1.0 - free


@core
def grid_cone(grid: Grid, occupancy: Array, model: Array, stray: float, width: float, pose: Array) -> float:
    """Density of a reading (no return: its probability), given by the first hit among the cells of a cone.

    Bins of `width` take the probability of the arc at their middle; the weight of bin k is p_k prod_{j < k} (1 - p_j),
    and the reading spreads round an obstacle anywhere in its bin. A share `stray` of the readings, and those that meet
    no cell, are as in the sonar's own model.
    """
    maximum = model[SONAR_MAX]
    reading = pose[READING]
    density = 0.0
    unmet = 1.0
    for k in range(math.ceil(maximum / width)):
        near = k * width
        far = min(near + width, maximum)
        middle = 0.5 * (near + far)
        s = max(model[SONAR_NOISE], model[SONAR_NOISE_RELATIVE] * middle)
        p = arc_probability(grid, occupancy, pose, middle)
        if reading >= maximum:
            density += p * unmet * blurred_tail(maximum, near, far, s)
        elif near - CDF_SATURATION * s < reading < far + CDF_SATURATION * s:
            density += p * unmet * blurred_bin(reading, near, far, s)
        unmet *= 1.0 - p
    return (1.0 - stray) * density + ((1.0 - stray) * unmet + stray) * stray_density(model, reading, model[SONAR_MAX])


@core_entry
def grid_cones(
    grid: Grid, occupancy: Array, model: Array, stray: float, width: float, pose: Array, density: Array
) -> None:
    """Set ``density`` (n,) of every reading: see :func:`grid_cone`."""
    for cone in range(pose.shape[0]):
        density[cone] = grid_cone(grid, occupancy, model, stray, width, pose[cone])
