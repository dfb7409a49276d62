"""The way driven: where the sensor went there was room for it (docs/driven-way.md).

Successive positions are joined where nothing stands between them. Returns that most beams pass by are of people, or
misplaced: the robot came through, and the map may leave them unexplained.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.kernels.state.grid import Grid, cells_of, make_grid
from prf.kernels.state.guards import GUARD_WAY, N_SHAPE
from prf.model.window import Window
from prf.readings.ground import MAX_CELLS, count_beams
from prf.readings.readings import Readings

Floats = NDArray[np.float64]

SIGHT_CELL = 0.1
"""Metres: side of the cells in which beams that end are counted beside those that pass."""
SOLID = 0.35
"""Share of beams that end in a cell, among all that reach it, from which on a wall stands there. Fewer returns are of
people, or of what poses misplace."""
LONGEST_JOIN = 1.5
"""Metres: successive poses farther apart are joined only where beams passed all along the line between them ..."""
LONGEST_SEEN_JOIN = 3.0
"""... and not if they are farther apart than this: who knows which way the robot took."""
STRAIGHT = 0.005
"""Metres by which the way may be straightened; the radius grows by as much, so that nothing of it is lost."""
ROUNDING = 0.01
"""Metres to which returns are rounded: many lie at one place."""


class Sightlines(NamedTuple):
    """What beams say of the ground between two poses."""

    grid: Grid
    passes: NDArray[np.int64]  # (n_cells,) beams that reach each cell
    walls: Floats  # (m, 2) returns where most of the beams end, metres

    def is_seen(self, line: Floats, radius: float) -> bool:
        """Return whether beams reached all ground along a line x0, y0, x1, y1, and at `radius` to its sides, metres."""
        along = line[2:] - line[:2]
        length = float(np.hypot(*along))
        side = radius * np.array([-along[1], along[0]]) / length
        steps = np.linspace(0.0, 1.0, 2 + int(2.0 * length / self.grid.cell))[:, None]
        places = np.concatenate([line[:2] + offset * side + steps * along for offset in (-1.0, 0.0, 1.0)])
        return bool((self.passes[cells_of(self.grid, places)] > 0).all())


def sightlines_of(sensors: Sequence[Readings], window: Window) -> Sightlines:
    """Return what the beams of sensors inside the window say; those of a sonar are taken to lie on its axis."""
    grid = make_grid(*window, max(SIGHT_CELL, math.sqrt(window.area / MAX_CELLS)))
    passes, hits = np.zeros(grid.nx * grid.ny, np.int64), np.zeros(grid.nx * grid.ny, np.int64)
    returns = [np.zeros((0, 2))]
    for part in sensors:
        kept = part.select(window.contains(part.origin, strictly=True))
        found = count_beams(grid, window, kept.origin, kept.angle, kept.range, kept.max_range)
        passes += found[0]
        hits += found[1]
        returns.append(found[2])
    ends = np.concatenate(returns)
    cells = cells_of(grid, ends)
    return Sightlines(grid, passes, ends[hits[cells] >= SOLID * passes[cells]])


def driven_way(
    radius: float, logs: Sequence[Readings], sensors: Sequence[Readings], window: Window
) -> NDArray[np.float64]:
    """Return the pieces (k, 4) of the way of the sensors of `logs`; what parts them are the readings in use."""
    if radius == 0.0 or not logs:
        return np.zeros((0, 4))
    tracks = [track for log in logs for track in sensor_tracks(log)]
    return way_of(tracks, sightlines_of(sensors, window), window, radius)


def sensor_tracks(readings: Readings) -> list[NDArray[np.float64]]:
    """Return the position of each device scan by scan, (n, 2) in metres: of a ring the middle of its transducers."""
    scans, number = np.unique(readings.scan, return_inverse=True)
    counts = np.bincount(number)
    middle = np.column_stack([np.bincount(number, weights=axis) / counts for axis in readings.origin.T])
    device = np.zeros(int(scans.max(initial=-1)) + 1, np.int64)
    table = readings.notes.scans
    known = table.number <= scans.max(initial=-1)
    device[table.number[known]] = table.device[known]
    return [middle[device[scans] == one] for one in np.unique(device[scans])]


def way_of(tracks: Sequence[Floats], sight: Sightlines, window: Window, radius: float) -> Floats:
    """Return the pieces (k, 4) of the way: ends x0, y0, x1, y1 in metres, both the same for a place alone.

    `tracks` (n, 2) and `radius`, of the disc that was free: metres.
    """
    lines = [line for track in tracks for line in _joined(track, sight, window, radius)]
    pieces = [np.hstack([line[:-1], line[1:]]) if len(line) > 1 else np.hstack([line, line]) for line in lines]
    return np.unique(np.concatenate([np.zeros((0, 4)), *pieces]), axis=0)


def _joined(track: Floats, sight: Sightlines, window: Window, radius: float) -> list[Floats]:
    """Return the runs of joined positions of one track, straightened."""
    inside = window.contains(track, strictly=True)
    moves = np.hypot(*np.diff(track, axis=0).T)
    joins = inside[:-1] & inside[1:] & (moves <= LONGEST_SEEN_JOIN)
    candidates = np.flatnonzero(joins & (moves > 0.0))
    lines = np.hstack([track[candidates], track[candidates + 1]])
    places = shapely.points(np.unique(np.round(sight.walls / ROUNDING), axis=0) * ROUNDING)
    tree = shapely.STRtree(shapely.linestrings(lines.reshape(-1, 2, 2)))
    met = tree.query(places, predicate="dwithin", distance=radius)[1]
    joins[candidates[np.unique(met)]] = False
    for i in np.flatnonzero(joins & (moves > LONGEST_JOIN)):
        joins[i] = sight.is_seen(np.hstack([track[i], track[i + 1]]), radius)
    runs = np.split(np.arange(len(track)), np.flatnonzero(~joins) + 1)
    return [_straightened(track[run]) for run in runs if inside[run[0]]]


def _straightened(run: Floats) -> Floats:
    """Return a run of positions with fewer corners."""
    if len(np.unique(run, axis=0)) == 1:
        return run[:1]
    return np.asarray(shapely.get_coordinates(shapely.simplify(shapely.LineString(run), STRAIGHT)))


def lies_on_way(way: Floats, piece: Floats) -> bool:
    """Return whether a straight piece (2, 2) is part of a way (k, 4)."""
    lines = shapely.union_all(shapely.linestrings(way.reshape(-1, 2, 2)))
    return bool(shapely.covers(shapely.buffer(lines, STRAIGHT + ROUNDING), shapely.LineString(piece)))


def way_guards(way: Floats, radius: float) -> Floats:
    """Return the guards (k, N_SHAPE) that keep a way (k, 4) clear of edges."""
    guards = np.zeros((len(way), N_SHAPE))
    guards[:, 0] = GUARD_WAY
    guards[:, 1:5] = way
    guards[:, 5] = radius + STRAIGHT
    return guards


def cleared(way: Floats, radius: float) -> shapely.Geometry:
    """Return the ground (a polygon) that no wall may touch for a way to be free."""
    lines = shapely.linestrings(way.reshape(-1, 2, 2))
    # A circle of 32 corners reaches half a per cent less far between them.
    return shapely.union_all(shapely.buffer(lines, 1.01 * (radius + STRAIGHT) + 1e-6))


def ways_near(guards: Floats, box: Floats) -> NDArray[np.bool_]:
    """Return which guards (n, N_SHAPE) of a way may reach into a box x_min, y_min, x_max, y_max (n,)."""
    low = np.minimum(guards[:, 1:3], guards[:, 3:5]) - guards[:, 5:6]
    high = np.maximum(guards[:, 1:3], guards[:, 3:5]) + guards[:, 5:6]
    return np.asarray(((low <= box[2:]) & (high >= box[:2])).all(axis=1), np.bool_)
