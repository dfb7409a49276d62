"""What readings show of the ground before any map: its window, the cells that they saw, and the way driven.

Of cells that no reading crossed or ended in a map knows the prior alone. Where the sensor went there was room for it
(docs/driven-way.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.kernels.readings.cones import MAX_DISTANCE
from prf.kernels.score.passed_cells import count_passes, mark_cones
from prf.kernels.state.grid import Grid, most_cells
from prf.kernels.state.guards import GUARD_WAY, N_SHAPE
from prf.model.laser import unit_vectors, window_exit
from prf.model.layout import image_grid
from prf.model.sensors import SonarModel
from prf.model.sonar import make_poses
from prf.model.window import Window
from prf.readings.points import PointTable
from prf.readings.readings import Readings

KEPT_RETURNS = 0.995
"""Share of the returns that the default window holds at least."""
MARGIN = 1.0
"""Metres between them and the border of the default window."""


def chosen_window(
    requested: Sequence[float] | None,
    origin: NDArray[np.float64],
    angle: NDArray[np.float64],
    ranges: NDArray[np.float64],
) -> Window:
    """Return the window requested, or one round all sensors and 99.5 % of the returns."""
    if requested is not None:
        return Window.checked(*requested)
    hit = np.isfinite(ranges)
    ends = origin[hit] + ranges[hit, None] * unit_vectors(angle[hit])
    low, high = origin.min(axis=0), origin.max(axis=0)
    if len(ends) > 0:
        # A quarter of what may be left out on each of the four sides.
        tail = (1.0 - KEPT_RETURNS) / 4.0
        low = np.minimum(low, np.quantile(ends, tail, axis=0, method="lower"))
        high = np.maximum(high, np.quantile(ends, 1.0 - tail, axis=0, method="higher"))
    return Window.checked(*(low - MARGIN).tolist(), *(high + MARGIN).tolist())


def seen_cells(
    window: Window, resolution: float, laser: Readings | None, sonar: Readings | None, points: PointTable | None
) -> NDArray[np.bool_]:
    """Return the cells (ny, nx) of the image that readings crossed or ended in; values at points concern all of it."""
    grid = image_grid(window, resolution)
    seen = np.full((grid.ny, grid.nx), points is not None)
    if laser is not None:
        seen |= seen_by_beams(grid, window, laser.origin, laser.angle, laser.range, laser.max_range)
    if sonar is not None:
        seen |= seen_by_cones(grid, window, sonar.origin, sonar.angle, sonar.cone, sonar.range, sonar.max_range)
    return seen


def driven_way(
    radius: float, logs: Sequence[Readings], sensors: Sequence[Readings], window: Window
) -> NDArray[np.float64]:
    """Return the pieces (k, 4) of the way of the sensors of `logs`; returns are those of the readings in use."""
    if radius == 0.0 or not logs:
        return np.zeros((0, 4))
    ends = np.concatenate([part.impacts() for part in sensors])
    tracks = [track for log in logs for track in sensor_tracks(log)]
    return way_of(tracks, ends, window, radius)


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


Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def beam_ends(window: Window, origin: Floats, angle: Floats, ranges: Floats, max_range: float) -> tuple[Floats, Bools]:
    """Return where beams end inside the window and within reach (n, 2), and which of them (n,) by a return.

    `origin` (n, 2), `angle` (n,), `ranges` (n,).
    """
    direction = unit_vectors(angle)
    reach = np.minimum(window_exit(window, origin, direction), max_range)
    returned: Bools = ranges < reach
    return origin + np.where(returned, ranges, reach)[:, None] * direction, returned


def seen_by_beams(grid: Grid, window: Window, origin: Floats, angle: Floats, ranges: Floats, max_range: float) -> Bools:
    """Return which cells (ny, nx) of a grid beams crossed or ended in; parameters as of :func:`beam_ends`."""
    passes = np.zeros((grid.ny, grid.nx), np.int64)
    end, _ = beam_ends(window, origin, angle, ranges, max_range)
    path = np.empty(most_cells(grid), np.int32)
    count_passes(grid, np.ascontiguousarray(origin), np.ascontiguousarray(end), path, passes.reshape(-1))
    seen: Bools = passes > 0
    return seen


def seen_by_cones(
    grid: Grid, window: Window, origin: Floats, angle: Floats, cone: Floats, ranges: Floats, max_range: float
) -> Bools:
    """Return which cells (ny, nx) of a grid sonar cones covered up to their readings, or without return their reach.

    `origin` (n, 2), `angle` (n,), `cone` (n,), `ranges` (n,).
    """
    seen: Bools = np.zeros((grid.ny, grid.nx), np.bool_)
    room = min(2 * math.ceil(max_range / grid.cell) + 3, max(grid.nx, grid.ny)) ** 2
    pose = make_poses(SonarModel(max_range=max_range), origin, angle, cone, ranges, window)
    reach = np.minimum(ranges, pose[:, MAX_DISTANCE])
    mark_cones(grid, pose, reach, np.empty(room, np.int32), np.empty(room), seen.reshape(-1))
    return seen


LONGEST_JOIN = 1.5
"""Metres: successive poses farther apart are not joined."""
STRAIGHT = 0.005
"""Metres by which the way may be straightened; the radius grows by as much, so that nothing of it is lost."""
ROUNDING = 0.01
"""Metres to which returns are rounded: many lie at one place."""


def way_of(tracks: Sequence[Floats], returns: Floats, window: Window, radius: float) -> Floats:
    """Return the pieces (k, 4) of the way: ends x0, y0, x1, y1 in metres, both the same for a place alone.

    `tracks` (n, 2), `returns` (m, 2).
    """
    lines = [line for track in tracks for line in _joined(track, returns, window, radius)]
    pieces = [np.hstack([line[:-1], line[1:]]) if len(line) > 1 else np.hstack([line, line]) for line in lines]
    return np.unique(np.concatenate([np.zeros((0, 4)), *pieces]), axis=0)


def _joined(track: Floats, returns: Floats, window: Window, radius: float) -> list[Floats]:
    """Return the runs of joined positions of one track, straightened."""
    inside = window.contains(track, strictly=True)
    moves = np.hypot(*np.diff(track, axis=0).T)
    joins = inside[:-1] & inside[1:] & (moves <= LONGEST_JOIN)
    candidates = np.flatnonzero(joins & (moves > 0.0))
    segments = shapely.linestrings(np.stack([track[candidates], track[candidates + 1]], axis=1))
    places = shapely.points(np.unique(np.round(returns / ROUNDING), axis=0) * ROUNDING)
    met = shapely.STRtree(segments).query(places, predicate="dwithin", distance=radius)[1]
    joins[candidates[np.unique(met)]] = False
    runs = np.split(np.arange(len(track)), np.flatnonzero(~joins) + 1)
    return [_straightened(track[run]) for run in runs if inside[run[0]]]


def _straightened(run: Floats) -> Floats:
    """Return a run of positions with fewer corners."""
    if len(np.unique(run, axis=0)) == 1:
        return run[:1]
    return np.asarray(shapely.get_coordinates(shapely.simplify(shapely.LineString(run), STRAIGHT)))


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
