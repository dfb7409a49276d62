from __future__ import annotations

import numpy as np
import pytest

from prf.readings import NoReadings, Readings, describe
from prf.readings.player import read_player
from prf.readings.readings import PIONEER
from prf.shell.errors import ConfigError, InputError
from tests.readings.samples import player, player1, player_laser, position

MOUNT = player("laser", ("+0.100", "+0.200", "0.500", "0.140", "0.140"), kind="004 001")
POSES = position(0, 0, 0, 1) + position(2, 0, 1, 3)
RING = ((0.1, 0.0, 0.5), (0.1, 0.0, -0.5))
RING_FIELDS = (2, *(value for site in RING for value in site))


def read(text: str, kind="laser", **options) -> Readings:
    return read_player(text.encode(), "a.log", kind, 0.349, **options)


def refusal(text: str, kind="laser") -> str:
    with pytest.raises(InputError) as caught:
        read(text, kind)
    assert "\n" not in str(caught.value)
    return str(caught.value)


class TestLaser:
    def test_pose_between_positions_plus_mount_plus_bearing(self):
        readings = read("## Player version 2.1.2\n" + MOUNT + POSES + player_laser([1, 2, 3], time=2))
        cosine, sine = np.cos(0.5), np.sin(0.5)
        where = [1 + cosine * 0.1 - sine * 0.2, sine * 0.1 + cosine * 0.2]
        np.testing.assert_allclose(readings.origin, [where] * 3, atol=1e-12)
        np.testing.assert_allclose(readings.angle, 0.5 + 0.5 + np.array([-0.5, 0, 0.5]), atol=1e-12)
        np.testing.assert_array_equal(readings.range, [1, 2, 3])
        assert (readings.time == 2).all()
        assert readings.notes.devices == ("laser:0",)
        assert readings.notes.poses == "position2d:0, interpolated in time"

    def test_intensities_are_not_ranges(self):
        assert read(POSES + player_laser([4, 5], time=2)).range.tolist() == [4, 5]

    def test_at_the_stated_maximum_there_is_no_return(self):
        readings = read(POSES + player_laser([7.999, 8.0, 8.191, 0.0], time=2))
        assert readings.range.tolist() == [7.999, np.inf, np.inf]
        assert readings.notes.n_zero_ranges == 1
        assert describe(readings, "a").largest_range == 8.0

    def test_player_1_has_no_mount_no_maximum_and_the_time_of_the_data(self):
        text = "".join(player1("position", (t, 0, 0, 0, 0, 0, 0), t) for t in (1.0, 2.0, 3.0))
        laser = (-1.5708, 1.5708, 0.0175, 181, *(f for i in range(181) for f in (1 + 0.01 * i, 0)))
        readings = read(text + player1("laser", laser, 2.5))
        np.testing.assert_allclose(readings.origin[0], [2.5, 0])
        # The step is rounded in the file: 180 of them would miss the last beam by 0.6 degrees.
        np.testing.assert_allclose(readings.angle[[0, -1]], [-1.5708, 1.5708])
        np.testing.assert_allclose(np.diff(readings.angle), np.pi / 180, atol=1e-5)
        assert "the robot's centre is assumed" in " ".join(readings.notes.remarks)

    def test_a_step_that_does_not_lead_to_the_maximum_angle_is_taken_as_it_is(self):
        text = player("laser", (0, -1, 1, 0.25, 8, 3, 1, 0, 1, 0, 1, 0), 2)
        np.testing.assert_allclose(read(POSES + text).angle, 0.5 + np.array([-1, -0.75, -0.5]))

    def test_a_scan_with_its_own_pose(self):
        text = player("laser", (0, 5, 6, 1, -0.5, 0.5, 0.5, 8, 3, 1, 0, 1, 0, 1, 0), kind="001 002")
        readings = read(MOUNT.replace("+0.200", "+0.000") + text)
        np.testing.assert_allclose(readings.origin[0], [5 + 0.1 * np.cos(1), 6 + 0.1 * np.sin(1)])
        assert readings.notes.poses == "in the laser lines"

    @pytest.mark.parametrize(
        ("high", "step", "n", "degrees"),
        [
            (1.5708, "+00.0087", 361, 0.5),
            (1.5708, "+00.0087", 360, 0.5),  # the last one left out
            (1.5708, "+00.0175", 181, 1.0),
            (-0.6981, "+00.0044", 201, 0.25),
            (1.5708, "+0.00872665", 361, 0.5),
            (1.5708, "+0.00872665", 360, 0.5),
            (1.5708, "0.0174", 91, np.degrees(0.0174)),  # neither: as it is
        ],
    )
    def test_a_step_rounded_to_four_digits_is_found_from_the_ends(self, high, step, n, degrees):
        laser = (-1.5708, high, step, n, *(f for _ in range(n) for f in (1, 0)))
        angle = read(player1("position", (0, 0, 0, 0, 0, 0, 0), 2) + player1("laser", laser, 2.1)).angle
        np.testing.assert_allclose(np.degrees(angle), -90 + degrees * np.arange(n), atol=0.002)

    def test_two_lasers_and_two_position_devices(self):
        text = POSES + position(50, 0, 0, 1, index="01") + position(52, 0, 0, 3, index="01")
        text += player_laser([1, 1], time=2) + player_laser([1, 1], time=2, index="01")
        readings = read(text)
        assert readings.notes.devices == ("laser:0", "laser:1")
        assert "position2d:1" in " ".join(readings.notes.remarks)
        chosen = read(text, device="laser:1", frame="position2d:1")
        assert (chosen.n_beams, chosen.origin[0, 0]) == (2, 51)
        with pytest.raises(ConfigError, match="laser:0, laser:1"):
            read(text, device="laser:7")
        with pytest.raises(ConfigError, match="position2d:0, position2d:1"):
            read(text, frame="position2d:2")


class TestPoses:
    def test_a_clock_of_few_values_gives_the_last_position_before(self):
        text = position(0, 0, 0, 5) + position(1, 0, 0, 5) + player_laser([1], 5) + position(9, 0, 0, 5)
        readings = read(text)
        assert readings.origin[0, 0] == 1
        assert readings.notes.poses == "position2d:0, the last one before each reading"

    def test_without_a_clock_a_scan_before_any_position_is_dropped(self):
        readings = read(player_laser([1], 5) + position(1, 0, 0, 5) + player_laser([2], 5))
        assert readings.range.tolist() == [2]
        assert "1 of 2 scans" in " ".join(readings.notes.remarks)

    def test_scans_far_outside_the_time_of_the_positions_are_dropped(self):
        readings = read(POSES + "".join(player_laser([t], t) for t in (0.4, 0.6, 3.4, 3.6)))
        np.testing.assert_allclose(readings.range, [0.6, 3.4])
        np.testing.assert_allclose(readings.origin[:, 0], [0, 2])


class TestSonar:
    def test_ring_from_the_geometry_line(self):
        geometry = player("sonar", RING_FIELDS, kind="004 001")
        readings = read(geometry + POSES + player("sonar", (2, 1.5, 2.5), 2), "sonar")
        cosine, sine = np.cos(0.5), np.sin(0.5)
        np.testing.assert_allclose(readings.origin, [[1 + 0.1 * cosine, 0.1 * sine]] * 2)
        np.testing.assert_allclose(readings.angle, [1.0, 0.0], atol=1e-12)
        assert readings.range.tolist() == [1.5, 2.5]
        assert readings.cone.tolist() == [0.349] * 2
        assert readings.notes.ring == RING
        assert readings.notes.remarks[0].startswith("the poses")
        moved = player("sonar", RING_FIELDS, kind="001 002")
        assert read(moved + POSES + player("sonar", (2, 1.5, 2.5), 2), "sonar").n_beams == 2

    def test_a_genuine_line_of_player_1(self):
        ranges = (0.326, 0.399, 2.299, 2.356, 1.565, 0.830, 2.078, 0.281, 0.223, 0.258, 0.345, 2.748, 7.149, 7.082)
        ranges = (*ranges, 2.225, 7.365)
        ring = [f"{value:+.3f}" if i % 3 < 2 else f"{value:+.4f}" for i, value in enumerate(PIONEER.reshape(-1))]
        time = 1106955333.276
        poses = player1("position", (0, 0, 0, 0, 0, 0, 0), time) + player1("position", (1, 0, 0, 0, 0, 0, 0), time + 1)
        readings = read(poses + player1("sonar", (16, *ring, 16, *ranges), time), "sonar")
        assert readings.range.tolist() == list(ranges)
        np.testing.assert_allclose(readings.origin, PIONEER[:, :2], atol=1e-12)
        np.testing.assert_allclose(readings.angle, PIONEER[:, 2], atol=1e-4)
        assert ring[:6] == ["+0.115", "+0.130", "+1.5708", "+0.155", "+0.115", "+0.8727"]
        assert ring[24:27] == ["-0.115", "-0.130", "-1.5708"]

    @pytest.mark.parametrize("n", [8, 16])
    def test_without_geometry_a_pioneer_is_assumed(self, n):
        readings = read(POSES + player("sonar", (n, *[1.0] * n), 2), "sonar")
        assert readings.notes.ring == tuple(map(tuple, PIONEER[:n].tolist()))
        assert "Pioneer" in readings.notes.remarks[0]

    def test_another_size_without_geometry_is_refused(self):
        message = refusal(POSES + player("sonar", (5, *[1.0] * 5), 2), "sonar")
        assert message.startswith("a.log:3: the log does not give the positions of the 5 transducers of sonar:0")

    def test_kinds(self):
        both = POSES + player_laser([1], 2) + player("sonar", (8, *[1.0] * 8), 2)
        assert read(both).n_beams == 1
        assert read(both, "sonar").n_beams == 8
        assert read(both, None).n_beams == 1
        assert read(both, None).notes.lines["sonar"] == 1
        assert read(POSES + player("sonar", (8, *[1.0] * 8), 2), None).n_beams == 8
        with pytest.raises(NoReadings, match="2 position2d"):
            read(POSES)


class TestRefusals:
    @pytest.mark.parametrize(
        ("line", "words"),
        [
            (player_laser([1, 2, 3], 2).rsplit(" ", 1)[0] + "\n", "announces 3 pairs of range and intensity"),
            (player("laser", (0, -1, 1), 2), "ends too early"),
            (player_laser([1, -2, 3], 2), "range is -2"),
            (player_laser([1, "x", 3], 2), "could not convert"),
            (player_laser([1, 2, 3], 2, step=57.0), "expected different directions"),
            (player("position2d", ("nan", 2, 0, 0, 0, 0, 0), 1.5), "x is nan"),
            ("0000000000.200 1677\n", "ends too early"),
            ("0000000000.200 16777343 6665 laser 00 x 001\n", "invalid literal"),
            (player("sonar", (3, 1, 2), 2), "announces 3 readings, which makes 4 fields, but has 3"),
            (player("sonar", (2, 1, 2, 3), kind="004 001"), "cannot reshape"),
            (
                player1("sonar", (*RING_FIELDS, 3, 1, 1, 1), 2),
                "the log does not give the positions of the 3 transducers",
            ),
        ],
    )
    def test_a_damaged_line_is_named(self, line, words):
        kind = "sonar" if "sonar" in line else "laser"
        message = refusal(POSES + line + player_laser([1], 2) + player("sonar", (8, *[1.0] * 8), 2), kind)
        assert message.startswith("a.log:3: ")
        assert words in message

    def test_no_position(self):
        assert "no position line" in refusal(player_laser([1], 2))

    def test_what_is_passed_over_is_counted(self):
        text = POSES + player("ptz", (1, 2)) + player("sonar", (1, 1)) + "0.1 h 6665 ??? 00 001 001\n# note\n"
        notes = read(text + player_laser([1], 2) + player("laser", (), kind="004 002")).notes
        assert notes.lines == {"position2d:0": 2, "ptz": 1, "sonar": 1, "???": 1, "laser": 1}
