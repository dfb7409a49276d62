"""Walls of a world as what sound meets: joined where they run straight on, with corners, edges and rough patches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from prf.kernels.echo_scene import NO_WALL, EchoScene
from prf.kernels.grid import Grid, make_grid, most_cells
from prf.kernels.segment_lists import segments_by_cell
from prf.shell.errors import InputError
from prf.simulate.sonar_physics import SonarPhysics

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SAME_PLACE = 1e-6
"""Metres. Ends of walls this close to each other are one vertex."""
STRAIGHT = 1e-6
"""Radians. Walls that turn by less at a joint are one wall: a straight joint scatters nothing."""
SHORTEST = 1e-5
"""Metres. Shorter walls are nothing."""
RIGHT_ANGLE = math.radians(10.0)
"""Corners within this of a right angle send sound back whence it came; sound finds its own way out of others."""
PATCH = 0.05
"""Metres. Longest patch of a rough wall, shorter than a pulse."""
CELL = 1.0
"""Metres. Side of the cells in which walls are looked up: one or two walls each indoors."""


def join_walls(walls: Floats) -> Floats:
    """Return the walls with straight joints taken out, in an order of their own.

    The result does not depend on the order of the walls, nor on where straight ones were cut.

    Parameters
    ----------
    walls : (n, 4) array
        Ends x1 y1 x2 y2 in metres, free space on the left.

    Raises
    ------
    InputError
        If the array has another shape or values that are no numbers.
    """
    walls = np.asarray(walls, dtype=np.float64)
    if walls.ndim != 2 or walls.shape[1] != 4 or not np.isfinite(walls).all():
        raise InputError(f"walls: expected finite numbers of shape (n, 4), got {walls.shape}")
    walls = walls[np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > SHORTEST]
    if not len(walls):
        return walls
    start, end = _vertices(walls)
    into, out = _only_wall(end, start, len(walls)), _only_wall(start, end, len(walls))
    heading = np.arctan2(walls[:, 3] - walls[:, 1], walls[:, 2] - walls[:, 0])
    follows = np.full(len(walls), NO_WALL)
    for vertex in np.flatnonzero((into != NO_WALL) & (out != NO_WALL)):
        if abs(_turn(heading[into[vertex]], heading[out[vertex]])) < STRAIGHT:
            follows[into[vertex]] = out[vertex]
    joined = _chains(walls, follows)
    return joined[np.lexsort(joined.T[::-1])]


def _vertices(walls: Floats) -> tuple[Integers, Integers]:
    """Return the vertex numbers of the first and second ends; ends within `SAME_PLACE` share theirs."""
    ends = np.concatenate([walls[:, :2], walls[:, 2:]])
    pairs = cKDTree(ends).query_pairs(SAME_PLACE, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(ends), len(ends)))
    vertex = connected_components(links, directed=False)[1].astype(np.int64)
    return vertex[: len(walls)], vertex[len(walls) :]


def _only_wall(at: Integers, other: Integers, n_walls: int) -> Integers:
    """Return for each vertex the one wall with `at` there, NO_WALL if there are more or walls that only touch it."""
    n_vertices = int(max(at.max(), other.max())) + 1
    only = np.full(n_vertices, NO_WALL)
    only[at] = np.arange(n_walls)
    only[np.bincount(at, minlength=n_vertices) != 1] = NO_WALL
    return only


def _turn(before: float, after: float) -> float:
    """Angle from one heading to another, in (-pi, pi]."""
    return math.pi - (math.pi - (after - before)) % (2.0 * math.pi)


def _chains(walls: Floats, follows: Integers) -> Floats:
    """Return one wall for every run of walls that follow one another straight on."""
    led = np.zeros(len(walls), dtype=bool)
    led[follows[follows != NO_WALL]] = True
    joined = []
    for first in np.flatnonzero(~led):
        last = first
        while follows[last] != NO_WALL:
            last = follows[last]
        joined.append((*walls[first, :2], *walls[last, 2:]))
    return np.array(joined)


def _corners(walls: Floats, heading: Floats) -> tuple[Floats, Integers, Integers, Floats]:
    """Return the places at which one wall ends and one starts, these two walls, and the turn between them."""
    if not len(walls):
        return np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    start, end = _vertices(walls)
    into, out = _only_wall(end, start, len(walls)), _only_wall(start, end, len(walls))
    vertex = np.flatnonzero((into != NO_WALL) & (out != NO_WALL))
    before, after = into[vertex], out[vertex]
    order = np.argsort(before)
    before, after = before[order], after[order]
    turn = np.array([_turn(heading[i], heading[k]) for i, k in zip(before, after, strict=True)])
    return walls[before, 2:].copy(), before, after, turn


def _patches(walls: Floats, rough: NDArray[np.bool_]) -> tuple[Floats, Integers, Floats]:
    """Return middles, walls and widths of equal patches of the rough walls, none wider than `PATCH`."""
    middle, wall, width = [np.zeros((0, 2))], [np.zeros(0, np.int64)], [np.zeros(0)]
    for w in np.flatnonzero(rough):
        across = walls[w, 2:] - walls[w, :2]
        n = math.ceil(float(np.hypot(*across)) / PATCH)
        middle.append(walls[w, :2] + (np.arange(n)[:, None] + 0.5) / n * across)
        wall.append(np.full(n, w))
        width.append(np.full(n, float(np.hypot(*across)) / n))
    return np.concatenate(middle), np.concatenate(wall), np.concatenate(width)


def _cells(walls: Floats, places: Floats) -> tuple[Grid, Integers, NDArray[np.int32], NDArray[np.int32]]:
    """Return a grid over walls and places, where the walls of each of its cells begin, these walls, and scratch."""
    ends = np.concatenate([walls[:, :2], walls[:, 2:], places])
    low, high = ends.min(axis=0) - CELL, ends.max(axis=0) + CELL
    grid = make_grid(low[0], low[1], high[0], high[1], CELL)
    path = np.zeros(most_cells(grid), np.int32)
    return grid, *segments_by_cell(grid, walls, path), path


def make_echo_scene(walls: Floats, places: Floats, physics: SonarPhysics, rng: np.random.Generator) -> EchoScene:
    """Return the reflectors of a world as the kernels take them.

    Parameters
    ----------
    walls : (n, 4) array
        As for :func:`join_walls`.
    places : (m, 2) array
        Corners of the area in which the transducers will be, metres.
    physics : SonarPhysics
    rng : Generator
        Decides which walls are rough, and the phases of their patches.
    """
    walls = join_walls(walls)
    across = walls[:, 2:] - walls[:, :2]
    length = np.hypot(across[:, 0], across[:, 1])
    heading = np.arctan2(across[:, 1], across[:, 0])
    rough = rng.random(len(walls)) < (physics.rough_share if physics.rough else 0.0)
    corner, before, after, turn = _corners(walls, heading)
    square = np.abs(turn - 0.5 * np.pi) < RIGHT_ANGLE
    partner = np.full((len(walls), 2), NO_WALL)
    partner[before[square], 1] = after[square]
    partner[after[square], 0] = before[square]
    counts = square | (turn < 0.0)
    patch, patch_wall, width = _patches(walls, rough)
    grid, cell_start, cell_wall, cells = _cells(walls, places)
    return EchoScene(
        wall=walls,
        along=across / length[:, None],
        length=length,
        mirror=np.where(rough, physics.rough_mirror, physics.mirror),
        partner=partner,
        corner=corner[counts],
        before=before[counts],
        after=after[counts],
        turn=turn[counts],
        patch=patch,
        patch_wall=patch_wall,
        patch_gain=physics.patch_gain * np.sqrt(width),
        patch_phase=rng.uniform(0.0, 2.0 * np.pi, len(patch)),
        grid=grid,
        cell_start=cell_start,
        cell_wall=cell_wall,
        cells=cells,
    )
