"""Geweke's joint test: maps and readings drawn together, and in turn, have the same law.

Marginal-conditional: a map from the prior, readings in it. Successive-conditional: from such a pair on, the sampler
moves the map given the readings, then readings are drawn anew in it, and so on. Chains of the second kind begin in the
law that they must keep, need no burn-in, and are independent: a chain's mean is the unit of the error.
Geweke (2004), Getting it right: joint distribution tests of posterior simulators.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring, run_chain
from prf.sampler.posterior import Settings, make_chain
from prf.sampler.tempering import LadderPlan, Tempering
from prf.sampler.tiles.rounds import make_round, make_tile_data
from prf.sampler.tiles.tiled import finish_round, work_tile
from prf.shell.cli.progress import progress
from tests.verify.check import Check
from tests.verify.problems import from_map, names
from tests.verify.station import Station
from tests.verify.ways import LEVELS, TILES, unbounded

Floats = NDArray[np.float64]

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
    move: Callable[[Settings, Chain, np.random.Generator], Coloring]
    spoil: Callable[[Settings], Settings] = lambda settings: settings


class Means(NamedTuple):
    """Means of the quantities, their standard errors, and the number of independent units behind them."""

    mean: Floats
    error: Floats
    n: int


def moved_plainly(settings: Settings, chain: Chain, rng: np.random.Generator) -> Coloring:
    """Steps of one chain that asks all readings."""
    chain = unbounded(chain)
    recompute_sums(chain)
    return read_coloring(run_chain(chain, rng, STEPS).graph)


def moved_with_accelerators(settings: Settings, chain: Chain, rng: np.random.Generator) -> Coloring:
    """Steps with bounds and levels, a round of tiles, then swaps with a hot chain that has exact draws of the prior.

    No other temperature may begin anew at each set of readings: its map would remember the readings before.
    """
    chain = run_chain(chain, rng, STEPS // 4)
    data = make_tile_data(settings)
    begun = make_round(data, chain, TILES, LEAST_SIDE, STEPS // 4, rng)
    chain = finish_round(data, chain, begun, [work_tile(data, begun, k) for k in range(len(begun.tiles))])
    tempering = Tempering(settings, chain, rng, LadderPlan(2, lowest=0.0))
    tempering.spacing = SPACING
    return read_coloring(tempering.run_to(chain, rng, int(chain.graph.counts[c.STEP]) + STEPS // 2).graph)


PLAIN = Program("plain", 1, moved_plainly)
ACCELERATED = Program("bounds, levels, tiles, prior's temperature", LEVELS, moved_with_accelerators)


def quantities(settings: Settings, coloring: Coloring, chain: Chain) -> Floats:
    """Return what is compared, (len(QUANTITIES),)."""
    assert settings.laser is not None
    assert settings.sonar is not None
    assert settings.points is not None
    shape = from_map(Draws.from_colorings([coloring]), PLACES)[0]
    read = []
    for readings, most in (
        (settings.laser.readings.range, settings.laser.model.max_range),
        (settings.sonar.readings.range, settings.sonar.model.max_range),
    ):
        read += [np.minimum(readings, most).mean(), float((readings >= most).sum())]
    sums = chain.graph.sums[[c.LOG_PRIOR, c.LOG_LIKELIHOOD]]
    return np.array([*shape, *sums, shape[0] ** 2, shape[1] ** 2, *read, settings.points.table.value.sum()])


def successive(station: Station, program: Program, n_turns: int, rng: np.random.Generator) -> Floats:
    """Return the quantities after every turn (n_turns, len(QUANTITIES)); the first is a marginal-conditional draw."""
    coloring, rows = station.draw_map(rng), []
    for _ in range(n_turns):
        settings = station.read(coloring, rng)
        given = dataclasses.replace(program.spoil(settings), levels=program.levels)
        chain = make_chain(given, coloring)
        # Of the settings that the sampler is given: any function of map and readings will do.
        rows.append(quantities(settings, coloring, chain))
        coloring = program.move(given, chain, rng)
    return np.array(rows)


def marginal(station: Station, program: Program, n: int, rng: np.random.Generator) -> Means:
    """Return the means over independent pairs of map and readings."""
    rows = np.concatenate([successive(station, program._replace(move=stay), 1, rng) for _ in range(n)])
    return Means(rows.mean(axis=0), rows.std(axis=0, ddof=1) / np.sqrt(n), n)


def stay(settings: Settings, chain: Chain, rng: np.random.Generator) -> Coloring:
    """Do not move."""
    return read_coloring(chain.graph)


def z_scores(first: Means, second: Means) -> Floats:
    """Return the difference of two means over its standard error; 0 where neither varies."""
    error = np.hypot(first.error, second.error)
    return np.divide(second.mean - first.mean, error, out=np.zeros(len(error)), where=error > 0.0)


class Joint(NamedTuple):
    """Both simulators, and how far apart they are."""

    marginal: Means
    successive: Means
    z: Floats
    limit: float
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
            reporter.update(number + 1, chains=number + 1)
    means = np.array(rows)
    found = Means(means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(n_chains), n_chains)
    limit = float(stats.t.isf(0.5 * (1.0 - CONFIDENCE) / len(QUANTITIES), n_chains - 1))
    return Joint(apart, found, z_scores(apart, found), limit, time.monotonic() - start)


def joint_check(program: Program, found: Joint, is_control: bool = False) -> Check:
    """Return the check of the largest difference."""
    worst = int(np.abs(found.z).argmax())
    return Check(
        f"{'control, ' if is_control else ''}joint test, {program.name}",
        f"largest |z| {abs(found.z[worst]):.2f} of {len(QUANTITIES)} ({QUANTITIES[worst]})",
        f"|z| < {found.limit:.2f}, {CONFIDENCE:.0%} for all at once, {found.successive.n} chains",
        bool(np.abs(found.z).max() < found.limit),
        found.seconds,
        is_control,
    )
