from __future__ import annotations

import numpy as np
import pytest

from prf.readings import NoReadings, Readings, describe
from prf.readings.carmen import read_carmen
from prf.readings.readings import PIONEER, half_circle
from prf.shell.errors import ConfigError, InputError
from tests.readings.samples import flaser, robot_laser


def read(text: str):
    return read_carmen(text.encode(), "a.log")


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        read(text)
    return str(caught.value)


class TestLines:
    def test_only_the_first_field_names_the_message(self):
        text = (
            "# message formats defined: PARAM SYNC ODOM FLASER RLASER TRUEPOS\n"
            "# FLASER num_readings [range_readings] x y theta odom_x odom_y odom_theta\n"
            "##            (ODOM, FLASER, PARAM)\n"
            "#PARAM simulator_num_readings 181 nohost 0\n"
            "PARAM logger_comment FLASER 2 1 1 nohost 0\n"
            "\n" + flaser([1, 2, 3])
        )
        readings = read(text)
        assert readings.n_beams == 3
        assert readings.notes.lines == {"comment": 4, "PARAM": 1}

    def test_extras_of_other_tools_are_passed_over_and_counted(self):
        text = "NEFF 15\nODOM 0 0 0 0 0 0 0.1 pippo 0.1\nPARAM robot_use_laser on nohost 0\nWHAT 3\n" + flaser([1, 2])
        notes = read(text).notes
        assert notes.lines == {"NEFF": 1, "ODOM": 1, "PARAM": 1}
        assert notes.odd_lines == {"WHAT": 1}

    def test_windows_line_ends(self):
        assert read(flaser([1, 2]).replace("\n", "\r\n") * 2).n_scans == 2


class TestPoses:
    @pytest.mark.parametrize("before", ["", "PARAM robot_frontlaser_offset -0.04 nohost 0\n"])
    def test_the_laser_pose_counts_not_the_robots_and_no_offset_is_added_again(self, before):
        readings = read(before + flaser([1, 1], pose=(3, 4, 0.5), robot=(9, 9, 9)))
        np.testing.assert_array_equal(readings.origin, [[3, 4], [3, 4]])
        np.testing.assert_allclose(readings.angle, [0.5 - np.pi / 2, 0.5 + np.pi / 2])

    def test_the_rear_lasers_heading_already_looks_backwards(self):
        # CARMEN: laser_theta = odom_theta + pi, position = robot + offset along that heading.
        line = flaser([1, 2, 3], pose=(-0.2, 0, np.pi), robot=(0, 0, 0), kind="RLASER")
        readings = read(line)
        np.testing.assert_allclose(np.cos(readings.angle), [0, -1, 0], atol=1e-12)
        np.testing.assert_allclose(readings.origin[0], [-0.2, 0])
        assert readings.notes.remarks == (
            "laser lines of 3 beams carry no angles: half a circle is assumed, both ends included",
        )

    def test_a_rear_laser_with_the_robots_heading_is_remarked_on(self):
        assert "rear laser" in " ".join(read(flaser([1] * 180, kind="RLASER")).notes.remarks)

    def test_scans_are_numbered_over_all_lasers(self):
        readings = read(flaser([1, 2]) + flaser([3], kind="RLASER") + flaser([4, 5]))
        np.testing.assert_array_equal(readings.scan, [0, 0, 1, 2, 2])
        np.testing.assert_array_equal(readings.beam, [0, 1, 0, 0, 1])
        assert readings.notes.devices == ("FLASER", "RLASER")
        np.testing.assert_array_equal(readings.notes.scans.line, [1, 2, 3])


class TestAngles:
    @pytest.mark.parametrize(("n", "step"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
    def test_half_circle_in_degrees(self, n, step):
        assert read(flaser([1] * n)).notes.remarks == ()
        degrees = np.degrees(half_circle(n))
        np.testing.assert_allclose(degrees, -90 + step * np.arange(n), atol=1e-9)
        assert degrees[-1] == pytest.approx(90 - step * (n % 2 == 0))

    def test_other_counts_span_the_half_circle_and_are_remarked_on(self):
        readings = read(flaser([1] * 91))
        np.testing.assert_allclose(np.degrees(readings.angle), -90 + 2 * np.arange(91), atol=1e-9)
        assert "91 beams" in readings.notes.remarks[0]

    @pytest.mark.parametrize("n", [400, 401])
    def test_a_quarter_of_a_degree_is_that_of_a_sick_over_100_degrees(self, n):
        readings = read(flaser([1] * n, pose=(0, 0, 0.5)))
        np.testing.assert_allclose(np.degrees(readings.angle - 0.5), -50 + 0.25 * np.arange(n), atol=1e-9)
        assert readings.notes.remarks == (
            f"laser lines of {n} beams carry no angles: 100 degrees in steps of 0.25 are assumed",
        )

    def test_one_beam_looks_to_the_right(self):
        assert read(flaser([1])).angle[0] == pytest.approx(-np.pi / 2)


class TestRobotLaser:
    @pytest.mark.parametrize("turn_axis", [(), (0.1,)])
    @pytest.mark.parametrize("remissions", [(), (11, 12, 13)])
    def test_the_line_has_its_own_angles(self, remissions, turn_axis):
        readings = read(robot_laser([1, 2, 3], remissions=remissions, turn_axis=turn_axis))
        np.testing.assert_allclose(readings.angle, [0.0, 0.25, 0.5])
        np.testing.assert_array_equal(readings.range, [1, 2, 3])
        np.testing.assert_array_equal(readings.origin[0], [1, 2])
        np.testing.assert_array_equal(readings.time, [7.5] * 3)

    @pytest.mark.parametrize(
        ("top", "expected", "largest"), [(20.0, [2, np.inf, np.inf], 20.0), (0.0, [2, 20, 81], 81)]
    )
    def test_at_or_above_the_stated_maximum_is_no_return(self, top, expected, largest):
        line = robot_laser([2, 20, 81]).replace(" 20.0 0.01 ", f" {top} 0.01 ")
        readings = read(line)
        np.testing.assert_array_equal(readings.range, expected)
        assert describe(readings, "a").largest_range == largest
        returns = read(robot_laser([2, 3, 4]))
        assert describe(returns, "a").largest_range == 4.0

    def test_remission_values_are_not_read_as_numbers(self):
        assert read(robot_laser([1, 2], remissions=("a", "b"))).n_beams == 2


class TestRanges:
    def test_no_return_numbers_stay_as_they_are(self):
        readings = read(flaser([81.91, 51.16, 50, "inf"]))
        np.testing.assert_array_equal(readings.range, [81.91, 51.16, 50, np.inf])
        assert readings.largest_range == 81.91

    def test_range_zero_is_dropped_and_counted_and_leaves_a_gap(self):
        readings = read(flaser([1, 0, 0.0, 2]))
        np.testing.assert_array_equal(readings.range, [1, 2])
        np.testing.assert_array_equal(readings.beam, [0, 3])
        assert readings.notes.n_zero_ranges == 2
        assert readings.notes.scans.n_beams[0] == 4

    def test_only_zeros_are_no_measurement(self):
        assert "every range is 0" in refusal(flaser([0, 0]))


class TestDamage:
    @pytest.mark.parametrize(
        ("line", "words"),
        [
            (flaser([1.5] * 180)[:300], "announces 180 readings, which makes 191 fields"),
            (flaser([1, 2], announced=3), "announces 3 readings"),
            (flaser([1, 2], announced="x"), "invalid literal"),
            ("FLASER\n", "ends too early"),
            (flaser([1, "1,5"]), "could not convert"),
            (flaser([1, -4.2]), "range is -4.2"),
            (flaser([1], pose=("nan", 0, 0)), "x is nan"),
            (flaser([1], time="1e300"), "t is 1e+300"),
            (robot_laser([1] * 181, step=1.0), "181 beams from -0.5 in steps of 1 rad: expected different directions"),
            (robot_laser([1, 2, 3])[:-9], "announces 3 readings and 0 remission values"),
        ],
    )
    def test_a_damaged_line_is_named(self, line, words):
        message = refusal(flaser([1, 2]) + "NEFF 3\n" + line)
        assert message.startswith("a.log:3: ")
        assert words in message
        assert message.endswith("run again.")

    def test_a_log_without_laser_poses_names_what_it_has(self):
        message = refusal("PARAM a b nohost 0\n" + "RAWLASER1 0 0 0 0 0 0 0 1 1 0 3 host 3\n" * 2)
        assert "2 RAWLASER1, 1 PARAM" in message


class TestTime:
    def test_the_scanners_clock_counts_and_ties_are_kept(self):
        text = flaser([1], time="1.01893e+09") + flaser([1], time="1.01893e+09")
        np.testing.assert_array_equal(read(text).time, [1.01893e9] * 2)
        fields = flaser([1]).split()
        fields[-1] = "99"
        assert read(" ".join(fields)).time[0] == 5.0


class TestOdometry:
    def test_laser_lines_take_the_poses_of_another_frame_with_the_laser_where_it_sits(self):
        odometry = "ODOM 10 0 0 0 0 0 1 pippo 1\nODOM 12 0 0 0 0 0 3 pippo 3\n"
        lines = flaser([4], (0.5, 0, 0), (0.3, 0, 0), time=2) + flaser([4], (1.5, 0, 0), (1.3, 0, 0), time=3)
        readings = read_carmen((odometry + lines).encode(), "a.log", frame="ODOM", odometry=True)
        np.testing.assert_allclose(readings.origin, [[11.2, 0], [12.2, 0]])
        assert readings.notes.poses == "ODOM, interpolated in time"
        assert "drifts" in readings.notes.remarks[-1]

    def test_raw_laser_lines_take_odometry_where_that_is_allowed(self):
        text = "Odometry 1 2 0\nLaser 2 3 3\nOdometry 1 3 1.5\nLaser 2 3 3\n"
        readings = read_carmen(text.encode(), "a.log", odometry=True)
        np.testing.assert_allclose(readings.notes.scans.pose, [[1, 2, 0], [1, 3, 1.5]])
        with pytest.raises(InputError, match="no FLASER"):
            read(text)


RING = ((0.1, 0.2, 0.5), (0.1, -0.2, -0.5))
OFFSETS = "PARAM robot_sonar_offsets 0.1 0.2 0.5 0.1 -0.2 -0.5 nohost 0\n"


def odom(x: float, y: float, heading: float, time: float, kind: str = "ODOM") -> str:
    return f"{kind} {x} {y} {heading} 0 0 0 {time} host {time}\n"


def sonar(ranges, time: float = 2.0, cone: object = 0.3, ring=RING) -> str:
    """Return a line as CARMEN's logger writes it."""
    fields = ["SONAR", cone, len(ranges), *ranges, *(value for site in ring for value in site), time, "host", time]
    return " ".join(map(str, fields)) + "\n"


def old_sonar(ranges, pose=(1, 2, 0.5), time: float = 2.0) -> str:
    """Return a line of the older layout, that of FLASER."""
    return flaser(ranges, pose, time=time, kind="SONAR")


def read_ring(text: str, **options) -> Readings:
    return read_carmen(text.encode(), "a.log", "sonar", **options)


def sonar_refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        read_ring(text)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def expected(x: float, y: float, heading: float):
    cosine, sine = np.cos(heading), np.sin(heading)
    return [[x + cosine * u - sine * v, y + sine * u + cosine * v] for u, v, _ in RING]


def test_the_documented_line():
    readings = read_ring("# SONAR is documented\n" + odom(0, 0, 0, 1) + sonar([1.5, 2.5]) + odom(2, 0, 1, 3))
    np.testing.assert_allclose(readings.origin, expected(1, 0, 0.5))
    np.testing.assert_allclose(readings.angle, [1.0, 0.0], atol=1e-12)
    assert readings.range.tolist() == [1.5, 2.5]
    assert readings.cone.tolist() == [0.3, 0.3]
    assert readings.beam.tolist() == [0, 1]
    notes = readings.notes
    assert (notes.ring, notes.devices, notes.lines) == (RING, ("SONAR",), {"comment": 1, "ODOM": 2})
    assert notes.poses == "ODOM, interpolated in time"
    assert "odometry" in notes.remarks[0]


def test_the_older_line_has_the_pose_and_takes_the_ring_from_a_parameter():
    for text in (OFFSETS + old_sonar([1.5, 2.5]), old_sonar([1.5, 2.5]) + OFFSETS):
        readings = read_ring(text)
        np.testing.assert_allclose(readings.origin, expected(1, 2, 0.5))
        np.testing.assert_allclose(readings.angle, [1.0, 0.0], atol=1e-12)
        assert readings.cone.tolist() == [0.349, 0.349]
        assert readings.notes.poses == "in the log"
        assert readings.notes.remarks == ()
    assert read_ring(OFFSETS + old_sonar([1.5, 2.5]), cone=0.5).cone.tolist() == [0.5, 0.5]


@pytest.mark.parametrize("end", ["", " 1234.5 host 0.1", " 1234.5 10.0.0.1 0.1"])
def test_a_parameter_line_of_the_logger_may_end_in_time_and_host(end):
    text = f"PARAM base_sonar_offsets 0.1 0.2 0.5 0.1 -0.2 -0.5{end}\n" + old_sonar([1, 1])
    assert read_ring(text).notes.ring == RING


@pytest.mark.parametrize("n", [8, 16])
def test_without_offsets_a_pioneer_is_assumed(n):
    readings = read_ring(old_sonar([1.0] * n, (0, 0, 0)))
    np.testing.assert_allclose(readings.origin, PIONEER[:n, :2], atol=1e-12)
    assert "Pioneer" in readings.notes.remarks[0]


def test_a_cone_of_zero_is_none():
    assert read_ring(odom(0, 0, 0, 1) + sonar([1, 1], cone="0.000000")).cone.tolist() == [0.349] * 2


def test_ranges_of_zero_are_dropped():
    readings = read_ring(OFFSETS + old_sonar([0, 2.5]))
    assert (readings.beam.tolist(), readings.notes.n_zero_ranges) == ([1], 1)


class TestSonarPoses:
    def test_laser_lines_come_first_so_that_both_kinds_are_in_one_frame(self):
        text = odom(9, 9, 0, 1) + odom(9, 9, 0, 1, "GLOBALPOS") + flaser([1], (1, 0, 0), time=1)
        readings = read_ring(text + sonar([1, 1]) + flaser([1], (3, 0, 0), time=3))
        np.testing.assert_allclose(readings.origin, expected(2, 0, 0))
        assert readings.notes.poses == "laser lines, interpolated in time"
        for name, x in (("ODOM", 9), ("GLOBALPOS", 9), ("laser lines", 2)):
            assert read_ring(text + sonar([1, 1]) + flaser([1], (3, 0, 0), time=3), frame=name).origin[0, 0] == x + 0.1
        with pytest.raises(ConfigError, match="laser lines, GLOBALPOS, ODOM"):
            read_ring(text + sonar([1, 1]), frame="TRUEPOS")

    @pytest.mark.parametrize(("first", "second"), [("GLOBALPOS", "TRUEPOS"), ("TRUEPOS", "ODOM")])
    def test_order_of_the_others(self, first, second):
        readings = read_ring(odom(9, 0, 0, 1, second) + odom(1, 0, 0, 1, first) + sonar([1, 1]))
        assert readings.notes.poses.startswith(first)
        assert readings.origin[0, 0] == 1.1

    def test_the_robots_pose_is_taken_where_the_laser_sits_ahead_of_it(self):
        def laser(x, heading, time):
            pose = (x + 0.3 * np.cos(heading), 0.3 * np.sin(heading), heading)
            return flaser([1], pose, (x, 0, heading), time=time)

        readings = read_ring(laser(0, 0, 1) + sonar([1, 1]) + laser(2, 1, 3))
        np.testing.assert_allclose(readings.origin, expected(1, 0, 0.5))
        assert readings.notes.remarks == ()

    def test_the_lasers_pose_is_taken_where_the_robots_is_uncorrected(self):
        def laser(x, time):
            return flaser([1], (x, 0, 0), (3 * x, 1, 0.3), time=time)

        readings = read_ring(laser(0, 1) + sonar([1, 1]) + laser(2, 3))
        np.testing.assert_allclose(readings.origin, expected(1, 0, 0))
        assert "another frame" in readings.notes.remarks[0]

    def test_only_the_first_laser_gives_poses(self):
        rear = flaser([1], (5, 5, 3.1), (5, 5, 0), time=2.5, kind="RLASER")
        readings = read_ring(flaser([1], (0, 0, 0), time=1) + rear + sonar([1, 1]) + flaser([1], (2, 0, 0), time=3))
        np.testing.assert_allclose(readings.origin, expected(1, 0, 0))

    def test_tied_time_stamps_give_the_last_pose_before(self):
        readings = read_ring(odom(0, 0, 0, 5) + odom(1, 0, 0, 5) + sonar([1, 1], 5) + odom(7, 0, 0, 5))
        np.testing.assert_allclose(readings.origin, expected(1, 0, 0))


class TestRefusals:
    @pytest.mark.parametrize(
        ("line", "words"),
        [
            ("SONAR 0.3\n", "ends too early"),
            (sonar([1, 2]).rsplit(" ", 1)[0] + "\n", "announces 2 readings, which makes 14 fields, but has 13"),
            (old_sonar([1, 2]).rsplit(" ", 1)[0] + "\n", "announces 2 readings, which makes 13 fields, but has 12"),
            (sonar([1, -2]), "range is -2"),
            (sonar([1, 2], cone="9.5"), "cone is 9.5"),
            ("ODOM 1 2 3\n", "ends too early"),
        ],
    )
    def test_a_damaged_line_is_named(self, line, words):
        message = sonar_refusal(odom(0, 0, 0, 1) + line + sonar([1, 1]))
        assert message.startswith("a.log:2: ")
        assert words in message

    def test_no_geometry(self):
        message = sonar_refusal(old_sonar([1, 1, 1]))
        assert message.startswith("a.log:1: the log does not give the positions of its 3 transducers")
        assert "3 transducers" in sonar_refusal(OFFSETS + old_sonar([1, 1, 1]))

    def test_no_poses(self):
        assert "no line that has one" in sonar_refusal(sonar([1, 1]))
        assert "no reading lies within the time" in sonar_refusal(
            odom(0, 0, 0, 1) + odom(1, 0, 0, 2) + sonar([1, 1], 60)
        )

    def test_no_sonar(self):
        with pytest.raises(NoReadings):
            read_ring(odom(0, 0, 0, 1))
