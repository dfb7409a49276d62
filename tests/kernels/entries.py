"""Doors into kernels that only other kernels call: cached like the project's own, vectorised over rows."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels._jit import core_entry
from prf.kernels.readings.laser import beam_log_likelihood
from prf.kernels.readings.laser_change import touch_beams
from prf.kernels.readings.points import Points, gain_inside, sum_points
from prf.kernels.readings.sonar import sonar_log_likelihood
from prf.kernels.readings.sonar_features import BORDER, N_LINES, Sight, see_edge, sweep
from prf.kernels.state.chain import Chain
from prf.kernels.state.crossing import is_valid
from prf.kernels.state.geometry import (
    inside_loop,
    ray_hit,
    segment_distance2,
    segment_meets_box,
    segments_meet,
    sine_of_angle,
)
from prf.kernels.state.grid import Grid, cell_at, exit_distance, walk
from prf.kernels.state.image import Image, count_edge, recolor_inside
from prf.kernels.state.sites import Sites, any_inside, occupied_change
from prf.kernels.step import choose_move, propose

parts_are_called = pytest.mark.skipif(
    not numba.config.DISABLE_JIT, reason="calls parts of kernels, which can be called from Python uncompiled alone"
)


@core_entry
def walk_segments(grid: Grid, segments: np.ndarray, cells: np.ndarray, n_cells: np.ndarray) -> None:
    """Write the cells of each segment (n, 4) into a row of `cells`, their number into `n_cells`."""
    for k in range(segments.shape[0]):
        n_cells[k] = walk(grid, segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3], cells[k])


@core_entry
def cells_at(grid: Grid, xy: np.ndarray, cells: np.ndarray) -> None:
    for k in range(xy.shape[0]):
        cells[k] = cell_at(grid, xy[k, 0], xy[k, 1])


@core_entry
def exits(grid: Grid, cell: int, rays: np.ndarray, distance: np.ndarray) -> None:
    """Rows of `rays`: origin and direction."""
    for k in range(rays.shape[0]):
        distance[k] = exit_distance(grid, cell, rays[k, 0], rays[k, 1], rays[k, 2], rays[k, 3])


@core_entry
def log_likelihoods(model: np.ndarray, reading: np.ndarray, distance: np.ndarray, found: np.ndarray) -> None:
    for k in range(reading.size):
        found[k] = beam_log_likelihood(model, model[c.WEIGHT], reading[k], distance[k])


@core_entry
def hit_table(rays: np.ndarray, segments: np.ndarray, distance: np.ndarray) -> None:
    """Distance (n_rays, n_segments) along every ray to every segment."""
    for i in range(rays.shape[0]):
        for k in range(segments.shape[0]):
            distance[i, k] = ray_hit(rays[i], segments[k])


@core_entry
def meet_table(one: np.ndarray, two: np.ndarray, met: np.ndarray) -> None:
    for k in range(one.shape[0]):
        p = one[k]
        q = two[k]
        met[k] = segments_meet(p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3])


@core_entry
def distance_table(one: np.ndarray, two: np.ndarray, found: np.ndarray) -> None:
    """Squared distances between the segments of two arrays, row by row."""
    for k in range(one.shape[0]):
        p = one[k]
        q = two[k]
        found[k] = segment_distance2(p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3])


@core_entry
def box_table(segments: np.ndarray, boxes: np.ndarray, met: np.ndarray) -> None:
    for k in range(segments.shape[0]):
        p = segments[k]
        q = boxes[k]
        met[k] = segment_meets_box(p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3])


@core_entry
def inside_table(xy: np.ndarray, loop: np.ndarray, found: np.ndarray) -> None:
    for k in range(xy.shape[0]):
        found[k] = inside_loop(xy[k, 0], xy[k, 1], loop, loop.shape[0])


@core_entry
def sines(corners: np.ndarray, found: np.ndarray) -> None:
    """Rows of `corners`: v, a, b."""
    for k in range(corners.shape[0]):
        p = corners[k]
        found[k] = sine_of_angle(p[0], p[1], p[2], p[3], p[4], p[5])


@core_entry
def encloses_site(sites: Sites, loop: np.ndarray) -> bool:
    return any_inside(sites, loop, loop.shape[0])


@core_entry
def turn_sites(sites: Sites, loop: np.ndarray, turns: bool) -> int:
    return occupied_change(sites, loop, loop.shape[0], turns)


@core_entry
def gain_of(points: Points, loop: np.ndarray, crossings: np.ndarray, turns: bool) -> float:
    return gain_inside(points, loop, loop.shape[0], crossings, turns)


@core_entry
def sum_of(points: Points) -> float:
    return sum_points(points)


@core_entry
def recolor(image: Image, loop: np.ndarray, step: int) -> None:
    recolor_inside(image, loop, loop.shape[0], step)


@core_entry
def change_edge(image: Image, xy: np.ndarray, change: int, step: int) -> None:
    count_edge(image, xy, change, step)


@core_entry
def see_all(sight: Sight, segments: np.ndarray, corners: np.ndarray, pose: np.ndarray, reach: float) -> float:
    """Features of all `segments` (n, 4), whose ends are the vertices `corners` (n, 2), left in `sight`; the extent."""
    sight.counts[N_LINES] = 0
    for k in range(segments.shape[0]):
        see_edge(sight, pose, reach, segments[k], corners[k, 0], corners[k, 1])
    return sweep(sight, pose[BORDER], reach)


@core_entry
def sonar_table(model: np.ndarray, sight: Sight, readings: np.ndarray, reach: float, found: np.ndarray) -> None:
    """Log likelihoods of readings given the features in `sight`, which are all within `reach`."""
    for k in range(readings.size):
        found[k] = sonar_log_likelihood(model, sight, readings[k], reach)


@core_entry
def decide_early(chain: Chain, rng: np.random.Generator, n: int, counts: np.ndarray) -> None:
    """Decide on `n` valid proposals with thresholds near their change, early and after all beams; nothing is applied.

    ``counts``: decisions that differ, those that the bounds alone made, that a part of the beams made, acceptances.
    """
    k = 0
    while k < n:
        legal, _, _ = propose(chain, choose_move(chain.move_probabilities, rng), rng)
        if not legal or not is_valid(chain.graph, chain.edge_index, chain.proposal):
            continue
        k += 1
        _, whole = touch_beams(chain.graph, chain.edge_index, chain.beams, chain.proposal, 0, -np.inf)
        n_whole = chain.beams.n_touched[0]
        needed = whole + rng.standard_exponential() * (
            1.0 if rng.random() < 0.3 else 30.0 if rng.random() < 0.5 else -1.0
        )
        may_pass, part = touch_beams(chain.graph, chain.edge_index, chain.beams, chain.proposal, 0, needed)
        if (may_pass and part > needed) != (whole > needed):
            counts[0] += 1
        if not may_pass and part == 0.0:
            counts[1] += 1
        if not may_pass and part != 0.0:
            counts[2] += 1
        if may_pass and part > needed and n_whole == chain.beams.n_touched[0] and abs(part - whole) < 1e-9:
            counts[3] += 1
