"""Where chains of uncertain poses start."""

from __future__ import annotations

import dataclasses
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.stats

from prf.configuration import ODOMETRY, Configuration
from prf.poses import start
from prf.poses.carried import doubtful
from prf.poses.follow import follow
from prf.poses.given import PoseErrors, given_errors, pose_noise
from prf.poses.graph import Pull, Relations, errors, pull_of, root_of
from prf.poses.loops import _settled, close_loops
from prf.poses.match import place_of, search
from prf.poses.model import Closures, PosePrior, pose_model
from prf.poses.pieces import LoopMatch, cut, gain
from prf.poses.plane import compose, seen_from, wrapped
from prf.poses.posterior import Trajectory, pose_functionals
from prf.poses.scans import scans_of
from prf.poses.start import find_start, find_trajectory
from prf.readings import Readings
from prf.sampler.ensemble import Ensemble
from prf.sampler.poses import start_apart
from prf.sampler.prepare import prepare
from prf.shell.cli.console import report_nothing
from prf.shell.cli.storage import spawn_generators
from prf.shell.errors import ConfigError, InputError
from tests.poses.drives import BLOCK, ROOM, driven_beside, odometry_of, off, readings_at, round_the_block

ROUND = np.linspace(0.0, 2.0 * np.pi, 40)
TRUTH = np.column_stack([4.2 + 2.6 * np.cos(ROUND), 2.6 + 1.9 * np.sin(ROUND), ROUND + np.pi / 2])


@pytest.mark.parametrize("noise", [(0.15, 0.03), pytest.param((0.05, 0.01), marks=pytest.mark.slow)])
def test_disturbed_poses_of_a_room_are_found_again(noise):
    given = TRUTH + np.random.default_rng(3).normal(size=TRUTH.shape) * [noise[0], *noise]
    readings = readings_at(ROOM, TRUTH, given)
    model = pose_model(readings, None, noise)
    found = find_trajectory(model, readings, 0.03)
    assert off(found, TRUTH) < off(given, TRUTH) / 3.0
    np.testing.assert_array_equal(found, find_trajectory(model, readings, 0.03))
    drawn = [find_trajectory(model, readings, 0.03, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert 0.002 < off(drawn[0], drawn[2]) < 0.1


def test_a_loop_of_odometry_is_closed():
    truth = round_the_block()
    prior = odometry_of(truth, "poor")
    readings = readings_at(BLOCK, truth, prior.draw(np.random.default_rng(4)))
    model = pose_model(readings, None, None, ODOMETRY["poor"])
    assert off(model.prior.given, truth) > 1.0
    start = find_start(model, readings, 0.03)
    assert off(start.poses, truth) < 0.1
    np.testing.assert_allclose(start.poses[0], model.prior.given[0], atol=1e-6)
    used = [loop for loop in start.loops if loop.is_used]
    errors = [seen_from(truth[loop.tail], truth[loop.head])[:2] - loop.pose[:2] for loop in used]
    assert len(used) > 3
    assert np.median(np.hypot(*np.transpose(errors))) < 0.1


JITTER = (0.55, 0.12)  # m, rad


def _start_beside(truth, driven):
    """Return the start of a drive round the block, of poses that jitter and odometry (n, 3) beside them."""
    given = truth + np.random.default_rng(1).normal(size=truth.shape) * [JITTER[0], *JITTER]
    readings = driven_beside(readings_at(BLOCK, truth, given, n_beams=60), driven)
    return find_start(pose_model(readings, None, JITTER, ODOMETRY["wheels"]), readings, 0.03)


def test_odometry_is_followed_beside_poses_that_jitter():
    """Wheels that drive farther than they say: matched with those before it, a scan shows by how much."""
    truth = round_the_block(spacing=1.0)[:40]
    steps = seen_from(truth[:-1], truth[1:]) * [0.7, 1.0, 1.0]
    start = _start_beside(truth, np.array(list(itertools.accumulate(steps, compose, initial=truth[0]))))
    assert off(start.poses, truth) < 0.35


def test_given_poses_say_where_a_robot_was_put_down():
    truth, driven = carried(round_the_block(spacing=1.0), 17, 27)
    assert off(driven, truth) > 3.0
    start = _start_beside(truth, driven)
    assert off(start.poses, truth) < 0.1
    assert start.model.prior.slipped(start.poses)[16] > 0.99
    np.testing.assert_allclose(np.mean(start.poses - truth, axis=0)[:2], 0.0, atol=3.0 * JITTER[0] / len(truth) ** 0.5)


def test_chains_start_as_all_readings_have_it_however_few_are_used():
    noise = (0.15, 0.03)
    given = TRUTH + np.random.default_rng(3).normal(size=TRUTH.shape) * [noise[0], *noise]
    config = Configuration.of(pose_noise=noise, beam_density=4.0)
    target = prepare(config, readings_at(ROOM, TRUTH, given)).target
    assert target.laser.readings.n_beams < 15 * len(TRUTH)
    model = target.poses
    drawn = [model.draw_start(np.random.default_rng(seed), 1.0, 0.0, report_nothing) for seed in (1, 2)]
    assert max(off(poses, TRUTH[model.scan]) for poses in drawn) < off(given, TRUTH) / 3.0
    assert off(*drawn) > 0.002


def test_the_pose_that_fixes_the_frame_is_the_same_for_all_chains():
    truth = round_the_block()[:12]
    prior = odometry_of(truth, "wheels")
    model = pose_model(readings_at(BLOCK, truth, prior.given), None, None, ODOMETRY["wheels"])
    start = find_start(model, readings_at(BLOCK, truth, prior.given), 0.03)
    one, other = (start.draw(np.random.default_rng(seed)) for seed in (1, 2))
    np.testing.assert_array_equal(one[0], other[0])
    assert (one[1:] != other[1:]).all()


@pytest.mark.parametrize(("noise", "related", "weight"), [(0.03, 0.0, 1.4), (0.03, 0.7, 0.35), (0.015, 0.7, 1.35)])
def test_beams_count_for_as_much_as_their_errors_are_independent(noise, related, weight):
    """The model errs by .03 m or more. Errors of correlation r^k count (1 - r) / (1 + r), at half the noise four
    times that."""
    exact = {"noise": 1e-4, "noise_relative": 0.0, "outlier_probability": 0.0, "miss_probability": 0.0}
    scans, rng = readings_at(ROOM, TRUTH, TRUTH, n_beams=180, **exact), np.random.default_rng(6)
    error = rng.standard_normal(scans.n_beams)
    for k in range(1, len(error)):
        error[k] = related * error[k - 1] + np.sqrt(1.0 - related**2) * error[k]
    scans = dataclasses.replace(scans, range=scans.range + noise * error)
    found = find_start(pose_model(scans, None, (0.05, 0.01)), scans, 0.03).independence
    np.testing.assert_allclose(found, weight, rtol=0.25)


def test_chains_start_in_pairs_on_opposite_sides_of_where_scans_agree():
    given = TRUTH + np.random.default_rng(3).normal(size=TRUTH.shape) * [0.1, 0.1, 0.02]
    target = prepare(Configuration.of(pose_noise=(0.1, 0.02)), readings_at(ROOM, TRUTH, given)).target
    chains, again = (Ensemble(target, spawn_generators(0, 3), threads=threads).chains for threads in (1, 2))
    one, other, third = (chain.poses.first for chain in chains)
    np.testing.assert_array_equal([one, other, third], [chain.poses.first for chain in again])
    assert off(0.5 * (one + other), target.poses.start) < 0.3 * off(one, other)
    assert off(one, other) > 0.002
    assert off(one, third) > 0.002
    np.testing.assert_array_equal(
        chains[1].poses.start(chains[1].chain).beams.ray.shape, chains[1].chain.beams.ray.shape
    )
    np.testing.assert_array_equal(chains[1].poses.state.pose, other)


def test_ctrl_c_does_not_wait_for_starts_that_are_being_drawn():
    def draw(rng, sign, way, report):
        if sign > 0.0:
            raise KeyboardInterrupt
        while True:
            report(0.5)

    turns = [SimpleNamespace(target=SimpleNamespace(poses=SimpleNamespace(draw_start=draw)))] * 2
    with pytest.raises(KeyboardInterrupt):
        start_apart(turns, spawn_generators(0, 2), threads=2)


# How far given poses err.


@pytest.mark.parametrize("noise", [(0.05, 0.01), (0.2, 0.04), (0.5, 0.1)])
def test_scans_show_how_far_given_poses_err(noise):
    given = TRUTH + np.random.default_rng(3).normal(size=TRUTH.shape) * [noise[0], *noise]
    readings = readings_at(ROOM, TRUTH, given)
    found = given_errors(readings, 0.03)
    np.testing.assert_allclose(found[:2], noise, rtol=0.3)
    assert pose_noise("auto", readings, 0.03) == found[:2]
    assert found.advice().startswith(f"poses err by about {found.words()}, as scans disagree")
    assert f"--pose-noise {found.metres:.2g} {found.radians:.2g}" in found.advice()
    assert not found.is_odometry


@pytest.mark.parametrize("jitter", [0.01, 0.5, math.inf])
def test_errors_that_add_up_along_the_way_are_those_of_odometry(jitter):
    found = PoseErrors(0.6, 0.1, jitter)
    assert found.is_odometry == (jitter < 0.1)
    assert found.advice().endswith("--odometry wheels" if found.is_odometry else "--pose-noise 0.6 0.1")
    assert not PoseErrors(0.1, 0.02, jitter).is_odometry


def test_right_poses_need_no_advice():
    found = given_errors(readings_at(ROOM, TRUTH, TRUTH), 0.03)
    assert found.metres < 0.03
    assert found.advice() == ""
    assert pose_noise((0.3, 0.1), None, 0.03) == (0.3, 0.1)
    assert pose_noise(None, None, 0.03) is None


def test_few_scans_show_no_errors():
    few = readings_at(ROOM, TRUTH[:5], TRUTH[:5])
    assert given_errors(few, 0.03) is None
    with pytest.raises(ConfigError, match=r"--pose-noise auto: there are too few scans .* Give METRES RADIANS\."):
        pose_noise("auto", few, 0.03)


# Linear equations of relative poses.


def some(rng, n=6, k=9):
    poses = rng.normal(size=(n, 3)) * [3.0, 3.0, 2.0]
    tail = rng.integers(0, n, k)
    head = (tail + rng.integers(1, n, k)) % n
    return poses, Relations(tail, head, rng.normal(size=(k, 3)), rng.normal(size=(k, 3, 3)))


def test_equations_lead_down_to_the_poses_of_exact_relations():
    rng = np.random.default_rng(2)
    poses, relations = some(rng, k=20)
    exact = relations._replace(pose=seen_from(poses[relations.tail], poses[relations.head]))
    pull = Pull(poses, np.where(np.arange(6)[:, None] == 0, 10.0, np.zeros((6, 3))), exact)
    found = compose(poses, 0.05 * rng.normal(size=poses.shape))
    for _ in range(8):
        matrix, right = pull.equations(found)
        found = compose(found, np.linalg.solve(matrix.toarray(), right).reshape(-1, 3))
    np.testing.assert_allclose(errors(exact, found), 0.0, atol=1e-8)
    np.testing.assert_allclose(found, poses, atol=1e-8)


# Closures of loops, right and wrong ones.


def test_a_wrong_loop_is_left_out_and_does_not_fold_the_map():
    truth, rng = round_the_block(), np.random.default_rng(5)
    n = len(truth)
    steps = seen_from(truth[:-1], truth[1:])
    sd = np.array([0.02, 0.02, 0.01])
    tail, motion = np.arange(n - 1), steps + sd * rng.normal(size=steps.shape)
    drifting = [truth[0]]
    for step in motion:
        drifting.append(compose(drifting[-1], step))
    held = np.where(np.arange(n)[:, None] == 0, 1e6, np.zeros((n, 3)))
    root = root_of(np.tile(np.diag(sd**2), (n - 1, 1, 1)))
    chain = Pull(truth, held, Relations(tail, tail + 1, motion, root))
    covariance = np.diag([0.05, 0.05, 0.01]) ** 2
    right = [LoopMatch(k, n - 12 + k, seen_from(truth[k], truth[n - 12 + k]), covariance, 0.8, True) for k in (0, 4, 8)]
    wrong = LoopMatch(2, n // 2, np.array([3.0, 0.5, 0.4]), covariance, 0.7, True)
    poses, found = _settled(np.array(drifting), chain, [*right, wrong])
    assert [match.is_used for match in found] == [True, True, True, False]
    assert off(poses, truth) < 0.6 * off(np.array(drifting), truth)


def carried(truth, first, last):
    """Return true poses without those from `first` to `last`, and where wheels that stood still take them to be."""
    given = truth.copy()
    given[last:] = compose(truth[[first - 1]], seen_from(truth[[last]], truth[last:]))
    kept = np.delete(np.arange(len(truth)), np.arange(first, last))
    return truth[kept], given[kept]


@pytest.mark.slow
def test_a_carried_robot_is_found_where_it_was_put_down():
    truth, given = carried(round_the_block(), 30, 46)
    readings = readings_at(BLOCK, truth, given)
    start = find_start(pose_model(readings, None, None, ODOMETRY["wheels"]), readings, 0.03)
    assert off(given, truth) > 3.0
    assert off(start.poses, truth) < 0.15
    slipped = start.model.prior.slipped(start.poses)
    assert slipped[29] > 0.99
    assert np.delete(slipped, 29).max() < 0.5


def test_a_step_is_doubtful_whose_scan_fits_far_worse_than_others():
    fits = 0.9 + 0.02 * np.random.default_rng(1).standard_normal(60)
    assert doubtful(fits) == []
    assert doubtful(np.where(np.arange(60) == 7, 0.4, fits)) == [7]
    assert doubtful(np.full(5, np.nan)) == []


def _scans_round_the_block(kind, given=None):
    truth = round_the_block()
    prior = odometry_of(truth, kind)
    readings = readings_at(BLOCK, truth, prior.draw(np.random.default_rng(4)) if given is None else given)
    model = pose_model(readings, None, None, ODOMETRY[kind])
    return scans_of(model, readings, 0.03), model.prior


@pytest.mark.slow
def test_odometry_errs_as_scans_show_where_that_is_more_than_was_said(caplog):
    truth = round_the_block()
    drawn = odometry_of(truth, "poor")._replace(slip=0.0).draw(np.random.default_rng(4))
    readings = readings_at(BLOCK, truth, drawn)
    said = pose_model(readings, None, None, ODOMETRY["wheels"])
    found = find_start(said, readings, 0.03).model
    # By the definition of poor: 3.3 and 4 to 5 times as far.
    ratio = np.array(found.odometry) / ODOMETRY["wheels"]
    assert 3.0 < ratio[0] < 6.5
    assert 2.2 < ratio[2] < 4.5
    assert "scans show odometry to err" in caplog.text
    assert "do not lie on" not in caplog.text
    np.testing.assert_allclose(found.prior.spread, said.scaled(ratio[2], ratio[0]).prior.spread)
    right = follow(*_scans_round_the_block("poor"))
    assert (right.scale < 1.3).all()


@pytest.mark.parametrize(("n_unfit", "warned"), [(2, False), (8, True)])
def test_scans_too_far_apart_to_correct_odometry_by_are_told(caplog, n_unfit, warned):
    prior = odometry_of(round_the_block(spacing=3.0), "wheels")
    fits = np.ones(len(prior.motion))
    fits[:n_unfit], fits[-1] = 0.2, np.nan
    start._warn_of_gaps(prior, fits)
    assert ("do not lie on what was seen before them: half are 2.2 m" in caplog.text) == warned


@pytest.mark.slow
def test_a_way_that_a_loop_left_out_opens_is_found():
    """Of two ways of the same evidence the one that strains the odometry less is the likelier."""
    truth = round_the_block()
    scans, prior = _scans_round_the_block("wheels")
    ways = close_loops(scans, follow(scans, prior), pull_of(prior))
    assert len(ways) == 1
    assert off(ways[0].poses, truth) < 0.3
    pieces = cut(scans, truth)
    pairs = np.column_stack(np.triu_indices(len(pieces), 3))
    bent = truth.copy()
    bent[len(bent) // 2 :, 0] += 1.5
    assert gain(pairs, pieces, bent, truth) > 0.3
    assert gain(pairs, pieces, truth, truth) == 0.0


# Points matched with a place.


WINDOW = np.array([1.5, 1.5, 0.4])
ABOUT = np.array([0.4, -0.6, 0.1])


def wall(x0, y0, x1, y1):
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return (1.0 - share) * [x0, y0] + share * [x1, y1]


def laid(points):
    """Return a place of points, and the same points as seen from elsewhere, at `TRUE`."""
    place = place_of(points, np.zeros_like(points), 8.0)
    c, s = np.cos(TRUE[2]), np.sin(TRUE[2])
    return place, (points - TRUE[:2]) @ np.array([[c, -s], [s, c]])


TRUE = np.array([0.9, -0.2, -0.15])


def test_a_corridor_leaves_the_way_along_it_open():
    place, points = laid(np.concatenate([wall(-7, 1, 7, 1), wall(-7, -1, 7, -1)]))
    _, covariance = search(place, points[30:90:2], ABOUT, WINDOW)
    assert covariance[0, 0] > 5.0 * covariance[1, 1]


# States of readings: which scans share one, which are left, and what the odometry says between them.


N_BEAMS = 6


def drive(n: int, period: float, *, cone: float = 0.0) -> Readings:
    """Return scans a metre apart for each second, without poses in a table."""
    time = period * np.arange(n)
    origin = np.repeat(np.column_stack([time, np.zeros(n)]), N_BEAMS, axis=0)
    angle = np.tile(np.linspace(-1.0, 1.0, N_BEAMS), n)
    scan = np.repeat(np.arange(n), N_BEAMS)
    return Readings.from_arrays(
        origin, angle, np.full(len(angle), 3.0), scan=scan, time=np.repeat(time, N_BEAMS), cone=cone
    )


def test_scans_of_two_sensors_share_states_where_their_times_agree() -> None:
    laser, sonar = drive(5, 1.0), drive(15, 0.3, cone=0.3)
    model = pose_model(laser, sonar, (0.05, 0.01))
    shared = {0.0, 3.0}
    assert len(model.scan) == 5 + 15 - len(shared)
    assert (np.diff(model.time) > 0.0).all()
    for part, local in ((laser, model.laser), (sonar, model.sonar)):
        assert local is not None
        origin, angle = local.at(model.prior.given)
        np.testing.assert_allclose(origin, part.origin, atol=1e-12)
        np.testing.assert_allclose(np.exp(1j * angle), np.exp(1j * part.angle), atol=1e-12)


def test_what_is_left_keeps_its_frames_whatever_is_thinned_away() -> None:
    laser, sonar = drive(5, 1.0), drive(15, 0.3, cone=0.3)
    model = pose_model(laser, sonar, (0.05, 0.01))
    rows, cones = np.arange(N_BEAMS + 2, laser.n_beams, 3), np.arange(1, sonar.n_beams, 4)
    used = model.used(rows, cones)
    for part, local, chosen in ((laser, used.laser, rows), (sonar, used.sonar, cones)):
        assert local is not None
        np.testing.assert_allclose(local.at(used.start)[0], part.origin[chosen], atol=1e-12)
    assert len(used.start) == len(np.unique(np.concatenate([used.laser.owner, used.sonar.owner])))  # type: ignore[union-attr]
    assert used.draw_start is not None
    np.testing.assert_array_equal(used.draw_start(np.random.default_rng(1), 1.0, 0.0, report_nothing), used.start)


def test_odometry_needs_headings() -> None:
    with pytest.raises(InputError, match="no heading"):
        pose_model(drive(3, 1.0), None, None, ODOMETRY["wheels"])


# What draws of a trajectory say of its poses.


SD = np.array([0.03, 0.01, 0.02])
SHIFT = np.array([0.0, 0.04, 0.1])


@pytest.fixture(scope="module")
def drawn() -> Trajectory:
    """Poses 4 cm above and 0.1 rad beyond the given ones, spread 3 cm along a diagonal and 1 cm across it."""
    rng = np.random.default_rng(2)
    given = np.column_stack([np.arange(4.0), np.zeros(4), [0.0, 1.0, np.pi - 0.05, -3.0]])
    noise = rng.standard_normal((4000, 4, 3)) * SD
    along = np.sqrt(0.5) * np.array([[1.0, 1.0], [-1.0, 1.0]])
    draws = np.concatenate([noise[..., :2] @ along, noise[..., 2:]], axis=2) + SHIFT
    return Trajectory(np.arange(4), np.full(4, np.nan), given, draws.astype(np.float32))


def test_means_and_deviations_are_those_of_the_draws(drawn: Trajectory) -> None:
    wanted = drawn.given + SHIFT
    np.testing.assert_allclose(drawn.mean[:, :2], wanted[:, :2], atol=0.002)
    np.testing.assert_allclose(drawn.mean[:, 2], wrapped(wanted[:, 2]), atol=0.002)
    across = np.sqrt(0.5 * (SD[0] ** 2 + SD[1] ** 2))
    np.testing.assert_allclose(drawn.sd, np.broadcast_to([across, across, SD[2]], (4, 3)), rtol=0.05)
    figures = drawn.figures()
    np.testing.assert_allclose(list(figures.values()), [4, 0.04, 0.1, np.hypot(*SD[:2]), SD[2]], rtol=0.05)


def test_headings_are_circular(drawn: Trajectory) -> None:
    """Offsets round half a turn have a mean there, not at 0, and no wide spread."""
    turned = drawn.draws + np.array([0.0, 0.0, np.pi - 0.1], np.float32)
    turned[..., 2] = wrapped(turned[..., 2])
    found = dataclasses.replace(drawn, draws=turned)
    np.testing.assert_allclose(np.abs(found.correction[:, 2]), np.pi, atol=0.002)
    np.testing.assert_allclose(found.sd[:, 2], SD[2], rtol=0.05)


def test_ellipses_hold_nineteen_draws_of_twenty(drawn: Trajectory) -> None:
    axes = drawn.ellipses()
    np.testing.assert_allclose(np.linalg.norm(axes, axis=2), np.broadcast_to(2.448 * SD[[1, 0]], (4, 2)), rtol=0.05)
    error = (drawn.draws - drawn.correction)[..., :2]
    share = np.einsum("dnj,nij->dni", error, axes) / (axes**2).sum(axis=2)
    np.testing.assert_allclose(((share**2).sum(axis=2) <= 1.0).mean(axis=0), 0.95, atol=0.015)


def test_words_tell_corrections_from_knowledge(drawn: Trajectory) -> None:
    shifted = apart(dataclasses.replace(drawn, draws=np.tile(np.float32([0.0, 1.5, 0.0]), (4, 4, 1))), 0.0)
    assert shifted.words() == "4 poses corrected by 1.5 m and 0 degrees (rms), known to 0 cm and 0 degrees"
    assert dataclasses.replace(drawn, draws=drawn.draws[:0]).words().endswith("by 0 cm and 0 degrees (rms)")
    assert dataclasses.replace(shifted, chain=None).words().endswith("by 1.5 m and 0 degrees (rms)")


def apart(drawn: Trajectory, metres: float) -> Trajectory:
    """Return the same draws as those of four chains whose means lie so far apart, along x."""
    chain = np.repeat(np.arange(4, dtype=np.int32), len(drawn.draws) // 4)
    off = np.array([-1.5, -0.5, 0.5, 1.5]) / np.std([-1.5, -0.5, 0.5, 1.5], ddof=1) * metres
    shift = off[chain][:, None, None] * np.array([1.0, 0.0, 0.0])
    return dataclasses.replace(drawn, draws=(drawn.draws + shift).astype(np.float32), chain=chain)


def test_deviations_allow_for_few_chains(drawn: Trajectory) -> None:
    """Chains that agree: the posterior's; four that do not: an interval of 95 % of a further one, by Student's t."""
    np.testing.assert_allclose(apart(drawn, 0.0).sd, drawn.sd, rtol=0.01)
    found = apart(drawn, 3.0).sd
    np.testing.assert_allclose(found[:, 0], 3.0 * np.sqrt(1.25) * student(3), rtol=0.5)
    np.testing.assert_allclose(found[:, 1:] / drawn.sd[:, 1:], found[0, 1] / drawn.sd[0, 1], rtol=0.01)


def test_steps_are_between_poses_of_one_draw(drawn: Trajectory) -> None:
    """Errors that all poses share leave no trace in the steps between them."""
    shared = np.random.default_rng(1).normal(size=(len(drawn.draws), 1, 3)) * [0.5, 0.5, 0.0]
    together = dataclasses.replace(drawn, draws=(drawn.draws + shared).astype(np.float32))
    (mean, covariance), (moved, same) = drawn.steps(), together.steps()
    np.testing.assert_allclose(mean, seen_from(drawn.mean[:-1], drawn.mean[1:]), atol=2e-3)
    np.testing.assert_allclose(moved, mean, atol=1e-5)
    np.testing.assert_allclose(same, covariance, atol=1e-6)
    assert (together.sd[:, 0] > 0.4).all()


def student(degrees: int) -> float:
    return float(scipy.stats.t.ppf(0.975, degrees) / scipy.stats.norm.ppf(0.975))


def test_a_further_chain_lies_within_the_deviations_of_four() -> None:
    """Of chains that stay where they start the mean of a fifth is held by 1.96 deviations, 19 times of 20."""
    rng = np.random.default_rng(4)
    start = rng.standard_normal((4, 3000, 3))
    draws = np.repeat(start, 8, axis=0) + 1e-3 * rng.standard_normal((32, 3000, 3))
    chain = np.repeat(np.arange(4, dtype=np.int32), 8)
    given, scan = np.zeros((3000, 3)), np.arange(3000)
    found = Trajectory(scan, np.full(3000, np.nan), given, draws.astype(np.float32), chain=chain)
    inside = np.abs(rng.standard_normal((3000, 3)) - found.mean) <= 1.96 * found.sd
    np.testing.assert_allclose(inside.mean(), 0.95, atol=0.02)


def test_poses_are_settled_where_chains_agree(drawn: Trajectory) -> None:
    assert "known to" in apart(drawn, 0.02).words()
    words = apart(drawn, 0.8).words()
    assert "known to" not in words
    assert "; not settled: chains differ by 80 cm at scan" in words


def test_slips_and_loops_in_dispute_are_named(drawn: Trajectory) -> None:
    n = len(drawn.given)
    spread = np.full((n - 1, 3), 0.05)
    motion = seen_from(drawn.mean[:-1], drawn.mean[1:])
    drawn = dataclasses.replace(drawn, chain=(np.arange(len(drawn.draws)) % 2).astype(np.int32))
    plain = dataclasses.replace(drawn, prior=PosePrior(drawn.given, np.full((n, 2), np.inf), motion, spread))
    assert plain.slips.max() < 0.5
    assert "slipped" not in plain.words()
    motion = motion.copy()
    motion[1] += [3.0, 4.0, 0.5]
    found = dataclasses.replace(plain, prior=plain.prior._replace(motion=motion))  # type: ignore[union-attr]
    assert found.slips[1] > 0.99
    assert np.delete(found.slips, 1).max() < 0.5
    assert f"the robot slipped or was carried after scan {drawn.scan[1]}" in found.words()
    assert "by 5 m" in found.words()
    few = np.repeat([0.0, 0.025], len(drawn.draws) // 2)[:, None, None]  # metres that the chains differ by
    chain = np.repeat(np.arange(2, dtype=np.int32), len(drawn.draws) // 2)
    still = 0.1 * (drawn.draws - drawn.draws.mean(axis=0)) + drawn.draws.mean(axis=0)
    differing = dataclasses.replace(found, draws=(still + few).astype(np.float32), chain=chain)
    assert differing.slips[1] > 0.99
    assert differing.slip_rows() == []
    assert "slipped or was carried" not in differing.words()
    opens = f"not settled: whether the robot slipped in a step after scan {drawn.scan[1]}, where chains do not agree"
    assert opens in differing.words()
    pose = seen_from(drawn.mean[:1], drawn.mean[3:4])
    loops = Closures(
        np.zeros(2, int), np.full(2, 3), np.vstack([pose, pose + 1.0]), np.tile(0.2**2 * np.eye(3), (2, 1, 1))
    )
    open_ = dataclasses.replace(drawn, disputed=loops)
    np.testing.assert_allclose(open_.closed, [1.0, 0.0], atol=0.01)
    assert "known to" not in open_.words()
    assert f"whether scans {drawn.scan[0]} and {drawn.scan[3]} saw the same place" in open_.words()
    assert "in all draws, as all chains started" in open_.words()


def test_functionals_name_first_middle_and_last_pose(drawn: Trajectory) -> None:
    found = pose_functionals(drawn.given + drawn.draws, drawn.given)
    places = [name for i in (0, 2, 3) for name in (f"pose_{i}_x", f"pose_{i}_y", f"pose_{i}_heading")]
    assert list(found) == ["pose_correction", *places]
    np.testing.assert_allclose(found["pose_2_heading"], drawn.draws[:, 2, 2], atol=1e-6)
    np.testing.assert_allclose(found["pose_correction"].mean(), np.hypot(0.04, np.hypot(*SD[:2])), rtol=0.02)
    one = pose_functionals(drawn.given[:1] + np.array([3.0, 4.0, -0.5]), drawn.given[:1])
    np.testing.assert_allclose(list(one.values()), [5.0, 3.0, 4.0, -0.5])
