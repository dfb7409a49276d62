"""Every move of the sampler on random maps, its ratio held to the slow reference and to the ratio of its way back.

``python -m tests.reference.hastings STATES SEED`` prints what was found as JSON, for checks of altered sources in a
process of their own (with NUMBA_DISABLE_JIT=1 the kernels need no compilation).
"""

from __future__ import annotations

import copy
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import prf
from prf.kernels import constants as c
from prf.kernels._jit import core_entry
from prf.kernels.accept import accept, log_proposal_ratio
from prf.kernels.moves.square import SQUARE_SHARE
from prf.kernels.state.chain import Chain, apply
from prf.kernels.state.crossing import is_valid
from prf.kernels.state.free_space import black_change
from prf.kernels.state.prior import log_prior_change
from prf.kernels.state.proposal import N_LOOP, N_NEW_EDGES, N_OLD_EDGES
from prf.kernels.state.targets import Targets
from prf.kernels.step import propose, run
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at, violations
from prf.model.layout import grow, make_targets, read_coloring
from prf.model.orientation import Orientation
from prf.model.window import Window
from prf.sampler.target import Execution, Target, Tuning, make_chain
from tests.reference.plain_map import anchor_changes, plain_map
from tests.reference.proposals import REVERSE, Plan, log_acceptance_ratio, log_proposal_density
from tests.reference.scripted import SCRIPTS, scripted

TOLERANCE = 1e-9
NAMES = (
    "triangle birth",
    "triangle death",
    "boundary birth",
    "boundary death",
    "corner birth",
    "corner death",
    "split",
    "merge",
    "move interior",
    "move boundary",
    "past corner",
    "recolor",
    "local recolor",
    "slide",
    "cut wall",
    "mend wall",
    "join wall",
    "part wall",
    "dock",
    "undock",
    "notch",
    "fill",
    "bend",
    "unbend",
    "box birth",
    "box death",
)
N_TARGETS = 40
SQUARES = 30
"""Squares along the longer side of the window: some targets are near one another, some are not."""
TRIES = 50
WALL_TRIES = 600
"""Attempts at a move in one state, until one is valid; at those with many corners, of which few are."""
SMALL_TRIES = 12
"""The same in the smallest maps, in which many moves are never valid."""
SMALL_CASES = 2
"""Cases whose smallest maps are examined."""
N_BETWEEN, N_ANYWHERE = 24, 8
"""Places at which colours are compared before and after a move."""

CASES = (
    Target(Window(0.0, 0.0, 1.0, 1.0), 1.0, tuning=Tuning(cut_reach=0.03), execution=Execution(cell=0.2)),
    Target(
        Window(3.0, -1.5, 5.0, -0.5),
        0.7,
        orientation=Orientation(1.3, 0.4),
        free_space=0.9,
        tuning=Tuning(local_share=0.5, birth_reach=0.4, split_reach=0.1, cut_reach=0.02),
        execution=Execution(cell=0.07),
    ),
    Target(Window(-0.5, 10.0, 0.5, 13.0), 0.5, tuning=Tuning(local_share=0.9, move_reach=0.2)),
    Target(
        Window(-5.0, -5.0, 5.0, 5.0),
        0.12,
        orientation=Orientation(4.0, 1.5),
        tuning=Tuning(cut_reach=0.3),
        execution=Execution(cell=1.7),
    ),
    Target(
        Window(0.0, 0.0, 1.5, 1.0), 1.1, tuning=Tuning(birth_reach=0.02, cut_reach=0.01), execution=Execution(cell=0.05)
    ),
)


@core_entry
def attempt(chain: Chain, move: int, rng: np.random.Generator) -> tuple[bool, bool, bool, float]:
    """Propose, and apply what is valid; return (legal, valid, whether `accept` decides by log R, log R)."""
    graph, proposal = chain.graph, chain.proposal
    legal, log_forward, log_reverse = propose(chain, move, rng)
    if not legal or not is_valid(graph, chain.edge_index, proposal):
        return legal, False, True, -math.inf
    prior = log_prior_change(graph, proposal, chain.density[c.SCALE], chain.lines)
    if chain.density[c.FREE_SPACE] > 0.0:
        prior -= chain.density[c.FREE_SPACE] * black_change(graph, chain.edge_index, proposal)
    ratio = prior + log_proposal_ratio(chain.move_probabilities, move, log_forward, log_reverse)
    middle = max(ratio, -1e300)
    margin = TOLERANCE * max(1.0, abs(middle))
    decided = True
    for side in (-1, 1):
        accepted = accept(chain, move, log_forward, log_reverse, middle + side * margin, rng)[0]
        decided = decided and accepted == (side < 0 and ratio == middle)
    if ratio == middle:
        apply(chain, prior, 0.0)
    return True, True, decided, ratio


@dataclass
class Findings:
    """What attempts at one move showed."""

    illegal: int = 0
    refused: int = 0
    valid: int = 0
    one_way: int = 0
    reference_error: float = 0.0
    antisymmetry_error: float = 0.0
    problems: list[str] = field(default_factory=list)


class Lab(NamedTuple):
    """Settings, move probabilities that differ, targets, and what they mean to the reference."""

    target: Target
    plan: Plan
    targets: Targets

    def chain_at(self, coloring: Coloring) -> Chain:
        chain = make_chain(self.target, coloring)._replace(
            move_probabilities=self.plan.move_probabilities, targets=self.targets
        )
        chain.tuning[c.AIMED_SHARE] = self.plan.aimed
        return chain


def make_lab(target: Target, rng: np.random.Generator) -> Lab:
    """Move probabilities and targets at random; three births of five are aimed."""
    chain = make_chain(target, Coloring.empty(target.window))
    move_probabilities = rng.dirichlet(np.full(c.N_MOVES, 4.0))
    names = (c.BIRTH_REACH, c.SPLIT_REACH, c.MOVE_REACH, c.CUT_REACH, c.JOIN_REACH)
    reaches = [float(chain.tuning[k]) for k in names]
    window = target.window
    points = rng.uniform(window[:2], window[2:], (N_TARGETS, 2))
    targets = make_targets(window, max(window.width, window.height) / SQUARES, points)
    weight = np.cumsum(rng.exponential(size=len(targets.cell)))
    targets.cumulative[:] = weight / weight[-1]
    plan = Plan(target.scale, target.tuning.local_share, *reaches, move_probabilities, chain.edge_index.grid)
    aimed = plan._replace(
        aimed=0.6,
        aim_reach=float(chain.tuning[c.AIM_REACH]),
        target_grid=targets.grid,
        targets=shares_of(targets),
        orientation=target.orientation,
        square_share=0.0 if target.orientation.is_plain else SQUARE_SHARE,
        free_space=target.free_space,
    )
    return Lab(target, aimed, targets)


def shares_of(targets: Targets) -> dict[tuple[int, int], float]:
    """Return the probability of every square, by column and row."""
    shares = np.diff(targets.cumulative, prepend=0.0).tolist()
    return {
        (cell % targets.grid.nx, cell // targets.grid.nx): share
        for cell, share in zip(targets.cell.tolist(), shares, strict=True)
    }


def tries(move: int) -> int:
    return WALL_TRIES if move >= c.CUT_WALL else TRIES


def states(lab: Lab, n: int, rng: np.random.Generator) -> Iterator[Chain]:
    """Yield chains at exact draws of 5 to 40 edges that made some steps, and some births and changes of walls more."""
    target = lab.target
    draws = [d for d in exact_draws(target.scale, target.window, 5 * n, rng) if 5 <= d.n_edges <= 40]
    for draw in draws[:n]:
        chain = lab.chain_at(draw)
        while not run(chain, rng, 50):
            chain = grow(chain)
        for move in (
            c.TRIANGLE_BIRTH,
            c.TRIANGLE_BIRTH,
            c.BOUNDARY_BIRTH,
            c.CORNER_BIRTH,
            c.CUT_WALL,
            c.NOTCH,
            c.JOIN_WALL,
            c.DOCK,
            c.NOTCH,
            c.NOTCH,
            c.BOX_BIRTH,
        ):
            for _ in range(tries(move)):
                chain = with_room(chain)
                if attempt(chain, move, rng)[3] > -math.inf:
                    break
        yield with_room(chain)


def small_states(lab: Lab, rng: np.random.Generator) -> Iterator[Chain]:
    """Yield the empty map, those that one birth makes of it, and these with an edge split."""
    empty = lab.chain_at(Coloring.empty(lab.target.window))
    yield empty
    for birth in (c.TRIANGLE_BIRTH, c.BOUNDARY_BIRTH, c.CORNER_BIRTH):
        chain = copy.deepcopy(empty)
        for move in (birth, c.SPLIT):
            while attempt(chain, move, rng)[3] == -math.inf:
                pass
            yield copy.deepcopy(chain)


def with_room(chain: Chain) -> Chain:
    return grow(chain) if chain.graph.counts[c.NEEDS_ROOM] else chain


def proposed_coloring(chain: Chain) -> Coloring:
    """The map that the chain's proposal would make of its map, which it has not become; anchor by the reference."""
    graph, proposal = chain.graph, chain.proposal
    gone = proposal.old_edges[: proposal.counts[N_OLD_EDGES]]
    stay = np.setdiff1d(graph.members[c.EDGES, : graph.counts[c.EDGES]], gone)
    edges = np.concatenate([graph.edge_vertices[stay], proposal.new_edges[: proposal.counts[N_NEW_EDGES]]])
    slots, number = np.unique(edges, return_inverse=True)
    x = read_coloring(graph)
    y = Coloring(
        x.window,
        graph.vertex_xy[slots],
        graph.vertex_side[slots].astype(np.int8),
        number.reshape(-1, 2).astype(np.int32),
        x.anchor_black,
    )
    return y._replace(anchor_black=x.anchor_black ^ anchor_changes(plain_map(x), plain_map(y)))


def relative_error(found: float, expected: float) -> float:
    if found == expected:
        return 0.0
    error = abs(found - expected) / max(1.0, abs(expected))
    return math.inf if math.isnan(error) else error


def is_same_map(a: Coloring, b: Coloring) -> bool:
    """Whether two maps agree but for rounding."""
    if (a.n_edges, a.n_vertices, a.anchor_black) != (b.n_edges, b.n_vertices, b.anchor_black):
        return False
    first = a.segments()[:, None]
    second = np.stack([b.segments(), b.segments()[:, [2, 3, 0, 1]]])
    same = (np.abs(first - second[:, None]) < 1e-9 * max(a.window.width, a.window.height)).all(axis=-1).any(axis=0)
    return bool(same.any(axis=0).all() and same.any(axis=1).all())


def log_ratio_back(lab: Lab, move: int, x: Coloring, y: Coloring) -> float:
    """Log R(y -> x) of a chain built at y whose reverse move is made to propose x; nan if that cannot be done."""
    back = REVERSE.get(move, move)
    chain = lab.chain_at(y)
    for numbers in SCRIPTS[back](chain, plain_map(y), plain_map(x), lab.plan):
        trial = copy.deepcopy(chain)
        _, is_proposed, _, ratio = attempt(trial, back, scripted(numbers))
        if is_proposed and is_same_map(read_coloring(trial.graph), x):
            return ratio
    return math.nan


def check_valid(lab: Lab, move: int, x: Coloring, chain: Chain, ratio: float, found: Findings) -> None:
    """Hold an applied proposal to the rules of a map, to the reference and to its way back."""
    y = read_coloring(chain.graph)
    found.problems += violations(y)
    if not is_loop_round_change(chain, x, y):
        found.problems.append("the loop does not enclose what changes its colour")
    error = relative_error(ratio, log_acceptance_ratio(move, x, y, lab.plan))
    found.reference_error = max(found.reference_error, error)
    error = relative_error(-log_ratio_back(lab, move, x, y), ratio)
    found.antisymmetry_error = max(found.antisymmetry_error, error)


def is_loop_round_change(chain: Chain, x: Coloring, y: Coloring) -> bool:
    """Whether the loop of an applied proposal encloses the places whose colour differs between x and y, and no others.

    Places are drawn between corners of the loop and ends of what goes and comes, and in the whole window.
    """
    loop = chain.proposal.loop[: chain.proposal.counts[N_LOOP]]
    changed = {*map(tuple, x.segments())} ^ {*map(tuple, y.segments())}
    corners = np.concatenate([loop, np.array(sorted(changed)).reshape(-1, 2)])
    rng = np.random.default_rng(len(corners))
    between = (0.99 * rng.dirichlet(np.full(len(corners), 0.3), N_BETWEEN) + 0.01 / len(corners)) @ corners
    places = np.concatenate([between, rng.uniform(x.window[:2], x.window[2:], (N_ANYWHERE, 2))])
    return bool((black_at(x, places) ^ black_at(y, places) == is_inside(loop, places)).all())


def is_inside(loop: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each place (n, 2) has an odd number of the loop's sides to its right."""
    (ax, ay), (bx, by) = loop.T[:, :, None], np.roll(loop, -1, axis=0).T[:, :, None]
    x, y = places.T
    straddles = (ay > y) != (by > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = ax + (y - ay) / (by - ay) * (bx - ax)
    return np.asarray(np.count_nonzero(straddles & (crossing > x), axis=0) % 2 == 1)


def check_unapplied(lab: Lab, move: int, x: Coloring, chain: Chain, valid: bool, found: Findings) -> None:
    """A refused map crosses itself; a valid one with R = 0 has no way back."""
    y = proposed_coloring(chain)
    broken = violations(y)
    if valid:
        found.one_way += 1
        found.problems += broken
        if log_proposal_density(move, y, x, lab.plan) != -math.inf:
            found.problems.append("R = 0 although there is a way back")
    else:
        found.refused += 1
        if not any("cross or touch" in line for line in broken):
            found.problems.append(f"refused without a crossing: {broken}")


def try_move(
    lab: Lab, move: int, start: Chain, rng: np.random.Generator, found: Findings, most: int | None = None
) -> None:
    """Attempt one move from the same state until it is applied, so many times at most (default: by the move)."""
    x = read_coloring(start.graph)
    chain = copy.deepcopy(start)
    for _ in range(most or tries(move)):
        legal, valid, decided, ratio = attempt(chain, move, rng)
        if not decided:
            found.problems.append(f"`accept` does not decide by log R = {ratio}")
        if not legal:
            found.illegal += 1
        elif ratio == -math.inf:
            check_unapplied(lab, move, x, chain, valid, found)
        else:
            found.valid += 1
            return check_valid(lab, move, x, chain, ratio, found)
    return None


def examine(n_states: int, seed: int) -> dict[str, Findings]:
    """Attempt every move in `n_states` states of each case."""
    rng = np.random.default_rng(seed)
    findings = {name: Findings() for name in NAMES}
    for number, target in enumerate(CASES):
        lab = make_lab(target, rng)
        for chain in states(lab, n_states, rng):
            for move, name in enumerate(NAMES):
                try_move(lab, move, chain, rng, findings[name])
        apart = np.random.default_rng(seed)
        for chain in small_states(lab, apart) if number < SMALL_CASES else ():
            for move, name in enumerate(NAMES):
                try_move(lab, move, chain, apart, findings[name], SMALL_TRIES)
    return findings


if __name__ == "__main__":
    found = examine(int(sys.argv[1]), int(sys.argv[2]))
    print(json.dumps({"package": prf.__file__, "moves": {name: asdict(move) for name, move in found.items()}}))
