"""Probabilities from draws: how probably a point or a square is occupied, and a path free.

Every estimate is a share of draws, so it is exact for the draws and its error is that of the chain, which
:mod:`prf.uncertainty` bounds. A path is judged on whole maps: the answer is the probability that all of it is free at
once, which no image of cells can give.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.coloring import Draws, black_at_draws
from prf.kernels import query
from prf.shell.errors import InputError, UsageError
from prf.uncertainty import Estimates, by_chain, estimates

MOST_COLOURS = 64_000_000
"""Points are answered in batches of at most this many colours (bytes), one a draw and point."""


class PathEstimate(NamedTuple):
    """Share of draws in which a path is free, and the number of draws."""

    p_free: float
    n_draws: int


def occupied_probability(draws: Draws, xy: ArrayLike, square: float = 0.0) -> NDArray[np.float64]:
    """Return the share of draws in which each point, or the square round it, is occupied; `xy` (n_points, 2)."""
    points = _points(xy)
    probability = np.full(len(points), np.nan)
    for chosen, black in _occupied_batches(draws, points, square):
        probability[chosen] = black.mean(axis=0)
    return probability


def occupied_estimates(
    draws: Draws, chain: NDArray[np.int32], xy: ArrayLike, square: float, smallest_ess: float
) -> Estimates:
    """Return the answers of :func:`occupied_probability`, and how far they are known; `chain` (n_draws,)."""
    points = _points(xy)
    found = _unknown(len(points))
    for chosen, black in _occupied_batches(draws, points, square):
        for whole, part in zip(found, estimates(by_chain(black, chain), smallest_ess), strict=True):
            whole[chosen] = part
    return found


def occupied_in_draws(draws: Draws, xy: ArrayLike, square: float = 0.0) -> NDArray[np.bool_]:
    """Return for each draw whether each point (square > 0: any part of the square round it) is black.

    `xy` (n_points, 2).
    """
    points = _points(xy)
    black = black_at_draws(draws, points)
    if square == 0.0:
        return black
    order = np.argsort(points[:, 0], kind="stable")
    marked = np.ascontiguousarray(black[:, order])
    ragged = (draws.vertex_offsets, draws.xy, draws.edge_offsets, draws.edges)
    query.draws_mark_squares(np.ascontiguousarray(points[order]), 0.5 * square, *ragged, marked)
    black[:, order] = marked
    return black


def path_free(draws: Draws, path_xy: ArrayLike, radius: float) -> PathEstimate:
    """Return the share of draws in which a disc can follow the whole path; `path_xy` (n_points, 2)."""
    path = _path_inside(draws, path_xy, radius)
    free = np.nan if path is None else path_free_in_draws(draws, path, radius).mean()
    return PathEstimate(float(free), len(draws))


def path_estimates(
    draws: Draws, chain: NDArray[np.int32], paths: Sequence[ArrayLike], radius: float, smallest_ess: float
) -> Estimates:
    """Return the answers of :func:`path_free`, and how far they are known; `paths` (n_points, 2)."""
    found = _unknown(len(paths))
    for i, path_xy in enumerate(paths):
        path = _path_inside(draws, path_xy, radius)
        if path is not None:
            free = path_free_in_draws(draws, path, radius)[:, None]
            for whole, part in zip(found, estimates(by_chain(free, chain), smallest_ess), strict=True):
                whole[i] = part[0]
    return found


def path_free_in_draws(draws: Draws, path_xy: ArrayLike, radius: float) -> NDArray[np.bool_]:
    """Return for each draw whether a disc can follow the path: its start is white and every edge beyond `radius`.

    Without an edge in reach the disc keeps the colour of its start, so these two conditions are enough. The window
    is convex: a path with its corners inside lies inside. What the disc covers beyond the border is taken as free.

    `path_xy` (n_points, 2).
    """
    path = _points(path_xy)
    pieces = np.vstack((path, path)) if len(path) == 1 else path
    clear = np.empty(len(draws), dtype=np.bool_)
    ragged = (draws.vertex_offsets, draws.xy, draws.edge_offsets, draws.edges)
    query.draws_clear_path(np.ascontiguousarray(pieces), float(radius), *ragged, clear)
    return clear & ~black_at_draws(draws, path[:1])[:, 0]


def _occupied_batches(
    draws: Draws, points: NDArray[np.float64], square: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Yield the numbers of some points inside the window, and their (n_draws, n_chosen) colours."""
    _require_draws(draws)
    if not 0.0 <= square < np.inf:
        raise UsageError(f"square {square} m: the side of a square is a finite number >= 0.")
    inside = np.flatnonzero(draws.window.contains(points))
    batch = max(1, MOST_COLOURS // len(draws))
    for start in range(0, len(inside), batch):
        chosen = inside[start : start + batch]
        yield chosen, occupied_in_draws(draws, points[chosen], square)


def _path_inside(draws: Draws, path_xy: ArrayLike, radius: float) -> NDArray[np.float64] | None:
    """Return the corners of a path, or None if a part of it lies outside the window."""
    path = _points(path_xy)
    _require_draws(draws)
    if len(path) == 0:
        raise InputError("the path has no point.")
    if not 0.0 <= radius < np.inf:
        raise UsageError(f"radius {radius} m: the radius of a disc is a finite number >= 0.")
    return path if draws.window.contains(path).all() else None


def _unknown(n: int) -> Estimates:
    return Estimates(*(np.full(n, np.nan) for _ in Estimates._fields))


def _points(xy: ArrayLike) -> NDArray[np.float64]:
    """Return `xy` as (n, 2) float64; an empty list is no point."""
    return np.asarray(xy, dtype=np.float64).reshape(-1, 2)


def _require_draws(draws: Draws) -> None:
    if len(draws) == 0:
        raise InputError("no draws yet: nothing can be estimated. Go on with prf sample --resume.")
