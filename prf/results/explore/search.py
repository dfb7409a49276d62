"""`explore`: the places from which one scan is expected to settle most, best first."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Draws
from prf.model.window import Window
from prf.results import names
from prf.results.convergence import FEWEST_DRAWS, effective_size, pieces
from prf.results.estimate import LEVEL, PIECES, by_chain
from prf.results.explore.gain import N_BEAMS
from prf.results.explore.question import CELL, EVERY, Question, ask, gain_at, rank_places
from prf.results.explore.reach import Reach, reachable
from prf.results.explore.scanner import Scanner, first_walls, scanner_of
from prf.results.run import RunData
from prf.shell.cli.console import ProgressCallback, Report, reported
from prf.shell.errors import InputError, UsageError

MOST_DRAWS, LEAST_DRAWS = 256, 64
"""Draws that are compared, spread evenly over the chains; as few in large windows."""
MOST_COLOURS = 32_000_000
"""Cells times draws, about, up to which they are not fewer: 10 bytes each."""
MOST_PLACES = 60
"""Places that are weighed in full: the best of all by a cheap estimate."""
BRIEF_DRAWS, BRIEF_CANDIDATES, BRIEF_PLACES = 128, 300, 16
"""In brief: draws that are compared, places that are ranked, and those weighed, which are not beside each other."""
MOST_DISTANCES = 8_000_000
"""Beams that are cast at once."""
LEAST_METRES = 1.0
"""Of way by which a gain is divided."""
APART, MOST_SHOWN = 1.5, 6
"""Metres between places that pictures show, and how many: beside the best lie many that are nearly as good."""
RADIUS = 0.25
"""Of the disc that drives, metres, unless given."""
By = Literal["gain", "gain-per-metre"]

Floats = NDArray[np.float64]


class Exploration(NamedTuple):
    """Places to look from, best first, one row each.

    Attributes
    ----------
    xy : (n, 2) float64
        Metres.
    theta : (n,) float64
        Heading from which the sensor sees most of what is to be seen there, radians.
    gain : (n,) float64
        Expected drop, by one scan, of the summed entropies of cells, or of the entropy of the answer: nats.
    low, high : (n,) float64
        The gain in ever longer chains lies between them at 95 %.
    metres : (n,) float64
        Length of the way from the start.
    gain_per_metre : (n,) float64
        Nats a metre of that way, of one metre at least.
    p_free : (n,) float64
        Probability that the disc can follow all of that way.
    ways : tuple of (k, 2) float64
        The ways, from the start to each place, metres.
    entropy : float
        What is to be settled, as it is: the sum of entropies, or that of the answer, nats.
    """

    xy: Floats
    theta: Floats
    gain: Floats
    low: Floats
    high: Floats
    metres: Floats
    gain_per_metre: Floats
    p_free: Floats
    ways: tuple[Floats, ...]
    entropy: float

    def shown(self) -> list[int]:
        """Return the numbers of the best places for pictures: surely of some gain, and not beside a better one."""
        return spread(self.xy, np.flatnonzero(self.low > 0.0), MOST_SHOWN)


def explore(
    run: RunData,
    start: Floats | None = None,
    target: Floats | None = None,
    radius: float = RADIUS,
    by: By = "gain",
    is_brief: bool = False,
    progress: bool | ProgressCallback = True,
) -> Exploration:
    """Return the best places to look from; see :meth:`prf.output.run.Run.explore`.

    `is_brief`: as good as a picture needs, in a small part of the time, by fewer draws and for places :data:`APART`.
    """
    if len(run.draws) == 0:
        raise InputError(f"{run.name}: no draws yet: nothing can be estimated. Resume with prf sample --resume.")
    if not 0.0 < radius < np.inf:
        raise UsageError(f"radius {radius} m: must be a finite number above 0.")
    scanner, here = scanner_of(run), last_place(run)
    if scanner is None or here is None:
        raise InputError(
            f"{run.name}: no laser or sonar readings ({names.READINGS}), so neither the sensor nor where it stands is "
            "known. Sample from a log of readings with prf sample."
        )
    begin = here if start is None else start
    for what, points in (("start", begin[None]), ("target", begin[None] if target is None else target)):
        outside = ~run.draws.window.contains(points)
        if outside.any():
            x, y = points[int(outside.argmax())]
            raise InputError(f"{what}: ({x:g}, {y:g}) lies outside the window of {run.name}, where nothing is known.")
    most = int(MOST_COLOURS * CELL**2 / run.draws.window.area)
    most = min(max(most, LEAST_DRAWS), BRIEF_DRAWS if is_brief else MOST_DRAWS)
    draws, n_chains = thinned(run.draws, run.chain, most)
    reach = reachable(draws, begin, radius)
    question = ask(draws, n_chains, target, radius)
    return _ranked(question, draws, reach, scanner, by, is_brief, progress)


def last_place(run: RunData) -> Floats | None:
    """Return where the sensor, or the middle of the ring, was last (2,), metres; None without readings."""
    readings = run.placed().sensors
    if readings is None or readings.n_beams == 0:
        return None
    return np.asarray(np.unique(readings.origin[readings.scan == readings.scan.max()], axis=0).mean(axis=0))


def thinned(draws: Draws, chain: NDArray[np.int32], most: int = MOST_DRAWS) -> tuple[Draws, int]:
    """Return draws spread evenly over the chains, equally many of each, chain by chain, and the number of chains."""
    rows = by_chain(np.arange(len(draws)), chain)
    n_chains, n_draws = rows.shape
    kept = np.unique(np.linspace(0, n_draws - 1, max(1, min(n_draws, most // n_chains))).round().astype(np.int64))
    return Draws.from_colorings([draws[row] for row in rows[:, kept].ravel().tolist()], draws.window), n_chains


def spread(xy: Floats, numbers: NDArray[np.int64], most: int) -> list[int]:
    """Return the first of `numbers` of places `xy` (n, 2) that are not beside an earlier one, so many at most."""
    kept: list[int] = []
    for number in numbers.tolist():
        if len(kept) == most:
            break
        if (np.hypot(*(xy[kept] - xy[number]).T) >= APART).all():
            kept.append(number)
    return kept


def candidates(reach: Reach, most: int | None = None) -> NDArray[np.int64]:
    """Return the numbers of the reachable places that are asked: those of the white squares of a board, 0.57 m apart.

    On wider boards if they are more than `most`. InputError if there is none but the start.
    """
    side, found = 2, np.arange(len(reach.lattice))
    while side == 2 or (most is not None and len(found) > most):
        square, off = np.divmod(reach.lattice, side)
        found = np.flatnonzero((off == 0).all(axis=1) & (square.sum(axis=1) % 2 == 0))
        side += 1
    if len(found) < 2:
        x, y = reach.xy[0]
        raise InputError(
            f"no place can be reached from ({x:.2f}, {y:.2f}): the disc is too wide, or too little is known to be "
            "free. Give a smaller --radius, or --from X Y."
        )
    return found


def _ranked(
    question: Question,
    draws: Draws,
    reach: Reach,
    scanner: Scanner,
    by: By,
    is_brief: bool,
    progress: bool | ProgressCallback,
) -> Exploration:
    """Return the reachable places in the order of their gains."""
    segments = [each.segments() for each in draws]
    metres = np.maximum(reach.metres, LEAST_METRES)
    places = candidates(reach, BRIEF_CANDIDATES if is_brief else None)
    with reported(progress, len(places), "ranking places") as report:
        cheap = _cheap_gains(question, segments, draws.window, reach.xy[places], scanner, report)
    worth = cheap if by == "gain" else cheap / metres[places]
    order = np.argsort(-worth, kind="stable")
    places = places[spread(reach.xy[places], order, BRIEF_PLACES) if is_brief else order[:MOST_PLACES]]
    with reported(progress, len(places), "weighing places") as report:
        rows = _weighed(question, segments, draws.window, reach.xy[places], scanner, report)
    # More than all cannot be settled, but for the error of the entropy itself.
    rows[:, 1] = np.minimum(rows[:, 1], question.entropy)
    if question.is_path:
        rows[:, 3] = np.minimum(rows[:, 3], math.log(2.0))
    worth = rows[:, 1] if by == "gain" else rows[:, 1] / metres[places]
    order = np.argsort(-worth, kind="stable")
    places, (theta_, gain_, low, high) = places[order], rows[order].T
    ways = tuple(reach.way(place) for place in places.tolist())
    found = (reach.metres[places], gain_ / metres[places], reach.p_free[places], ways)
    return Exploration(reach.xy[places], theta_, gain_, low, high, *found, question.entropy)


def _cheap_gains(
    question: Question, segments: list[Floats], window: Window, xy: Floats, scanner: Scanner, report: Report
) -> Floats:
    """Return a cheap estimate (n,) of the gain of each of the places `xy` (n, 2); `segments`: of each draw."""
    found = np.empty(len(xy))
    batch = max(1, MOST_DISTANCES // (N_BEAMS * len(segments)))
    for first in range(0, len(xy), batch):
        some = xy[first : first + batch]
        distance = first_walls(segments[::EVERY], window, some, N_BEAMS, scanner)
        found[first : first + batch] = rank_places(question, distance, some, scanner)
        report(first + len(some))
    return found


def _weighed(
    question: Question, segments: list[Floats], window: Window, xy: Floats, scanner: Scanner, report: Report
) -> Floats:
    """Return the best heading at each of the places `xy` (n, 2), the gain and its bounds, (n, 4)."""
    from threadpoolctl import threadpool_limits  # noqa: PLC0415 - finds the libraries that are loaded

    distance = first_walls(segments, window, xy, N_BEAMS, scanner)
    rows = np.empty((len(xy), 4))
    # Small products: threads that wait for each other cost more than they bring.
    with threadpool_limits(1):
        for number, place in enumerate(xy):
            gain, theta = gain_at(question, distance[:, number], place, scanner)
            rows[number] = theta, *_with_bounds(gain.astype(np.float64), question.jury.n_chains)
            report(number + 1)
    return rows


def _with_bounds(gain: Floats, n_chains: int) -> tuple[float, float, float]:
    """Return the mean of the gains (n,) of truths, chain by chain, and its bounds at 95 %; no gain is less than 0.

    The truths are worth as many as their effective size, or less where parts of chains differ by more.
    """
    from scipy import special  # noqa: PLC0415 - half a second

    chains, mean = gain.reshape(n_chains, -1, 1), max(float(gain.mean()), 0.0)
    if chains.shape[1] < FEWEST_DRAWS:
        return mean, 0.0, float("inf")
    parts = pieces(chains, max(2, -(-PIECES // n_chains)))
    variance = gain.var() / min(np.nan_to_num(effective_size(chains)[0], nan=len(gain)), len(gain))
    for several in (parts, chains) if n_chains > 1 else (parts,):
        variance = max(variance, several.mean(axis=1).var(ddof=1) / len(several))
    half = float(special.stdtrit(len(parts) - 1.0, 0.5 * (1.0 + LEVEL)) * np.sqrt(variance))
    return mean, max(mean - half, 0.0), mean + half
