"""The measurements of `step_rate`: each takes settings or burnt-in chains and returns plain numbers.

All times are CPU seconds of this thread: another process on the same core lengthens them little. What is compared
is run by turns on the same states with the same random numbers, so that a slow minute of the machine meets both.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import loops, worlds
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.kernels.step import run
from prf.model.layout import read_coloring
from prf.sampler.chain import ChainRun
from prf.sampler.target import Target

STEPS_TOGETHER = 60_000
"""Steps from each snapshot of the loops that are nearly alike."""
STEPS_FROM_SCRATCH = 1_500
REPEATS = 3
STAGES = (
    "proposal",
    "crossing check",
    "prior ratio",
    "sensors' colour",
    "beams of edges that go",
    "beams that are cut",
)
APPLICATION = "application"


def burnt_in(target: Target, n_steps: int, seed: int) -> tuple[Chain, np.random.Generator]:
    """Return a chain run from the empty map, and its generator."""
    rng = np.random.default_rng(seed)
    return worlds.advance(worlds.start(target), rng, n_steps), rng


def outcomes_by_move(outcomes: np.ndarray) -> dict[str, dict[str, float]]:
    """Return odds, shares of valid and accepted proposals, and acceptance among the valid, by move."""
    total = outcomes[:, c.PROPOSED].sum()
    table = {}
    for move, name in worlds.MOVES.items():
        proposed, valid, accepted = outcomes[move].tolist()
        table[name] = {
            "proposed": proposed,
            "share_of_steps": proposed / total,
            "valid": valid / max(proposed, 1),
            "acceptance": accepted / max(proposed, 1),
            "acceptance_if_valid": accepted / max(valid, 1),
        }
    return table


def equilibrium(chain: Chain, rng: np.random.Generator, n_steps: int, n_rounds: int = 10) -> dict[str, Any]:
    """Return steps and accepted steps per second of the sampler's kernel alone, round by round, and the move mix."""
    before = chain.outcomes.copy()
    rates = []
    for _ in range(n_rounds):
        seconds, chain = worlds.cpu(lambda: worlds.advance(chain, rng, n_steps // n_rounds))  # noqa: B023
        rates.append(n_steps // n_rounds / seconds)
    done = chain.outcomes - before
    acceptance = done[:, c.ACCEPTED].sum() / n_steps
    rate = statistics.median(rates)
    return {
        "steps": n_steps,
        "n_edges": int(chain.graph.counts[c.EDGES]),
        "steps_per_second": rate,
        "slowest_round": min(rates),
        "fastest_round": max(rates),
        "acceptance": acceptance,
        "accepted_per_second": acceptance * rate,
        "moves": outcomes_by_move(done),
    }


def with_recording(bare: Chain, target: Target, n_blocks: int) -> dict[str, float]:
    """Return the speed of a chain as `prf sample` drives it (image, draws, fresh sums) relative to its bare kernel."""
    coloring = read_coloring(bare.graph)
    sampler = ChainRun(target, np.random.default_rng(1), np.zeros(1, np.int64), coloring)
    rng = np.random.default_rng(1)
    sampler.advance()
    seconds = np.zeros(2)
    for _ in range(n_blocks):
        seconds[0] += worlds.cpu(lambda: worlds.advance(bare, rng, sampler.block))[0]
        seconds[1] += worlds.cpu(sampler.advance)[0]
    return {"block": sampler.block, "ratio_to_bare_kernel": float(seconds[0] / seconds[1])}


def state(chain: Chain) -> tuple[Any, ...]:
    """Return what two chains that decided alike have in common: counts exactly, sums but for rounding."""
    return (chain.graph.counts[: c.STEP].tolist(), chain.outcomes.tolist(), np.round(chain.graph.sums, 5).tolist())


def twins(starts: list[Chain]) -> dict[str, Any]:
    """Race the sampler against its twins: likelihood from scratch, and a static index of whole beams."""
    seconds: dict[str, list[float]] = {"sampler": [], "static": [], "scratch": []}
    same = {"static": True, "scratch": True}
    listed, slots = 0, 0
    for number, snapshot in enumerate([starts[0], *starts]):
        static = worlds.copy(snapshot)
        listed += loops.list_whole_beams(static.beams)
        slots += len(static.beams.slot_cell)
        ends = {}
        for name, loop, chain, n in (
            ("sampler", run, worlds.copy(snapshot), STEPS_TOGETHER),
            ("static", loops.run_static, static, STEPS_TOGETHER),
            ("scratch", loops.run_from_scratch, worlds.copy(snapshot), STEPS_FROM_SCRATCH),
            ("short", run, worlds.copy(snapshot), STEPS_FROM_SCRATCH),
        ):
            ends[name], spent = raced(chain, loop, n)
            if number > 0 and name != "short":  # The first start compiles.
                seconds[name].append(spent / n)
        same["static"] &= ends["static"] == ends["sampler"]
        same["scratch"] &= ends["scratch"] == ends["short"]
    return {
        "same_decisions": same,
        "listed_share": listed / slots,
        "from_scratch": ratios(seconds["scratch"], seconds["sampler"]),
        "static_index": ratios(seconds["static"], seconds["sampler"]),
    }


def raced(chain: Chain, loop: worlds.Loop, n_steps: int) -> tuple[tuple[Any, ...], float]:
    """Return the state after `n_steps` of a loop, and the CPU seconds that they took."""
    rng = np.random.default_rng(7)
    spent, chain = worlds.cpu(lambda: worlds.advance(chain, rng, n_steps, loop))
    return state(chain), spent


def ratios(slow: list[float], fast: list[float]) -> dict[str, float]:
    """Return the slow loop's rate, and the ratio over all starts with its range over single starts."""
    single = [a / b for a, b in zip(slow, fast, strict=True)]
    return {
        "steps_per_second": len(slow) / sum(slow),
        "ratio": sum(slow) / sum(fast),
        "lowest": min(single),
        "highest": max(single),
    }


def agreement(snapshot: Chain, n_proposals: int) -> dict[str, Any]:
    """Compare, proposal by proposal, the fast change of log likelihood and the touched beams with their twins."""
    static = worlds.copy(snapshot)
    loops.list_whole_beams(static.beams)
    here, there = np.random.default_rng(3), np.random.default_rng(3)
    worst, same_beams, touched = 0.0, True, 0
    for _ in range(n_proposals):
        change = loops.next_touching(snapshot, here)
        loops.next_touching(static, there)
        worst = max(worst, abs(change - loops.change_from_scratch(snapshot)))
        same_beams &= touched_beams(snapshot) == touched_beams(static)
        touched += int(snapshot.beams.n_touched[0])
    return {
        "proposals": n_proposals,
        "largest_difference": worst,
        "same_touched_beams": same_beams,
        "touched_beams_per_proposal": touched / n_proposals,
    }


def touched_beams(chain: Chain) -> list[tuple[float, ...]]:
    """Return beam, new edge and new distance of every touched beam, sorted."""
    beams = chain.beams
    n = int(beams.n_touched[0])
    columns = (beams.touched[:n], beams.touched_edge[:n], beams.touched_distance[:n])
    return sorted(zip(*(column.tolist() for column in columns), strict=True))


def stages(starts: list[Chain], n_proposals: int) -> dict[str, Any]:
    """Return the share of each stage in a step's time, as differences of loops that stop after each stage.

    The loops make the same proposals to the same maps and apply none; the whole step is the sampler's own loop from
    the same map. Of several repeats the quickest counts: what disturbs a timing only ever adds to it.
    """
    ends = np.zeros(len(STAGES) + 1)
    for number, snapshot in enumerate([starts[0], *starts]):
        best = np.full(len(ends), np.inf)
        for _ in range(REPEATS):
            for stage in range(len(STAGES)):
                chain = worlds.copy(snapshot)
                call = to_stage(chain, n_proposals, stage)
                best[stage] = min(best[stage], worlds.cpu(call)[0])
            best[-1] = min(best[-1], raced(worlds.copy(snapshot), run, n_proposals)[1])
        if number > 0:
            ends += best
    spent = np.diff(ends, prepend=0.0)
    names = (*STAGES, APPLICATION)
    return {
        "share": dict(zip(names, (spent / ends[-1]).tolist(), strict=True)),
        "microseconds_per_step": dict(zip(names, (spent / (len(starts) * n_proposals) * 1e6).tolist(), strict=True)),
    }


def to_stage(chain: Chain, n_proposals: int, stage: int) -> Callable[[], float]:
    """Return a call that makes proposals from a fixed seed and follows each up to `stage`."""
    rng = np.random.default_rng(7)
    return lambda: loops.run_to_stage(chain, rng, n_proposals, stage)


def share_touching(starts: list[Chain], n_steps: int) -> float:
    """Return the share of accepted steps that change the impact of at least one beam."""
    counts = np.zeros(2, np.int64)
    for snapshot in starts:
        loops.count_touching(worlds.copy(snapshot), np.random.default_rng(7), n_steps, counts)
    return float(counts[1] / counts[0])


def rival_moves(chain: Chain, rng: np.random.Generator, n_steps: int) -> dict[str, Any]:
    """Return the acceptance of (h) against (i) and of (e) against (j) on the map that a chain has come to.

    The four are made a fifth of all proposals each: none of their ratios depends on the odds, and the paper's (h) is
    accepted too rarely to be counted otherwise. A second run gives (e) the median displacement of (j).
    """
    rivals = [c.RECOLOR, c.LOCAL_RECOLOR, c.MOVE_INTERIOR, c.SLIDE]
    others = [move for move in range(c.N_MOVES) if move not in rivals]
    chain.move_probabilities[others] *= 0.2 / chain.move_probabilities[others].sum()
    chain.move_probabilities[rivals] = 0.2
    runs = []
    for reach in (float(chain.tuning[c.MOVE_REACH]), slide_displacement(chain)):
        chain.tuning[c.MOVE_REACH] = reach
        chain = worlds.advance(chain, rng, n_steps // 10)
        recompute_sums(chain)
        before, n_edges = chain.outcomes.copy(), []
        for _ in range(10):
            chain = worlds.advance(chain, rng, n_steps // 10)
            n_edges.append(int(chain.graph.counts[c.EDGES]))
        moves = outcomes_by_move(chain.outcomes - before)
        table = {worlds.MOVES[move]: moves[worlds.MOVES[move]] for move in rivals}
        runs.append({"move_reach": reach, "n_edges": n_edges, "steps": n_steps, "moves": table})
    return {"n_beams": len(chain.beams.ray), "runs": runs}


def slide_displacement(chain: Chain) -> float:
    """Return the median distance by which a slide displaces a vertex on the present map, metres."""
    graph = chain.graph
    length = graph.edge_length[graph.members[c.EDGES, : graph.counts[c.EDGES]]]
    stretch = np.linspace(0.5, 2.0, 301)
    return float(np.median(np.abs(stretch - 1.0)[:, None] * length[None, :]))
