"""Probabilities from draws: how probably a point or a square is occupied, and a path free, and how far that is known.

Every estimate is a share of draws, so it is exact for the draws, and its error is that of the chain; bounds for it are
derived and their coverage is measured in docs/convergence.md. A path is judged on whole maps: the answer is the
probability that all of it is free at once, which no image of cells can give.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from prf.kernels.score import query
from prf.model.coloring import Draws, black_at_draws
from prf.results.convergence import FEWEST_DRAWS, effective_size, pieces, split_rhat
from prf.shell.errors import InputError, UsageError

MOST_COLOURS = 64_000_000
"""Points are answered in batches of at most this many colours (bytes), one a draw and point."""
LEVEL = 0.95
PIECES = 8
"""Chains are cut into halves, a few chains into this many pieces in all, whose means are compared."""
DRAWS_PER_DEGREE = 20.0
"""Effective draws for each degree of freedom of a long run, if that is more than the pieces give."""
MOST_WORTH = 4.0
"""No answer is worth more than about so many times the smallest effective sample size of the run: chains that have not
explored everything may agree on an answer by chance."""
NEAR = 2.0
"""Metres round what a question needs within which the run's probe points stand for it where all draws are equal."""
APART = 1.1
"""R-hat above which the parts of a chain are not independent: its chains alone are."""
FEWEST_OF_A_COLOUR = 3.0
"""Effective draws of a colour below which that colour may as well have no probability at all."""
PIECE = 1.0
"""Metres of a path, at most, of which what blocks it is named."""
MOST_VALUES = 1_000_000
"""Values, draws times quantities, whose autocorrelation is computed at once (80 bytes each)."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Estimates(NamedTuple):
    """Probabilities, and how far they are known: their Monte Carlo error alone. One a quantity.

    Attributes
    ----------
    probability : (n,) float64
        Share of draws.
    low, high : (n,) float64
        The limit of the share in ever longer chains lies between them at 95 %.
    ess : (n,) float64
        Effective sample size in draws; of draws that are all equal, the smallest of the colours near it, or of the run.
        nan: not known.
    rhat : (n,) float64
        Split R-hat; 1 where all draws are equal, inf where each half chain is constant at its own value. nan: not
        known.
    """

    probability: Floats
    low: Floats
    high: Floats
    ess: Floats
    rhat: Floats


class PointEstimates(NamedTuple):
    """Probabilities that points are occupied, how far they are known, and whether the points were seen.

    Attributes
    ----------
    probability, low, high, ess, rhat : (n,) float64
        As :class:`Estimates` has them.
    seen : (n,) bool
        Whether a reading crossed the cell of the image that holds the point, or ended in it.
    """

    probability: Floats
    low: Floats
    high: Floats
    ess: Floats
    rhat: Floats
    seen: Bools


class Obstruction(NamedTuple):
    """The piece of a path, a metre at most, that keeps it from being free: most draws block it.

    Attributes
    ----------
    piece : (2, 2) float64
        Its ends, metres.
    p_free : float
        Share of draws in which the disc can follow it.
    n_returns : int
        Returns in use within the radius of the disc of it.
    is_driven : bool
        Whether it is part of the way driven.
    """

    piece: Floats
    p_free: float
    n_returns: int
    is_driven: bool


def occupied_probability(draws: Draws, xy: ArrayLike, square: float = 0.0) -> Floats:
    """Return the share of draws in which each point, or the square round it, is occupied; `xy` (n_points, 2)."""
    points = _points(xy)
    probability = np.full(len(points), np.nan)
    for chosen, black in _occupied_batches(draws, points, square):
        probability[chosen] = black.mean(axis=0)
    return probability


def occupied_estimates(
    draws: Draws, chain: NDArray[np.int32], xy: ArrayLike, square: float, smallest_ess: float, near_ess: Floats
) -> Estimates:
    """Return the answers of :func:`occupied_probability`, and how far they are known.

    `chain` (n_draws,). `smallest_ess`: of the run. `near_ess` (n_points,): by :func:`nearby_ess`.
    """
    points = _points(xy)
    found = np.full((len(Estimates._fields), len(points)), np.nan)
    for chosen, black in _occupied_batches(draws, points, square):
        found[:, chosen] = estimates(by_chain(black, chain), smallest_ess, near_ess[chosen])
    return Estimates(*found)


def occupied_in_draws(draws: Draws, xy: ArrayLike, square: float = 0.0) -> Bools:
    """Return for each draw whether each point (square > 0: any part of the square round it) is black.

    `xy` (n_points, 2).
    """
    points = _points(xy)
    black = black_at_draws(draws, points)
    if square == 0.0:
        return black
    order = np.argsort(points[:, 0], kind="stable")
    marked = np.ascontiguousarray(black[:, order])
    query.draws_mark_squares(np.ascontiguousarray(points[order]), 0.5 * square, draws.graphs, marked)
    black[:, order] = marked
    return black


def path_free(draws: Draws, path_xy: ArrayLike, radius: float) -> float:
    """Return the share of draws in which a disc can follow a whole path (n_points, 2); nan if it leaves the window."""
    path = _path_inside(draws, path_xy, radius)
    return float("nan") if path is None else float(path_free_in_draws(draws, path, radius).mean())


def path_estimates(
    draws: Draws,
    chain: NDArray[np.int32],
    paths: Sequence[ArrayLike],
    radius: float,
    smallest_ess: float,
    near_ess: Floats,
) -> Estimates:
    """Return the answers of :func:`path_free`, and how far they are known.

    `paths` (n_points, 2) each. `smallest_ess`: of the run. `near_ess` (n_paths,): by :func:`nearby_ess`.
    """
    found = np.full((len(Estimates._fields), len(paths)), np.nan)
    for i, path_xy in enumerate(paths):
        path = _path_inside(draws, path_xy, radius)
        if path is not None:
            free = path_free_in_draws(draws, path, radius)[:, None]
            found[:, [i]] = estimates(by_chain(free, chain), smallest_ess, near_ess[[i]])
    return Estimates(*found)


def blocking_piece(draws: Draws, path_xy: ArrayLike, radius: float) -> tuple[Floats, float]:
    """Return the piece (2, 2) of a path inside the window that is free in the fewest draws, and their share.

    Legs are cut into pieces of :data:`PIECE` at most; of pieces alike the first. `path_xy` (n_points, 2).
    """
    corners = cut_legs(_points(path_xy), PIECE)
    pieces_of = np.stack([corners[:-1], corners[1:]], axis=1)
    black = black_at_draws(draws, corners[:-1])
    free = [
        (query.draws_clear_path(np.ascontiguousarray(piece), float(radius), draws.graphs) & ~black[:, i]).mean()
        for i, piece in enumerate(pieces_of)
    ]
    worst = int(np.argmin(free))
    return pieces_of[worst], float(free[worst])


def cut_legs(path: Floats, longest: float) -> Floats:
    """Return the corners (m, 2) of a path (n, 2) with more between them, no farther apart than `longest` metres.

    A path of one point is that point twice.
    """
    ends = np.vstack([path, path[-1:]]) if len(path) == 1 else path
    parts = [
        start + np.linspace(0.0, 1.0, n, endpoint=False)[:, None] * (end - start)
        for start, end in pairwise(ends)
        for n in [max(1, math.ceil(float(np.hypot(*(end - start))) / longest - 1e-9))]
    ]
    return np.vstack([*parts, ends[-1:]])


def path_free_in_draws(draws: Draws, path_xy: ArrayLike, radius: float) -> Bools:
    """Return for each draw whether a disc can follow the path: its start is white and every edge beyond `radius`.

    Without an edge in reach the disc keeps the colour of its start, so these two conditions are enough. The window
    is convex: a path with its corners inside lies inside. What the disc covers beyond the border is taken as free.

    `path_xy` (n_points, 2).
    """
    path = _points(path_xy)
    corners = np.vstack((path, path)) if len(path) == 1 else path
    clear = query.draws_clear_path(np.ascontiguousarray(corners), float(radius), draws.graphs)
    return np.asarray(clear & ~black_at_draws(draws, path[:1])[:, 0])


def _occupied_batches(draws: Draws, points: Floats, square: float) -> Iterator[tuple[NDArray[np.int64], Bools]]:
    """Yield the numbers of some points inside the window, and their (n_draws, n_chosen) colours."""
    _require_draws(draws)
    if not 0.0 <= square < np.inf:
        raise UsageError(f"square {square} m: must be a finite number of at least 0.")
    inside = np.flatnonzero(draws.window.contains(points))
    batch = max(1, MOST_COLOURS // len(draws))
    for start in range(0, len(inside), batch):
        chosen = inside[start : start + batch]
        yield chosen, occupied_in_draws(draws, points[chosen], square)


def _path_inside(draws: Draws, path_xy: ArrayLike, radius: float) -> Floats | None:
    """Return the corners of a path, or None if a part of it lies outside the window."""
    path = _points(path_xy)
    _require_draws(draws)
    if len(path) == 0:
        raise InputError("path: expected at least one point x, y.")
    if not 0.0 <= radius < np.inf:
        raise UsageError(f"radius {radius} m: must be a finite number of at least 0.")
    return path if draws.window.contains(path).all() else None


def _points(xy: ArrayLike) -> Floats:
    """Return `xy` as (n, 2) float64; an empty list has no points."""
    return np.asarray(xy, dtype=np.float64).reshape(-1, 2)


def _require_draws(draws: Draws) -> None:
    if len(draws) == 0:
        raise InputError("no draws yet: nothing can be estimated. Resume with prf sample --resume.")


def by_chain(values: NDArray[Any], chain: NDArray[np.int32]) -> NDArray[Any]:
    """Return the rows of `values` (n, ...) as (n_chains, n_draws, ...), each chain's in their order.

    The oldest draws are left out of a chain that has more than another.
    """
    kept = [np.flatnonzero(chain == one) for one in np.unique(chain)]
    n_draws = min((len(rows) for rows in kept), default=0)
    rows = np.array([rows[len(rows) - n_draws :] for rows in kept], np.int64).reshape(len(kept), n_draws)
    return values[rows]


def estimates(black: NDArray[np.bool_], smallest_ess: float, near_ess: Floats | None = None) -> Estimates:
    """Return the probability of each quantity with bounds at 95 %.

    `black` (n_chains, n_draws, n). `near_ess` (n,): what draws that are all equal count for; None: `smallest_ess`.
    """
    n_chains, n_draws, n = black.shape
    if n_draws < FEWEST_DRAWS:
        unknown = np.full(n, np.nan)
        return Estimates(black.mean(axis=(0, 1)), np.zeros(n), np.ones(n), unknown, unknown)
    batch = max(1, MOST_VALUES // (n_chains * n_draws))
    equal = np.full(n, smallest_ess) if near_ess is None else near_ess
    starts = range(0, max(n, 1), batch)
    parts = [_batch(black[:, :, at : at + batch], smallest_ess, equal[at : at + batch]) for at in starts]
    return Estimates(*np.concatenate(parts, axis=1))


def smallest_ess(colours: NDArray[np.bool_], functionals: Floats) -> float:
    """Return the effective sample size that draws which are all equal count for: the smallest of a run.

    `colours` (n_chains, n_draws, n_probes), `functionals` (n_chains, n_draws, n_functionals).
    """
    n_chains, n_draws, _ = functionals.shape
    if n_draws < FEWEST_DRAWS:
        return float(n_chains)
    for values in (colours, functionals):
        sizes = effective_size(values)
        if not np.isnan(sizes).all():
            return max(float(np.nanmin(sizes)), float(n_chains))
    return float(n_chains)


def probe_ess(colours: NDArray[np.bool_]) -> Floats:
    """Return the effective sample size (n_probes,) of colours (n_chains, n_draws, n_probes).

    At least the number of chains; nan of a colour that is constant, and of too few draws.
    """
    n_chains, n_draws, n_probes = colours.shape
    if n_draws < FEWEST_DRAWS:
        return np.full(n_probes, np.nan)
    return np.maximum(effective_size(colours), float(n_chains))


def nearby_ess(places: NDArray[Any], reach: float, probe_xy: Floats, ess: Floats, least: float) -> Floats:
    """Return the smallest effective sample size of the probes within `reach` metres of each of `places` (n,).

    `places`: geometries. `probe_xy` (n_probes, 2), `ess` (n_probes,): nan says nothing. `least`: where no probe is near
    that says something, the smallest of the run.
    """
    found = np.full(len(places), least)
    order = np.argsort(-ess, kind="stable")  # the smallest last, nan after them
    for number in order[: np.count_nonzero(~np.isnan(ess))].tolist():
        found[shapely.dwithin(places, shapely.Point(probe_xy[number]), reach)] = ess[number]
    return found


def _batch(black: Bools, smallest_ess: float, equal_ess: Floats) -> Estimates:
    n_chains, n_draws, _ = black.shape
    share = black.mean(axis=(0, 1))
    spread = share * (1.0 - share)
    ess = effective_size(black)
    parts = pieces(black, max(2, -(-PIECES // n_chains)))
    variance = np.fmax(spread / ess, _variance_of_mean(parts))
    if n_chains > 1:
        variance = np.maximum(variance, _variance_of_mean(black))
    with np.errstate(invalid="ignore"):
        size = np.clip(np.where(spread > 0.0, spread / variance, 1.0), 1.0, n_chains * n_draws)
    size = 1.0 / (1.0 / size + 1.0 / (MOST_WORTH * smallest_ess))
    rhat = split_rhat(black)
    degrees = np.maximum(len(parts) - 1.0, size / DRAWS_PER_DEGREE)
    if n_chains > 1:
        degrees = np.where(rhat > APART, n_chains - 1.0, degrees)
    low, high = _wilson(share, size, degrees)
    low = np.where(share * size < FEWEST_OF_A_COLOUR, 0.0, low)
    high = np.where((1.0 - share) * size < FEWEST_OF_A_COLOUR, 1.0, high)
    bound = -np.expm1(np.log(1.0 - LEVEL) / equal_ess)  # rule of three: (1 - bound) ** ess = 0.05
    low = np.where(share == 1.0, 1.0 - bound, low)
    high = np.where(share == 0.0, bound, high)
    return Estimates(share, low, high, np.where(spread > 0.0, ess, equal_ess), rhat)


def _wilson(share: Floats, size: Floats, degrees: Floats) -> tuple[Floats, Floats]:
    """Return the probabilities whose `size` independent draws differ from `share` by the quantile of Student's t."""
    from scipy import special  # noqa: PLC0415 - half a second, where an interval is asked for alone

    quantile = special.stdtrit(degrees, 0.5 * (1.0 + LEVEL))
    shrink = quantile**2 / size
    centre = (share + 0.5 * shrink) / (1.0 + shrink)
    half = np.sqrt(shrink * (share * (1.0 - share) + 0.25 * shrink)) / (1.0 + shrink)
    return np.maximum(centre - half, 0.0), np.minimum(centre + half, 1.0)


def _variance_of_mean(parts: NDArray[Any]) -> Floats:
    """Return the variance of the mean over all parts (k, n_draws, n), taken as independent."""
    variance: Floats = parts.mean(axis=1).var(axis=0, ddof=1) / len(parts)
    return variance
