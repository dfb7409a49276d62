"""Maps made by hand, chains at them, and what a move does there with numbers that are given."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Sequence

import numpy as np

from prf.kernels.state.chain import Chain
from prf.model.coloring import Coloring
from prf.model.layout import make_targets, read_coloring
from prf.model.window import INTERIOR, Window
from prf.sampler.target import Execution, Target, Tuning
from tests.reference.hastings import Lab, attempt, is_same_map, make_lab, shares_of
from tests.reference.plain_map import Point, plain_map
from tests.reference.scripted import SCRIPTS, scripted

REACH = 0.125
"""Median of the reaches of corners from the walls that they are led to: so much is drawn where numbers are 1/2."""
LISTED = 7
"""Number of the list of edges that was made last, before a move makes its own."""


def lab_at(
    window: Window,
    cell: float,
    *,
    local_share: float = 0.8,
    aimed: float = 0.0,
    side: float = 0.1,
    returns: Sequence[Point] = (),
) -> Lab:
    """Settings with cells of side `cell`, and squares of side `side` round the returns, at which births are aimed."""
    target = Target(
        window,
        1.0,
        tuning=Tuning(local_share=local_share, cut_reach=REACH, join_reach=REACH),
        execution=Execution(cell=cell),
    )
    lab = make_lab(target, np.random.default_rng(4))
    targets = make_targets(window, side, np.array(returns).reshape(-1, 2))
    shares = shares_of(targets)
    return Lab(target, lab.plan._replace(aimed=aimed, target_grid=targets.grid, targets=shares), targets)


def drawn(window: Window, *lines: Sequence[Point], black: bool = False) -> Coloring:
    """Return the map of these lines: open ones from border to border, closed ones end where they begin."""
    points = list(dict.fromkeys(point for line in lines for point in line))
    pairs = [(points.index(a), points.index(b)) for line in lines for a, b in itertools.pairwise(line)]
    sides = [side_of(window, point) for point in points]
    return Coloring(window, np.array(points), np.array(sides, np.int8), np.array(pairs, np.int32), black)


def side_of(window: Window, point: Point) -> int:
    on = [point[1 - side % 2] == window.side_coordinate(side) for side in range(4)]
    return on.index(True) if any(on) else INTERIOR


def chain_listed(lab: Lab, x: Coloring) -> Chain:
    """Return a chain at x in which every edge carries the mark of the list before the last."""
    chain = lab.chain_at(x)
    chain.edge_index.mark[0] = LISTED
    chain.edge_index.marks[:] = LISTED - 1
    return chain


def log_ratio(lab: Lab, move: int, x: Coloring, y: Coloring) -> float:
    """Log R of the move that is made to lead from x to y; nan if it cannot be made to, -inf if it has no way back."""
    chain, found = chain_listed(lab, x), math.nan
    for numbers in SCRIPTS[move](chain, plain_map(x), plain_map(y), lab.plan):
        trial = copy.deepcopy(chain)
        legal, valid, _, ratio = attempt(trial, move, scripted(numbers))
        if ratio > -math.inf and is_same_map(read_coloring(trial.graph), y):
            return ratio
        found = ratio if legal and valid else found
    return found


def is_legal(lab: Lab, move: int, x: Coloring, numbers: Sequence[float]) -> bool:
    return attempt(chain_listed(lab, x), move, scripted(numbers))[0]
