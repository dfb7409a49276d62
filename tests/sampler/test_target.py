"""Settings and the state that a chain starts from; and the chain as compiled and as plain Python."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.step import run
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring
from prf.model.layout import grow, read_coloring
from prf.model.window import Window
from prf.sampler.target import (
    Execution,
    LaserData,
    SonarData,
    Target,
    Tuning,
    laser_data,
    make_chain,
    one_colour_map,
    point_data,
)
from tests.reference.arak_laws import log_density
from tests.reference.beams import Sensor, log_likelihoods_in
from tests.reference.chain_state import digest, structural_faults
from tests.reference.recompute import differences
from tests.reference.slow_points import Flips, Normal, lattice, observe
from tests.reference.slow_points import log_likelihood as point_log_likelihood
from tests.reference.slow_sonar import Cone, Ring, features, reach_in
from tests.reference.slow_sonar import log_likelihood as sonar_log_likelihood
from tests.reference.sonar_worlds import draw_data, draw_sonar_world, ring_all_round
from tests.reference.worlds import draw_world
from tests.sampler.frames import first, maps_of, means_of, mirrored, reordered, scaled, shifted, turned

UNIT = Window(0.0, 0.0, 1.0, 1.0)
ROOM = Window(0.0, 0.0, 10.0, 10.0)
NEAR = Sensor(6.0)


def scattered() -> np.ndarray:
    return np.random.default_rng(12).uniform(0.0, 10.0, (40, 2))


def short_runs() -> dict[str, dict[str, str]]:
    """Digests of chains with few readings, and of one without: all that a step reads and writes."""
    found = {}
    for name, seed, at_truth in (("from white", 1, False), ("from the truth", 2, True)):
        world = draw_world(0.2, ROOM, NEAR, 2, 12, np.random.default_rng(seed))
        start = world.coloring if at_truth else Coloring.empty(ROOM)
        chain = make_chain(Target(ROOM, 0.2, world.data, execution=Execution(resolution=1.0, cell=1.0)), start)
        rng = np.random.default_rng(seed)
        for until in (700, 1400):
            while not run(chain, rng, until):
                chain = grow(chain)
            recompute_sums(chain)
        found[name] = digest(chain, rng)
    for name, laser in (("sonar", None), ("laser and sonar", world.data)):
        rng = np.random.default_rng(4)
        sonar = draw_data(world.coloring, Ring(), ring_all_round(world.data.readings.origin[::12], 8, 0.5, rng), rng)
        start = world.coloring if laser else Coloring.empty(ROOM)
        chain = make_chain(Target(ROOM, 0.2, laser, sonar=sonar, execution=Execution(resolution=1.0, cell=1.0)), start)
        for until in (400, 800):
            while not run(chain, rng, until):
                chain = grow(chain)
            recompute_sums(chain)
        found[name] = digest(chain, rng)
    for name, laser, places in (("points", None, lattice(6, 0.0, 10.0)), ("laser and points", world.data, scattered())):
        rng = np.random.default_rng(5)
        points = observe(world.coloring, Normal(), places, rng)
        chain = make_chain(Target(ROOM, 0.2, laser, points=points, execution=Execution(cell=1.0)), Coloring.empty(ROOM))
        for until in (700, 1400):
            while not run(chain, rng, until):
                chain = grow(chain)
            recompute_sums(chain)
        found[name] = digest(chain, rng)
    chain, rng = make_chain(Target(UNIT, 1.0), exact_draws(1.0, UNIT, 1, np.random.default_rng(3))[0]), None
    rng = np.random.default_rng(3)
    run(chain, rng, 2000)
    found["prior"] = digest(chain, rng)
    return found


@pytest.mark.slow
def test_the_compiled_chain_is_that_of_plain_python_bit_for_bit(project_root: Path) -> None:
    code = "import json; from tests.sampler.test_target import short_runs; print(json.dumps(short_runs()))"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(project_root)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert json.loads(done.stdout) == short_runs()


def test_every_move_is_made() -> None:
    assert make_chain(Target(UNIT, 1.0), Coloring.empty(UNIT)).move_probabilities.sum() == pytest.approx(1.0)
    assert min(weight for _, weight in (*c.MOVES, *c.WALL_MOVES)) > 0.0


def test_moves_are_chosen_with_their_probabilities() -> None:
    chain = make_chain(Target(UNIT, 1.0), Coloring.empty(UNIT))
    n = 200_000
    run(chain, np.random.default_rng(4), n)
    weights = np.array([weight for _, weight in c.MOVES[: c.BOX_BIRTH]])
    share = weights / weights.sum()
    z = (chain.outcomes[: c.BOX_BIRTH, c.PROPOSED] / n - share) / np.sqrt(share * (1.0 - share) / n)
    assert np.abs(z).max() < 4.5, z
    assert chain.outcomes[c.BOX_BIRTH :, c.PROPOSED].sum() == 0, "boxes are for those who prefer directions"


def test_tuning_follows_the_scale_unless_it_is_given() -> None:
    which = [c.LOCAL_SHARE, c.BIRTH_REACH, c.SPLIT_REACH, c.MOVE_REACH]
    assert Tuning().array(0.5)[which] == pytest.approx([0.8, 0.2, 0.04, 0.02])
    given = Tuning(local_share=0.1, birth_reach=1.0, split_reach=2.0, move_reach=3.0)
    assert given.array(0.5)[which] == pytest.approx([0.1, 1.0, 2.0, 3.0])


def test_cells_follow_the_scale_but_never_number_millions() -> None:
    world = draw_world(0.2, ROOM, NEAR, 1, 4, np.random.default_rng(5))
    assert Target(ROOM, 0.1).cell_size() == pytest.approx(1.0)
    assert Target(ROOM, 0.1, world.data).cell_size() == pytest.approx(0.4)
    assert Target(ROOM, 0.1, world.data, execution=Execution(cell=2.5)).cell_size() == 2.5
    assert Target(Window(0.0, 0.0, 4000.0, 10.0), 1.0).cell_size() == pytest.approx(4.0)


@pytest.mark.parametrize("at_truth", [False, True], ids=["from white", "from the truth"])
def test_the_start_has_the_sums_of_the_written_model(at_truth: bool) -> None:
    """Prior by its own function, likelihood by shapely and scipy."""
    world = draw_world(0.3, ROOM, NEAR, 3, 40, np.random.default_rng(6))
    start = world.coloring if at_truth else Coloring.empty(ROOM)
    chain = make_chain(Target(ROOM, 0.3, world.data, execution=Execution(resolution=0.5)), start)
    expected = slow_laser_sum(start, world.data)
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(expected, rel=1e-9)
    assert chain.graph.sums[c.LOG_PRIOR] == pytest.approx(log_density(start, 0.3), rel=1e-12, abs=1e-12)
    assert chain.graph.sums[c.TOTAL_LENGTH] == pytest.approx(start.total_length())
    assert differences(chain) == structural_faults(chain) == []
    assert len(chain.sensors.xy) == 3
    assert chain.graph.counts[c.STEP] == chain.graph.counts[c.NEEDS_ROOM] == 0


def test_the_sums_of_a_run_are_those_of_the_written_model() -> None:
    """After 30,000 steps on readings, from the map alone."""
    world = draw_world(0.3, ROOM, NEAR, 3, 40, np.random.default_rng(7))
    chain = make_chain(Target(ROOM, 0.3, world.data), Coloring.empty(ROOM))
    rng = np.random.default_rng(7)
    while not run(chain, rng, 30_000):
        chain = grow(chain)
    coloring = read_coloring(chain.graph)
    expected = slow_laser_sum(coloring, world.data)
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(expected, rel=1e-8)
    assert chain.graph.sums[c.LOG_PRIOR] == pytest.approx(log_density(coloring, 0.3), rel=1e-9)
    assert expected > 1.2 * len(world.data.readings.range) * math.log(0.95)


def slow_laser_sum(coloring: Coloring, laser: LaserData) -> float:
    return sum(log_likelihoods_in(coloring, NEAR, laser.readings.origin, laser.readings.angle, laser.readings.range))


def slow_sonar_sum(coloring: Coloring, ring: Ring, sonar: SonarData) -> float:
    cones = [
        Cone(*row)
        for row in np.column_stack([sonar.readings.origin, sonar.readings.angle, sonar.readings.cone]).tolist()
    ]
    reach = [reach_in(coloring.window, cone, ring.max) for cone in cones]
    return sum(
        sonar_log_likelihood(ring, features(coloring, cone, end), reading, end)
        for cone, end, reading in zip(cones, reach, sonar.readings.range.tolist(), strict=True)
    )


def test_the_sums_of_a_run_with_sonar_are_those_of_the_written_model() -> None:
    """At the truth and after 20,000 steps from white, from the map alone; the laser's part adds to it."""
    rng = np.random.default_rng(10)
    world = draw_sonar_world(0.4, ROOM, Ring(), 3, 12, 0.5, rng)
    chain = make_chain(Target(ROOM, 0.4, sonar=world.data), world.coloring)
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(
        slow_sonar_sum(world.coloring, Ring(), world.data), rel=1e-9
    )
    assert len(chain.sensors.xy) == 3
    laser = draw_world(0.4, ROOM, NEAR, 2, 20, rng).data
    chain = make_chain(Target(ROOM, 0.4, laser, sonar=world.data), Coloring.empty(ROOM))
    assert len(chain.sensors.xy) == 5
    while not run(chain, rng, 20_000):
        chain = grow(chain)
    coloring = read_coloring(chain.graph)
    expected = slow_laser_sum(coloring, laser) + slow_sonar_sum(coloring, Ring(), world.data)
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("law", [Normal(2.0, -1.0, 1.3), Flips()], ids=["gaussian", "binary"])
@pytest.mark.parametrize("places", [lattice(9, 0.0, 10.0), scattered()], ids=["lattice", "scattered"])
def test_the_sums_of_a_run_with_points_are_those_of_the_written_model(law: Normal | Flips, places: np.ndarray) -> None:
    """At the truth and after 20,000 steps from one colour; the laser's part adds to it."""
    rng = np.random.default_rng(13)
    world = draw_world(0.3, ROOM, NEAR, 3, 20, rng)
    points = observe(world.coloring, law, places, rng)
    chain = make_chain(Target(ROOM, 0.3, points=points), world.coloring)
    expected = point_log_likelihood(world.coloring, law, points)
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(expected, rel=1e-12)
    chain = make_chain(Target(ROOM, 0.3, world.data, points=points), Coloring.empty(ROOM))
    while not run(chain, rng, 20_000):
        chain = grow(chain)
    coloring = read_coloring(chain.graph)
    expected = slow_laser_sum(coloring, world.data)
    expected += point_log_likelihood(coloring, law, points)
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(expected, rel=1e-8)


def test_the_first_map_has_the_colour_that_points_prefer_if_no_sensor_forbids() -> None:
    world = draw_world(0.2, ROOM, NEAR, 1, 4, np.random.default_rng(14))
    for value, black in ((1.0, True), (0.0, False)):
        points = point_data(scattered(), np.full(40, value), Flips().model)
        assert one_colour_map(Target(ROOM, 0.2, points=points)).anchor_black == black
        assert not one_colour_map(Target(ROOM, 0.2, world.data, points=points)).anchor_black
    assert not one_colour_map(Target(ROOM, 0.2)).anchor_black


# Readings in another order, place, direction or unit: the same posterior, where arithmetic allows the same draws.


FALSE_ALARM = 1e-3
"""Of the whole family of comparisons below."""
N_CHAINS, N_STEPS = 16, 600_000
"""Half of the steps are left out: after a hundred thousand maps still have too many edges."""


@pytest.mark.parametrize("seed", [0, 1])
def test_beams_in_another_order_give_the_same_maps_to_the_last_bit(seed):
    case = first()
    for (one, sums), (other, others) in zip(maps_of(case, 3), maps_of(reordered(case, seed), 3), strict=True):
        np.testing.assert_array_equal(one.xy, other.xy)
        np.testing.assert_array_equal(one.edges, other.edges)
        np.testing.assert_allclose(sums, others, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("shift", "metres"), [((1024.0, 2048.0), 1e-9), ((100.3, -77.7), 1e-9), ((500_000.0, 5_000_000.0), 1e-6)]
)
def test_a_log_at_another_place_gives_the_same_maps_there(shift, metres):
    case = first()
    for (one, sums), (other, others) in zip(maps_of(case, 3), maps_of(shifted(case, *shift), 3), strict=True):
        np.testing.assert_array_equal(one.edges, other.edges)
        np.testing.assert_allclose(other.xy - np.array(shift), one.xy, rtol=0, atol=metres)
        np.testing.assert_allclose(sums, others, rtol=0, atol=1e-3)


def test_a_log_that_differs_gives_other_maps():
    case = first()
    data = case.target.laser
    other = replace(
        case.target,
        laser=laser_data(data.readings.origin, data.readings.angle, data.readings.range + 1e-3, data.model),
    )
    assert not np.array_equal(maps_of(case, 1)[0][0].xy, maps_of(case._replace(target=other), 1)[0][0].xy)


@pytest.fixture(scope="module")
def known():
    return means_of(first(), N_CHAINS, N_STEPS)


def longer(case):
    """Return a case whose readings are all 2 per cent longer: not the same posterior."""
    data = case.target.laser
    laser = laser_data(data.readings.origin, data.readings.angle, 1.02 * data.readings.range, data.model)
    return case._replace(target=replace(case.target, laser=laser))


def staged(case):
    """Return a case whose beams are asked in three stages, in another order."""
    return reordered(case._replace(target=case.target.with_execution(levels=3)))


WAYS = {
    "turned": turned,
    "mirrored": mirrored,
    "twice as long": lambda case: scaled(case, 2.0),
    "in feet": lambda case: scaled(case, 1.0 / 0.3048),
    "in stages": staged,
}


def least_p(one, other):
    """Return the least p-value of Welch's tests of all means, times how many are made in the family."""
    spread = np.maximum(one.std(axis=0), other.std(axis=0)) > 1e-9
    p = stats.ttest_ind(one[:, spread], other[:, spread], equal_var=False).pvalue
    constant = np.abs(one - other)[:, ~spread].max(initial=0.0)
    return float(p.min()) * one.shape[1] * len(WAYS) if constant < 1e-9 else 0.0


@pytest.mark.slow
@pytest.mark.parametrize("way", list(WAYS))
def test_the_posterior_is_the_same_in_another_frame_or_unit(way, known):
    p = least_p(known, means_of(WAYS[way](first()), N_CHAINS, N_STEPS))
    assert p > FALSE_ALARM, f"{way}: p {p:.2g}, false alarms {FALSE_ALARM}"


@pytest.mark.slow
def test_another_posterior_is_seen(known):
    assert least_p(known, means_of(longer(first()), N_CHAINS, N_STEPS)) < FALSE_ALARM
