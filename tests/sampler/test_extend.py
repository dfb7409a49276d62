"""Runs that go on from others: their readings, windows and first maps, what is refused, and what a moved wall does."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import shapely

import prf
from prf.configuration import Configuration
from prf.model.coloring import Coloring, black_at, from_polygons, occupied_polygons
from prf.model.window import Window
from prf.output.report.page import dispute_line
from prf.output.run import Run
from prf.readings import Readings
from prf.results import RunData
from prf.results.disputes import disputes
from prf.sampler import Ensemble
from prf.sampler.continued import continued_map
from prf.sampler.extend import last_maps, prepare_extension
from prf.sampler.prepare import Prepared
from prf.shell.errors import ConfigError, InputError
from tests.driving import advance, find_starts
from tests.factories import make_run
from tests.reference.beams import Sensor, draw_readings, impacts
from tests.reference.recompute import differences

SENSOR = Sensor(30.0, noise=0.03, outlier=0.02, miss=0.02)
WINDOW = (0.0, 0.0, 10.0, 8.0)
QUICK = {"chains": 2, "threads": 1, "progress": False, "seed": 1, "resolution": 0.1}


def hall(width: float = 9.0, cupboard: float | None = None) -> Coloring:
    """A room up to x = `width`, with a cupboard at this x along its lower wall if there is one."""
    window = Window(0.0, 0.0, max(width + 1.0, 10.0), 8.0)
    free = shapely.box(1.0, 1.0, width, 7.0)
    if cupboard is not None:
        free = free.difference(shapely.box(cupboard, 0.5, cupboard + 1.0, 2.0))
    return from_polygons(shapely.box(*window).difference(free), window)


def scans(world: Coloring, places: list[tuple[float, float]], seed: int, source: str = "log") -> Readings:
    origin = np.repeat(np.array(places), 120, axis=0)
    angle = np.tile(np.linspace(-np.pi, np.pi, 120, endpoint=False), len(places))
    distance = impacts(world, origin, angle, SENSOR.max)
    readings = draw_readings(SENSOR, distance, np.random.default_rng(seed))
    number = np.repeat(np.arange(len(places)), 120)
    return Readings.from_arrays(origin, angle, readings, scan=number, source=source)


MODEL = prf.LaserModel(30.0, noise=0.03, noise_relative=0.0, outlier_probability=0.02, miss_probability=0.02)
MORNING = [(2.0, 3.0), (3.0, 4.0), (4.0, 5.0), (3.0, 2.5)]
EVENING = [(6.0, 3.0), (7.0, 4.0), (8.0, 5.0), (7.0, 2.5)]


@pytest.fixture(scope="module")
def morning() -> Run:
    return sample(scans(hall(), MORNING, 1, "morning"))


def sample(readings: Readings, steps: int = 60_000, extend: Run | None = None, **more: object) -> Run:
    settings = Configuration.of(window=WINDOW)
    sensors = MODEL if extend is None else ()
    return prf.sample(readings, sensors=sensors, config=settings, steps=steps, extend=extend, **(QUICK | more))  # type: ignore[arg-type]


def test_it_has_the_readings_of_both_and_says_where_from(morning: Run) -> None:
    evening = scans(hall(), EVENING, 2, "evening")
    run = sample(evening, extend=morning)
    assert run.laser is not None
    assert morning.laser is not None
    own = run.laser.log == 0
    np.testing.assert_array_equal(run.laser.range[own], morning.laser.range)
    assert (run.laser.log[~own] == 1).all()
    assert run.laser.scan[~own].min() == morning.laser.scan.max() + 1
    assert run.manifest["logs"] == {"laser": ["morning", "evening"]}
    assert run.manifest["extends"]["seed"] == 1
    assert run.manifest["configuration"]["noise"] == 0.03
    assert tuple(run.draws.window) == WINDOW
    assert disputes(run) == []


def test_its_first_maps_are_the_last_of_each_chain(morning: Run) -> None:
    maps = last_maps(morning, 4)
    rows = [np.flatnonzero(morning.chain == chain) for chain in (0, 1)]
    for k in (0, 1):
        np.testing.assert_array_equal(maps[k].xy, morning.draws[int(rows[k][-1])].xy)
        assert not np.array_equal(maps[2 + k].xy, maps[k].xy)


def prepared(run: RunData, readings: Readings, window: tuple[float, ...] = WINDOW, forget: bool = False) -> Prepared:
    stored = Configuration.of(**run.manifest["configuration"])
    return prepare_extension(run, stored.replace(window=window, tiles=None), readings, None, None, forget)


def test_a_map_that_nothing_contradicts_goes_on_to_the_last_bit(morning: Run) -> None:
    found = prepared(morning, scans(hall(), MORNING, 3))
    start = continued_map(found.earlier[0], found.target)
    before = occupied_polygons(found.earlier[0].coloring)
    walls = before.intersection(shapely.box(0.9, 0.9, 4.0, 7.1))
    assert shapely.area(occupied_polygons(start).symmetric_difference(before).intersection(walls.buffer(0.05))) < 0.02


def test_what_new_beams_show_of_new_ground_is_there_from_the_start() -> None:
    """A longer hall than the first window: its wall at 9 m was never there."""
    run = sample(scans(hall(), MORNING, 1))
    wide = hall(17.0)
    found = prepared(run, scans(wide, [(10.5, 3.0), (12.0, 4.0), (14.0, 5.0)], 4), (0.0, 0.0, 18.0, 8.0))
    start = continued_map(found.earlier[0], found.target)
    assert not black_at(start, found.target.laser.readings.origin).any()  # type: ignore[union-attr]
    assert shapely.dwithin(occupied_polygons(start), shapely.Point(17.0, 4.0), 0.05)
    assert not black_at(start, [[15.0, 4.0], [12.0, 6.5]]).any()
    assert found.target.seen is not None
    assert found.counts is not None


@pytest.mark.slow
def test_a_wall_that_moved_is_followed_and_named() -> None:
    """A cupboard that many scans saw is gone: the map follows the more of them, and says which log contradicts."""
    before = sample(scans(hall(cupboard=5.0), [(4.0, 4.0), (6.5, 4.0)], 1, "before"), 80_000)
    assert before.query([[5.5, 1.7]])[0] > 0.9
    after = scans(hall(), [(x, y) for x in (3.0, 4.5, 5.5, 6.5, 8.0) for y in (3.0, 4.0, 5.0)], 2, "after")
    for forget in (False, True):
        run = sample(after, 80_000, before, forget=forget)
        assert run.query([[5.5, 1.7]])[0] < 0.1
        assert ("forgotten" in run.manifest) is forget
        [dispute] = [each for each in disputes(run) if abs(each.x - 5.5) < 1.0 and each.y < 3.0][:1]
        assert dispute.log == "log 1 (before)"
        assert dispute.n_readings >= 8
        assert "contradict each other" in dispute_line(run)
        assert "log 1 (before)" in dispute_line(run)


def test_an_extended_run_resumes_as_if_never_stopped(morning: Run, tmp_path: Path) -> None:
    evening = scans(hall(), EVENING, 2, "evening")
    for name, steps in (("whole", 80_000), ("parts", 40_000)):
        sample(evening, steps, morning, output=tmp_path / name, forget=True)
    prf.resume(tmp_path / "parts", steps=80_000, threads=1, progress=False)
    whole, parts = (prf.read_run(tmp_path / name) for name in ("whole", "parts"))
    np.testing.assert_array_equal(whole.draws.xy, parts.draws.xy)
    assert parts.manifest["extends"] == whole.manifest["extends"]
    assert parts.manifest["forgotten"]["n_beams"] == 480


ERRORS = np.random.default_rng(5).normal(0.0, 0.02, (len(MORNING), 2))


@pytest.fixture(scope="module")
def posed() -> Run:
    """A run of the morning whose poses err, and were sampled."""
    shifted = scans(hall(), MORNING, 1, "morning")
    shifted = dataclasses.replace(shifted, origin=shifted.origin + ERRORS[shifted.scan])
    return sample(shifted, pose_noise=(0.03, 0.005))


@pytest.fixture(scope="module")
def let_go(posed: Run, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """What comes after it if it is let go of."""
    evening = scans(hall(), EVENING, 2, "evening")
    return sample(evening, 80_000, posed, forget=True, output=tmp_path_factory.mktemp("runs") / "whole")


def test_sampled_poses_of_both_sessions_go_on(posed: Run) -> None:
    first, off = posed, ERRORS
    run = sample(scans(hall(), EVENING, 2, "evening"), extend=first)
    assert run.trajectory is not None
    assert first.trajectory is not None
    assert run.laser is not None
    assert run.trajectory.scan.tolist() == list(range(8))
    np.testing.assert_array_equal(run.trajectory.given[:4], first.trajectory.given)
    np.testing.assert_array_equal(run.laser.origin[run.laser.log == 0], first.laser.origin)  # type: ignore[union-attr]
    assert (run.trajectory.laser == run.laser.scan).all()
    error = run.trajectory.mean[:4, :2] - run.trajectory.given[:4, :2] + off
    # Where they lie together is not known better than they were given.
    assert error.std(axis=0).max() < 0.6 * off.std(axis=0).min()
    assert first.trajectory.prior is not None
    driven = first.trajectory.prior._replace(motion=np.zeros((3, 3)))
    with pytest.raises(ConfigError, match="its poses are of odometry"):
        prepared(
            dataclasses.replace(first, trajectory=dataclasses.replace(first.trajectory, prior=driven)),
            scans(hall(), EVENING, 2),
        )


def test_sampled_poses_that_are_let_go_of_move_as_one_body(posed: Run, let_go: Run) -> None:
    """Their readings lie to each other as the mean poses had them; it errs as the mean of so many poses does."""
    found, own = let_go.trajectory, posed.placed().laser
    assert found is not None
    assert found.body is not None
    assert found.body.prior is not None
    assert own is not None
    assert let_go.laser is not None
    assert found.scan.tolist() == [4, 5, 6, 7]
    assert found.laser is not None
    np.testing.assert_array_equal(found.laser == -1, let_go.laser.log == 0)
    assert let_go.manifest["forgotten"]["n_poses"] == 4
    assert found.body.prior.noise[0, 0] == pytest.approx(0.03 / np.sqrt(4.0))
    assert 0.002 < found.body.draws[:, 0, :2].std(axis=0).max() < 0.03
    left = let_go.placed().laser.select(found.laser == -1)  # type: ignore[union-attr]
    places = [np.unique(np.round(each.origin, 6), axis=0) for each in (own, left)]
    apart = [np.hypot(*(each[:, None] - each[None]).T) for each in places]
    np.testing.assert_allclose(*apart, atol=1e-5)


@pytest.mark.parametrize("forget", [False, True])
def test_a_run_that_let_go_of_poses_goes_on(let_go: Run, forget: bool) -> None:
    """The body stays one, or takes up the poses that came after it."""
    run = sample(scans(hall(), MORNING, 3, "night"), 30_000, let_go, forget=forget)
    found, before = run.trajectory, let_go.trajectory
    assert found is not None
    assert found.body is not None
    assert before is not None
    assert before.body is not None
    assert found.scan.tolist() == list(range(8, 12) if forget else range(4, 12))
    if not forget:
        np.testing.assert_array_equal(found.body.given, before.body.given)
    assert found.body.prior.noise[0, 0] == pytest.approx(0.03 / np.sqrt(8.0 if forget else 4.0))  # type: ignore[union-attr]
    assert run.laser is not None
    assert set(run.laser.scan[run.laser.log == 2].tolist()) == {8, 9, 10, 11}


@pytest.mark.slow
def test_a_run_that_let_go_of_poses_resumes_as_if_never_stopped(posed: Run, let_go: Run, tmp_path: Path) -> None:
    sample(scans(hall(), EVENING, 2, "evening"), 40_000, posed, forget=True, output=tmp_path / "parts")
    prf.resume(tmp_path / "parts", steps=80_000, threads=1, progress=False)
    parts = prf.read_run(tmp_path / "parts")
    assert let_go.trajectory is not None
    assert parts.trajectory is not None
    np.testing.assert_array_equal(let_go.draws.xy, parts.draws.xy)
    np.testing.assert_array_equal(let_go.trajectory.draws, parts.trajectory.draws)
    np.testing.assert_array_equal(let_go.trajectory.body.draws, parts.trajectory.body.draws)  # type: ignore[union-attr]


def test_what_a_body_adds_up_is_that_of_map_and_poses(posed: Run) -> None:
    """After turns of the map and of poses, its own among them, all that is kept agrees with the slow twins."""
    found = prepared(posed, scans(hall(), EVENING, 2), forget=True)
    ensemble = Ensemble(found.target, np.random.default_rng(3).spawn(1), earlier=found.earlier[:1])
    find_starts(ensemble)
    advance(ensemble)
    [run] = ensemble.chains
    assert run.poses is not None
    assert (run.poses.state.pose[0] != found.target.poses.start[0]).all()  # type: ignore[union-attr]
    assert differences(run.chain) == []


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"noise": 0.05}, "noise 0.05: the run to extend has 0.03"),
        ({"scale": 0.2}, "scale 0.2: the run to extend has 0.1"),
        ({"pose_noise": (0.1, 0.1)}, "pose_noise"),
        ({"frame": "odom"}, "frame odom: the run to extend has None"),
        ({"window": (0.0, 0.0, 5.0, 8.0)}, "must hold the run's, 0 0 10 8"),
    ],
)
def test_other_settings_than_its_own_are_refused(morning: Run, settings: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        prf.sample(scans(hall(), EVENING, 2), config=Configuration.of(**settings), steps=1, extend=morning, **QUICK)


def test_runs_that_cannot_be_gone_on_from() -> None:
    readings, run = scans(hall(), EVENING, 2), make_run(n_draws=0)
    with pytest.raises(InputError, match="no draws yet to go on from"):
        prepare_extension(run, Configuration(), readings, None, None)
    bare = dataclasses.replace(make_run(), laser=None)
    with pytest.raises(InputError, match=r"readings\.npz"):
        prepare_extension(bare, Configuration(), readings, None, None)
