"""What is to be settled, all cells, those of a region, or one path, and by how much a scan from a place does so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.model.coloring import Draws, black_at_draws
from prf.model.window import Window
from prf.results.estimate import path_free_in_draws
from prf.results.explore.gain import (
    N_BEAMS,
    N_SECTORS,
    Jury,
    answer_gain,
    best_view,
    cells_gain,
    make_jury,
    misfits,
    outcome_gain,
    sector_of,
)
from prf.results.explore.scanner import Scanner

CELL = 0.2
"""Side of the cells whose entropies are summed, metres."""
LEAST_ENTROPY = 0.02
"""Nats below which a cell is settled."""
MOST_CELLS = 6_000
"""Unsettled cells that are asked: of more, one in so many stands for those beside it."""
NEAR_WAY = 0.2
"""Metres beside the ground that a path needs, whose cells rank places for it."""
EVERY = 2
"""Places are ranked by one draw in so many."""
SEED = 1
"""Of the errors of simulated scans: every place has the same ones."""

Floats = NDArray[np.float64]


class Question(NamedTuple):
    """What is to be settled: cells, or one answer, and then the cells on which it hangs."""

    cell: Floats  # (c, 2) centres, metres
    black: NDArray[np.bool_]  # (n, c) their colours in draws
    jury: Jury  # of the cells, or of the answer
    is_path: bool
    entropy: float  # nats, of all cells or of the answer
    weight: float  # entropy of all cells by that of those asked


def ask(draws: Draws, n_chains: int, target: Floats | None, radius: float) -> Question:
    """Return what is to be settled, by draws chain by chain in equal numbers.

    `target` (k, 2): corners of a path that a disc is to follow, or a ring, whose inside is asked; None: all cells of
    the window.
    """
    cell, answer = cells_of(draws.window), None
    if target is not None and is_ring(target):
        cell = cell[shapely.contains_xy(shapely.make_valid(shapely.Polygon(target)), cell)]
    elif target is not None:
        answer = path_free_in_draws(draws, target, radius)[:, None]
        way = shapely.LineString(np.vstack([target, target[-1:]]))
        cell = cell[shapely.dwithin(shapely.points(cell), way, radius + NEAR_WAY)]
    black = black_at_draws(draws, cell)
    open_ = entropy_of(black)
    unsettled = np.flatnonzero(open_ > LEAST_ENTROPY)
    asked = unsettled[:: max(1, -(-len(unsettled) // MOST_CELLS))]
    total = float(open_[unsettled].sum())
    weight = total / float(open_[asked].sum()) if len(asked) else 1.0
    cell, black = cell[asked], black[:, asked]
    if answer is None:
        return Question(cell, black, make_jury(black, n_chains), False, total, weight)
    return Question(cell, black, make_jury(answer, n_chains), True, float(entropy_of(answer).sum()), 1.0)


def is_ring(target: Floats) -> bool:
    """Return whether corners (k, 2) are those of a region: the last is the first."""
    return len(target) > 3 and bool((target[0] == target[-1]).all())


def cells_of(window: Window) -> Floats:
    """Return the centres (n, 2) of the cells of a window, metres."""
    x, y = (
        low + CELL * (np.arange(max(1, round((high - low) / CELL))) + 0.5)
        for low, high in ((window.x_min, window.x_max), (window.y_min, window.y_max))
    )
    xy = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return xy[window.contains(xy)]


def entropy_of(black: NDArray[np.bool_]) -> Floats:
    """Return the entropy (c,) of the share of draws in which each of `black` (n, c) holds, nats."""
    share = black.mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = [np.where(p > 0.0, -p * np.log(p), 0.0) for p in (share, 1.0 - share)]
    return np.asarray(parts[0] + parts[1])


def rank_places(question: Question, distance: NDArray[np.float32], places: Floats, scanner: Scanner) -> Floats:
    """Return a cheap estimate (n,) of the gain of each of `places` (n, 2): cell by cell, by one beam alone.

    `distance` (n_some, n, N_BEAMS): of :func:`prf.results.explore.scanner.first_walls`, in one draw of :data:`EVERY`.
    """
    found = np.zeros(len(places))
    for number, place in enumerate(places):
        offset = question.cell - place
        away = np.hypot(*offset.T)
        near = away < scanner.max_range
        offset, away = offset[near], away[near]
        turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2.0 * np.pi)
        met = distance[:, number, np.rint(N_BEAMS * turn).astype(np.int64) % N_BEAMS]
        outcome = (met > away - 0.5 * CELL).astype(np.int8) + (met > away + 0.5 * CELL)
        gain = np.maximum(outcome_gain(question.black[::EVERY][:, near], outcome), 0.0)
        by_sector = np.asarray(np.bincount(sector_of(offset), gain, N_SECTORS), np.float64)
        found[number] = by_sector[best_view(by_sector, scanner.field_of_view)[1]].sum()
    return found


def gain_at(
    question: Question, distance: NDArray[np.float32], place: Floats, scanner: Scanner
) -> tuple[NDArray[np.float32], float]:
    """Return the gain (n_draws,) of each truth by a scan from a place (2,), nats, and the best heading, radians.

    `distance` (n_draws, N_BEAMS): from there to the first wall, metres.
    """
    misfit = misfits(distance, scanner, np.random.default_rng(SEED))
    if question.is_path:
        return answer_gain(question.jury, misfit, scanner.field_of_view)
    offset = question.cell - place
    sector = np.where(np.hypot(*offset.T) < scanner.max_range + CELL, sector_of(offset), -1)
    gain, heading = cells_gain(question.jury, misfit, sector, scanner.field_of_view)
    return gain * np.float32(question.weight), heading
