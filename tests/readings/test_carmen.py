from __future__ import annotations

import numpy as np
import pytest

from prf.readings import describe
from prf.readings.carmen import read_carmen
from prf.readings.robot import half_circle
from prf.shell.errors import InputError
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

    def test_thousands_of_odd_kinds_are_cut(self):
        odd = read(flaser([1]) + "".join(f"x{i} 1\n" for i in range(500))).notes.odd_lines
        assert len(odd) == 20

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
            (robot_laser([1] * 181, step=1.0), "181 beams from -0.5 in steps of 1 rad are no scan"),
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
