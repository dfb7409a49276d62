"""The way that was driven: where the sensor went there was room for it (docs/driven-way.md)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.kernels.state.guards import GUARD_WAY, N_SHAPE
from prf.model.window import Window

Floats = NDArray[np.float64]

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
    """Return the ground (a polygon) that no wall may stand on for a way to be free."""
    lines = shapely.linestrings(way.reshape(-1, 2, 2))
    # A circle of 32 corners reaches half a per cent less far between them.
    return shapely.union_all(shapely.buffer(lines, 1.01 * (radius + STRAIGHT) + 1e-6))


def ways_near(guards: Floats, box: Floats) -> NDArray[np.bool_]:
    """Return which guards (n, N_SHAPE) of a way may reach into a box x_min, y_min, x_max, y_max (n,)."""
    low = np.minimum(guards[:, 1:3], guards[:, 3:5]) - guards[:, 5:6]
    high = np.maximum(guards[:, 1:3], guards[:, 3:5]) + guards[:, 5:6]
    return np.asarray(((low <= box[2:]) & (high >= box[:2])).all(axis=1), np.bool_)
