"""The simulated sonar ring against geometry that has closed forms: ranges and levels of echoes, readings, noise."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from prf.logs.rings import PIONEER
from prf.shell.errors import ConfigError, InputError
from prf.simulate.sonar import SonarPhysics, simulate_sonar, trace_echoes

Floats = NDArray[np.float64]

SMOOTH = SonarPhysics(rough_share=0.0)
QUIET = dataclasses.replace(SMOOTH, noise=False, cross_talk=False)
AHEAD = np.zeros((1, 3))
"""A ring of one transducer at the robot's centre that looks ahead."""
ROOM = np.array([[0.0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]])


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def loop(*corners: tuple[float, float]) -> Floats:
    """Return the walls of a closed ring; counter-clockwise rings are rooms, clockwise ones things."""
    xy = np.array(corners, dtype=np.float64)
    return np.concatenate([xy, np.roll(xy, -1, axis=0)], axis=1)


def echoes(walls: Floats, x: float, y: float, heading: float, physics: SonarPhysics = QUIET) -> Floats:
    """Return range and level of each echo of one transducer."""
    return trace_echoes(walls, np.array([x, y, heading]), physics, rng(), AHEAD)[0]


def mirror_level(physics: SonarPhysics, distance: float, bounces: int = 1) -> float:
    """Level of a face-on mirror at that range."""
    spread = 20.0 * math.log10(physics.mirror**bounces / (2.0 * distance))
    return physics.level_db + spread - 2.0 * distance * physics.absorption_db


def loudness(found: Floats, at: float, width: float = 0.02) -> float:
    """Level of the loudest echo within `width` of a range, -inf if there is none."""
    near = np.abs(found[:, 0] - at) < width
    return float(found[near, 1].max(initial=-np.inf))


WALL = np.array([[2.0, -30.0, 2.0, 30.0]])
"""A long wall 2 m ahead of the origin."""


@pytest.mark.parametrize("distance", [0.3, 1.0, 2.0, 5.0])
def test_a_wall_face_on_is_a_mirror(distance: float) -> None:
    found = echoes(WALL, 2.0 - distance, 0.0, 0.0)
    assert found.shape == (1, 2)
    assert found[0] == pytest.approx([distance, mirror_level(QUIET, distance)], abs=0.05)
    reading = simulate_sonar(WALL, np.array([[2.0 - distance, 0.0, 0.0]]), QUIET, rng(), AHEAD)
    assert reading[0, 0] == pytest.approx(distance, abs=0.003)


@pytest.mark.parametrize("degrees", [3.0, 8.0, 17.0, 30.0])
def test_an_oblique_wall_is_as_loud_as_the_beam_is_toward_its_foot(degrees: float) -> None:
    angle = math.radians(degrees)
    found = echoes(WALL, 0.0, 0.0, angle)
    lost = 40.0 * math.log10(float(QUIET.directivity(angle)))
    expected = mirror_level(QUIET, 2.0) + lost
    if len(found):
        assert found[0] == pytest.approx([2.0, expected], abs=0.05)
    else:
        assert expected + float(QUIET.gain_db(2.0)) < -19.9


def test_beyond_the_main_lobe_a_near_wall_is_heard_by_the_side_lobe_alone() -> None:
    angle = math.radians(18.0)
    near = np.array([[1.3, 0.0, angle]])
    heard = simulate_sonar(WALL, near, dataclasses.replace(QUIET, level_db=50.0), rng(), AHEAD)
    assert heard[0, 0] == pytest.approx(0.7, abs=0.06)
    deaf = dataclasses.replace(QUIET, level_db=50.0, side_lobes=False)
    assert np.isinf(simulate_sonar(WALL, near, deaf, rng(), AHEAD)[0, 0])
    assert np.isinf(simulate_sonar(WALL, np.array([[0.0, 0.0, math.radians(45.0)]]), SMOOTH, rng(), AHEAD)[0, 0])


def test_over_the_end_of_a_wall_half_of_the_amplitude_is_left_and_then_it_fades() -> None:
    ends_here = np.array([[2.0, 0.0, 2.0, 30.0]])
    whole = mirror_level(QUIET, 2.0)
    assert loudness(echoes(ends_here, 0.0, 0.0, 0.0), 2.0) == pytest.approx(whole - 6.02, abs=0.1)
    assert loudness(echoes(ends_here, 0.0, 1.0, 0.0), 2.0) == pytest.approx(whole, abs=1.0)
    beyond = [loudness(echoes(ends_here, 0.0, -h, 0.0), 2.0) for h in (0.02, 0.08, 0.2)]
    assert whole - 6.0 > beyond[0] > beyond[1] > beyond[2]
    # Far from the end a straight edge sends back 1 / (sqrt(2) pi v) of the mirror.
    v = 2.0 * 0.2 / math.sqrt(QUIET.wavelength * 2.0)
    lost = 40.0 * math.log10(float(QUIET.directivity(math.atan(0.1))))
    assert beyond[2] == pytest.approx(whole + 20.0 * math.log10(1.0 / (math.sqrt(2.0) * math.pi * v)) + lost, abs=0.5)


@pytest.mark.parametrize("degrees", [10.0, 30.0, 45.0, 65.0, 80.0])
def test_a_corner_of_a_room_answers_from_every_direction(degrees: float) -> None:
    """By both orders of its walls, each with half of the amplitude of a mirror at the corner's distance."""
    walls = np.array([[0.0, 30.0, 0.0, 0.0], [0.0, 0.0, 30.0, 0.0]])
    angle = math.radians(degrees)
    distance = 2.5
    place = distance * math.cos(angle), distance * math.sin(angle)
    found = echoes(walls, *place, angle + math.pi)
    at = found[np.abs(found[:, 0] - distance) < 1e-6]
    assert len(at) == 2
    np.testing.assert_allclose(at[:, 1], mirror_level(QUIET, distance, 2) - 6.02, atol=0.1)
    if 20.0 < degrees < 70.0:
        reading = simulate_sonar(walls, np.array([[*place, angle + math.pi]]), QUIET, rng(), AHEAD)
        assert reading[0, 0] == pytest.approx(distance, abs=0.003)


def test_a_corner_that_opens_fades_and_one_that_closes_answers_twice() -> None:
    def level(opening: float) -> float:
        walls = np.array([[30 * math.cos(opening), 30 * math.sin(opening), 0, 0], [0, 0, 30.0, 0]])
        middle = 0.5 * opening
        found = echoes(walls, 2 * math.cos(middle), 2 * math.sin(middle), middle + math.pi)
        at = np.abs(found[:, 0] - 2.0) < 0.05
        return float(20.0 * np.log10((10.0 ** (found[at, 1] / 20.0)).sum()))

    right = level(math.radians(90.0))
    assert right == pytest.approx(mirror_level(QUIET, 2.0, 2), abs=0.1)
    assert level(math.radians(92.0)) < right - 6.0
    assert level(math.radians(96.0)) < right - 14.0
    assert level(math.radians(88.0)) > right + 2.0


@pytest.mark.parametrize("distance", [0.5, 1.0, 3.0])
def test_an_edge_answers_as_its_rounding_does(distance: float) -> None:
    """A cylinder of radius a: sqrt(a / (a + d)) / 2d, weaker than the wall and than the corner."""
    walls = np.array([[-20.0, 0, 0, 0], [0, 0, 0, -20]])
    d = distance
    found = echoes(walls, d * math.sqrt(0.5), d * math.sqrt(0.5), -0.75 * math.pi)
    a = QUIET.edge_radius
    expected = mirror_level(QUIET, d) + 10.0 * math.log10(a / (a + d))
    assert loudness(found, d) == pytest.approx(expected, abs=0.05)
    assert expected < mirror_level(QUIET, d, 2) - 15.0
    sharp = echoes(walls, d * math.sqrt(0.5), d * math.sqrt(0.5), -0.75 * math.pi, switched_off("edges"))
    assert loudness(sharp, d) < expected - 10.0


def switched_off(*effects: str) -> SonarPhysics:
    return dataclasses.replace(QUIET, **dict.fromkeys(effects, False))


def test_in_a_corridor_the_echo_comes_again_after_the_wall_behind() -> None:
    corridor = np.array([[2.0, -30, 2, 30], [-1.0, 30, -1, -30]])
    found = echoes(corridor, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(found[:, 0], [2.0, 5.0], atol=1e-6)
    assert found[1, 1] == pytest.approx(mirror_level(QUIET, 5.0, 3), abs=0.05)
    np.testing.assert_allclose(echoes(corridor, 0.0, 0.0, 0.0, switched_off("detours"))[:, 0], [2.0])


def test_a_slanting_wall_shows_another_one() -> None:
    """A mirror at 45 degrees, 1 m ahead, shows a wall 1.5 m to the side of it: 2.5 m, by three reflections."""
    walls = np.array([[0.0, -1.0, 5.0, 4.0], [30.0, 1.5, -30.0, 1.5]])
    found = echoes(walls, 0.0, 0.0, 0.0)
    assert loudness(found, 2.5) == pytest.approx(mirror_level(QUIET, 2.5, 3), abs=0.5)
    assert loudness(echoes(walls, 0.0, 0.0, 0.0, switched_off("detours")), 2.5) < -60.0


def test_what_stands_in_the_way_hides_what_is_behind() -> None:
    post = loop((1.0, -0.3), (1.0, 0.3), (1.1, 0.3), (1.1, -0.3))
    alone, both = echoes(post, 0.0, 0.0, 0.0), echoes(np.concatenate([WALL, post]), 0.0, 0.0, 0.0)
    assert loudness(both, 2.0) == -np.inf
    assert loudness(both, 1.0) == pytest.approx(loudness(alone, 1.0), abs=1e-9)


def test_a_narrow_thing_is_fainter_than_a_wall() -> None:
    levels = [loudness(echoes(loop((2, -h), (2, h), (2.1, h), (2.1, -h)), 0, 0, 0), 2.0) for h in (0.01, 0.03, 0.3)]
    assert levels[0] < levels[1] - 6.0
    assert levels[1] < levels[2] - 3.0
    # A strip much narrower than the Fresnel zone: its width over that of the zone.
    expected = mirror_level(QUIET, 2.0) + 20.0 * math.log10(0.02 * math.sqrt(2.0 / (QUIET.wavelength * 2.0)))
    assert levels[0] == pytest.approx(expected, abs=0.3)


def test_cross_talk_is_heard_by_those_that_fire_together() -> None:
    """Between two walls the sound that goes ahead comes back from behind after one round."""
    corridor = np.array([[2.0, -30, 2, 30], [-1.0, 30, -1, -30]])
    ring = np.array([[0.0, 0, 0], [0.0, 0, math.pi]])
    physics = dataclasses.replace(QUIET, cross_talk=True)
    behind = trace_echoes(corridor, np.zeros(3), physics, rng(), ring)[1]
    assert loudness(behind, 3.0) == pytest.approx(mirror_level(QUIET, 3.0, 2), abs=0.05)
    for other in (QUIET, dataclasses.replace(physics, fired_together=1)):
        assert loudness(trace_echoes(corridor, np.zeros(3), other, rng(), ring)[1], 3.0) == -np.inf


def test_rough_walls_answer_obliquely() -> None:
    angle = math.radians(40.0)
    rough = dataclasses.replace(QUIET, rough_share=1.0)
    where = np.array([[1.3, 0.0, angle]])
    assert np.isinf(simulate_sonar(WALL, where, QUIET, rng(), AHEAD)[0, 0])
    reading = simulate_sonar(WALL, where, rough, rng(), AHEAD)[0, 0]
    assert 0.7 < reading < 0.7 / math.cos(math.radians(52.0))
    assert np.isinf(simulate_sonar(WALL, where, dataclasses.replace(rough, rough=False), rng(), AHEAD)[0, 0])


def random_poses(n: int, seed: int = 5) -> Floats:
    return rng(seed).uniform([0.5, 0.5, -math.pi], [5.5, 3.5, math.pi], (n, 3))


def test_order_and_cuts_of_the_walls_do_not_matter() -> None:
    """Straight joints vanish: the same readings to the last bit."""
    walls = np.concatenate([ROOM, loop((2.0, 1.0), (2.0, 1.5), (3.0, 1.5), (3.0, 1.0))])
    poses = random_poses(10)
    expected = simulate_sonar(walls, poses, SonarPhysics(), rng())
    cut = []
    for x1, y1, x2, y2 in walls:
        s = np.concatenate([[0.0], np.sort(rng(3).random(3)), [1.0]])
        xy = np.stack([x1 + s * (x2 - x1), y1 + s * (y2 - y1)], axis=1)
        xy[-1] = x2, y2
        cut.append(np.concatenate([xy[:-1], xy[1:]], axis=1))
    shuffled = rng(4).permutation(np.concatenate(cut))
    np.testing.assert_array_equal(simulate_sonar(shuffled, poses, SonarPhysics(), rng()), expected)


def test_a_bend_too_slight_to_see_scatters_next_to_nothing() -> None:
    """The fading of either part over its end makes up for the other's: together they are one mirror."""
    bent = np.array([[2.0, -30, 2.0, 0.1], [2.0, 0.1, 2.0 + 30 * math.tan(2e-4), 30.0]])
    found = echoes(bent, 0.0, 0.0, 0.0)
    wave = (10.0 ** (found[:, 1] / 20.0)).sum()
    assert len(found) == 2
    assert 20.0 * math.log10(wave) == pytest.approx(mirror_level(QUIET, 2.0), abs=1.5)


def test_the_seed_decides_everything() -> None:
    poses = random_poses(5)
    one, two = (simulate_sonar(ROOM, poses, SonarPhysics(), rng(2)) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, simulate_sonar(ROOM, poses, SonarPhysics(), rng(3)))


def test_without_walls_there_is_noise_and_little_of_it() -> None:
    silence = simulate_sonar(np.zeros((0, 4)), random_poses(500), SMOOTH, rng())
    heard = np.isfinite(silence).mean()
    # 16 of 8,000 expected, and one or two from the noise: four standard deviations.
    assert 1 <= (heard * 8000).round() <= 34
    assert np.isinf(simulate_sonar(np.zeros((0, 4)), random_poses(500), QUIET, rng())).all()


def test_loud_echoes_are_precise_and_weak_ones_late() -> None:
    """The circuit swings up over the length of the pulse: a weak echo crosses late, and where depends on the noise."""
    poses = np.zeros((400, 3))
    strict = dataclasses.replace(SMOOTH, cross_talk=False, burst_probability=0.0, stretch=0.0)
    loud = simulate_sonar(WALL, poses, strict, rng(), AHEAD)
    assert loud.std() < 0.001
    assert loud.mean() == pytest.approx(2.0, abs=0.005)
    over = float(mirror_level(SMOOTH, 2.0) + SMOOTH.gain_db(2.0))
    weak = simulate_sonar(WALL, poses, dataclasses.replace(strict, level_db=SMOOTH.level_db - over + 2.0), rng(), AHEAD)
    heard = weak[np.isfinite(weak)]
    assert len(heard) > 200
    assert 0.01 < heard.mean() - 2.0 < 0.06
    assert heard.std() > 0.004


def test_readings_are_multiples_of_the_quantum_within_their_bounds() -> None:
    physics = SonarPhysics(quantum=0.01, max_range=4.0)
    readings = simulate_sonar(ROOM, random_poses(50), physics, rng())
    heard = readings[np.isfinite(readings)]
    np.testing.assert_allclose(heard, np.round(heard * 100) / 100, atol=1e-12)
    assert readings.shape == (50, 16)
    assert heard.min() >= 0.15
    assert heard.max() <= 4.0


def test_a_wrong_speed_of_sound_stretches_all_ranges() -> None:
    warm = dataclasses.replace(QUIET, assumed_sound_speed=QUIET.sound_speed * 0.98)
    assert simulate_sonar(WALL, np.zeros((1, 3)), warm, rng(), AHEAD)[0, 0] == pytest.approx(1.96, abs=0.003)


def test_the_ring_stands_on_the_robot() -> None:
    """Each transducer near the walls of the room reads the distance from where it is mounted."""
    pose = np.array([[3.0, 2.0, 0.0]])
    readings = simulate_sonar(ROOM, pose, QUIET, rng())[0]
    assert readings[0] == pytest.approx(2.0 - PIONEER[0, 1], abs=0.003)
    assert readings[7] == pytest.approx(2.0 - PIONEER[0, 1], abs=0.003)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("frequency", 0.0, "positive"),
        ("max_range", -1.0, "positive"),
        ("max_range", 1e5, "in air at most 1000 m"),
        ("frequency", 1e308, "number, at most"),
        ("noise_db", math.nan, "number"),
        ("flutter_db", -1.0, "negative"),
        ("rough_share", 1.5, "share"),
        ("blanking", 9.0, "maximum range"),
        ("fired_together", 0, "at least 1"),
    ],
)
def test_constants_that_no_device_has_are_refused(field: str, value: float, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        SonarPhysics(**{field: value})


def test_arrays_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match="walls"):
        simulate_sonar(np.zeros((3, 2)), np.zeros((1, 3)), QUIET, rng())
    with pytest.raises(InputError, match="poses"):
        simulate_sonar(ROOM, np.full((1, 3), np.nan), QUIET, rng())


def test_the_page_has_every_field_with_its_default(project_root: Path) -> None:
    rows = {}
    for line in (project_root / "docs" / "sonar-simulator.md").read_text().splitlines():
        if line.startswith("| `"):
            name, _, default, _ = (cell.strip() for cell in line.strip("|").split("|"))
            rows[name.strip("`")] = default
    assert rows == {field.name: repr(getattr(SonarPhysics(), field.name)) for field in dataclasses.fields(SonarPhysics)}


def test_progress_counts_every_pose() -> None:
    done: list[int] = []
    simulate_sonar(WALL, np.zeros((120, 3)), QUIET, rng(), AHEAD, advance=done.append)
    assert sum(done) == 120
    assert len(done) > 1
