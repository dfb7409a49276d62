"""Whether the way driven is free, by shapely: what the guards of a chain hold to."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.model.coloring import Coloring, Draws, black_at, black_at_draws
from prf.readings.way import STRAIGHT
from prf.sampler.target import Target


def pieces(target: Target) -> NDArray[np.object_]:
    """The pieces of the way as lines; a place alone is a line of no length."""
    return np.asarray(shapely.linestrings(target.way.reshape(-1, 2, 2)))


def blocked_pairs(target: Target, coloring: Coloring) -> int:
    """Pairs of an edge and a piece of the way that it comes too near to."""
    edges = shapely.linestrings(coloring.segments().reshape(-1, 2, 2))
    return int((shapely.distance(edges[:, None], pieces(target)) <= target.driven_radius + STRAIGHT).sum())


def is_free(target: Target, coloring: Coloring) -> bool:
    """Whether every sensor stands in white and no wall on the way."""
    places = [sensor.readings.origin for sensor in (target.laser, target.sonar) if sensor is not None]
    places += [target.way[:, :2], target.way[:, 2:]]
    return not black_at(coloring, np.concatenate(places)).any() and blocked_pairs(target, coloring) == 0


def obstacles(target: Target, draws: Draws) -> NDArray[np.int64]:
    """Blocked pairs and black ends of pieces (n_draws,) of a way without readings."""
    edges = shapely.linestrings(draws.xy[draws.global_edges()])
    met = shapely.distance(edges[:, None], pieces(target)) <= target.driven_radius + STRAIGHT
    blocked = np.bincount(draws.draw_of_edge(), met.sum(axis=1), len(draws)).astype(np.int64)
    ends = np.unique(target.way.reshape(-1, 2), axis=0)
    return blocked + black_at_draws(draws, ends).sum(axis=1)
