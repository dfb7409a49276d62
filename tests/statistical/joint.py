"""Geweke's joint test: maps and readings drawn together, and in turn, have the same law.

In one turn, of independent trials: what a transition must not change in the mean is compared before and after it, map
by map. A thousand trials see a bias of a few thousandths. In many turns:

Marginal-conditional: a map from the prior, readings in it. Successive-conditional: from such a pair on, the sampler
moves the map given the readings, then readings are drawn anew in it, and so on. Chains of the second kind begin in the
law that they must keep, need no burn-in, and are independent: a chain's mean is the unit of the error.
Geweke (2004), Getting it right: joint distribution tests of posterior simulators.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import stats

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring
from prf.sampler.schedules import Ladder, LadderPlan
from prf.sampler.target import Target, make_chain, run_chain
from prf.sampler.tiles.rounds import make_round, make_tile_data
from prf.sampler.tiles.schedule import finish_round, work_tile
from prf.shell.cli.console import progress
from tests.driving import run_to
from tests.statistical.check import Check
from tests.statistical.means import Floats, Mean, plain_mean, z_scores
from tests.statistical.problems import Station, from_map, names
from tests.statistical.ways import LEVELS, TILES, unbounded

STEPS = 4000
"""Of a chain between two sets of readings."""
SPACING = 250
"""Of them between two offers of the prior's temperature, which take place every second time."""
LEAST_SIDE = 0.8
"""Metres: width of the narrowest tile."""
CONFIDENCE = 0.99
PLACES = np.array([[0.8, 1.2], [2.0, 2.0], [3.0, 0.9], [1.5, 3.0]])
"""Two of them on a side of the station's window."""
QUANTITIES = (
    *names(PLACES),
    "number of edges, squared",
    "length, squared",
    "mean laser return",
    "lasers without return",
    "mean sonar return",
    "sonars without return",
    "points seen black",
)


class Program(NamedTuple):
    """How the sampler moves a map.

    Attributes
    ----------
    name : str
    levels : int
        Stages in which beams are asked.
    move : callable
        Called with settings, a chain at the map, and a generator; returns the next map.
    spoil : callable
        What the sampler is given in place of the right settings; the identity unless it is a control.
    """

    name: str
    levels: int
    move: Callable[[Target, Chain, np.random.Generator], Coloring]
    spoil: Callable[[Target], Target] = lambda target: target


def changes(change: Callable[[np.random.Generator], Floats], n: int, seed: int) -> Floats:
    """Return the change of every value by a transition in independent trials, (n, number of values)."""
    return np.array([change(np.random.default_rng([seed, number])) for number in range(n)])


def z_of_changes(found: Floats) -> Floats:
    """Return the mean change over its standard error; 0 for what never changes."""
    return z_scores(plain_mean(found), Mean(np.zeros(found.shape[1]), np.zeros(found.shape[1])))


def moved_plainly(target: Target, chain: Chain, rng: np.random.Generator) -> Coloring:
    """Steps of one chain that asks all readings."""
    chain = unbounded(chain)
    recompute_sums(chain)
    return read_coloring(run_chain(chain, rng, STEPS).graph)


def moved_with_accelerators(target: Target, chain: Chain, rng: np.random.Generator) -> Coloring:
    """Steps with bounds and levels, a round of tiles, then swaps with a hot chain that has exact draws of the prior.

    No other temperature may begin anew at each set of readings: its map would remember the readings before.
    """
    chain = run_chain(chain, rng, STEPS // 4)
    data = make_tile_data(target)
    begun = make_round(data, chain, TILES, LEAST_SIDE, STEPS // 4, rng)
    chain = finish_round(data, chain, begun, [work_tile(data, begun, k) for k in range(len(begun.tiles))])
    tempering = Ladder(target, chain, rng, LadderPlan(2, lowest=0.0))
    tempering.spacing = SPACING
    return read_coloring(run_to(tempering, chain, rng, int(chain.graph.counts[c.STEP]) + STEPS // 2).graph)


PLAIN = Program("plain", 1, moved_plainly)
ACCELERATED = Program("bounds, levels, tiles, prior's temperature", LEVELS, moved_with_accelerators)


def quantities(target: Target, coloring: Coloring, chain: Chain) -> Floats:
    """Return what is compared, (len(QUANTITIES),)."""
    assert target.laser is not None
    assert target.sonar is not None
    assert target.points is not None
    shape = from_map(Draws.from_colorings([coloring]), PLACES)[0]
    read = []
    for readings, most in (
        (target.laser.readings.range, target.laser.model.max_range),
        (target.sonar.readings.range, target.sonar.model.max_range),
    ):
        read += [np.minimum(readings, most).mean(), float((readings >= most).sum())]
    sums = chain.graph.sums[[c.LOG_PRIOR, c.LOG_LIKELIHOOD]]
    return np.array([*shape, *sums, shape[0] ** 2, shape[1] ** 2, *read, target.points.readings.value.sum()])


def successive(station: Station, program: Program, n_turns: int, rng: np.random.Generator) -> Floats:
    """Return the quantities after every turn (n_turns, len(QUANTITIES)); the first is a marginal-conditional draw."""
    coloring, rows = station.draw_map(rng), []
    for _ in range(n_turns):
        target = station.read(coloring, rng)
        given = program.spoil(target).with_execution(levels=program.levels)
        chain = make_chain(given, coloring)
        # Of the settings that the sampler is given: any function of map and readings will do.
        rows.append(quantities(target, coloring, chain))
        coloring = program.move(given, chain, rng)
    return np.array(rows)


def marginal(station: Station, program: Program, n: int, rng: np.random.Generator) -> Mean:
    """Return the means over independent pairs of map and readings."""
    return plain_mean(np.concatenate([successive(station, program._replace(move=stay), 1, rng) for _ in range(n)]))


def stay(target: Target, chain: Chain, rng: np.random.Generator) -> Coloring:
    """Do not move."""
    return read_coloring(chain.graph)


class Joint(NamedTuple):
    """Both simulators, how far apart they are, and the number of chains."""

    marginal: Mean
    successive: Mean
    z: Floats
    limit: float
    n_chains: int
    seconds: float


def run_joint(station: Station, program: Program, n_chains: int, n_turns: int, n_pairs: int, seed: int) -> Joint:
    """Run both simulators. The limit holds for all quantities at once (Bonferroni), with Student's law."""
    start = time.monotonic()
    name = list(program.name.encode())
    apart = marginal(station, program, n_pairs, np.random.default_rng([seed, *name]))
    rows = []
    with progress(n_chains, f"joint test, {program.name}") as reporter:
        for number in range(n_chains):
            rng = np.random.default_rng([seed, *name, number])
            rows.append(successive(station, program, n_turns, rng)[1:].mean(axis=0))
            reporter(number + 1, chains=number + 1)
    found = plain_mean(np.array(rows))
    limit = float(stats.t.isf(0.5 * (1.0 - CONFIDENCE) / len(QUANTITIES), n_chains - 1))
    return Joint(apart, found, z_scores(found, apart), limit, n_chains, time.monotonic() - start)


def joint_check(program: Program, found: Joint, is_control: bool = False) -> Check:
    """Return the check of the largest difference."""
    worst = int(np.abs(found.z).argmax())
    return Check(
        f"{'control, ' if is_control else ''}joint test, {program.name}",
        f"largest |z| {abs(found.z[worst]):.2f} of {len(QUANTITIES)} ({QUANTITIES[worst]})",
        f"|z| < {found.limit:.2f}, {CONFIDENCE:.0%} for all at once, {found.n_chains} chains",
        bool(np.abs(found.z).max() < found.limit),
        found.seconds,
        is_control,
    )
