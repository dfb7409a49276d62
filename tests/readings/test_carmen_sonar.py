from __future__ import annotations

import numpy as np
import pytest

from prf.readings import NoReadings, Readings
from prf.readings.carmen import read_carmen
from prf.readings.robot import PIONEER
from prf.shell.errors import ConfigError, InputError
from tests.readings.samples import flaser

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


def read(text: str, **options) -> Readings:
    return read_carmen(text.encode(), "a.log", "sonar", **options)


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        read(text)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def expected(x: float, y: float, heading: float):
    cosine, sine = np.cos(heading), np.sin(heading)
    return [[x + cosine * u - sine * v, y + sine * u + cosine * v] for u, v, _ in RING]


def test_the_documented_line():
    readings = read("# SONAR is documented\n" + odom(0, 0, 0, 1) + sonar([1.5, 2.5]) + odom(2, 0, 1, 3))
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
        readings = read(text)
        np.testing.assert_allclose(readings.origin, expected(1, 2, 0.5))
        np.testing.assert_allclose(readings.angle, [1.0, 0.0], atol=1e-12)
        assert readings.cone.tolist() == [0.349, 0.349]
        assert readings.notes.poses == "in the log"
        assert readings.notes.remarks == ()
    assert read(OFFSETS + old_sonar([1.5, 2.5]), cone=0.5).cone.tolist() == [0.5, 0.5]


@pytest.mark.parametrize("end", ["", " 1234.5 host 0.1", " 1234.5 10.0.0.1 0.1"])
def test_a_parameter_line_of_the_logger_may_end_in_time_and_host(end):
    text = f"PARAM base_sonar_offsets 0.1 0.2 0.5 0.1 -0.2 -0.5{end}\n" + old_sonar([1, 1])
    assert read(text).notes.ring == RING


@pytest.mark.parametrize("n", [8, 16])
def test_without_offsets_a_pioneer_is_assumed(n):
    readings = read(old_sonar([1.0] * n, (0, 0, 0)))
    np.testing.assert_allclose(readings.origin, PIONEER[:n, :2], atol=1e-12)
    assert "Pioneer" in readings.notes.remarks[0]


def test_a_cone_of_zero_is_none():
    assert read(odom(0, 0, 0, 1) + sonar([1, 1], cone="0.000000")).cone.tolist() == [0.349] * 2


def test_ranges_of_zero_are_dropped():
    readings = read(OFFSETS + old_sonar([0, 2.5]))
    assert (readings.beam.tolist(), readings.notes.n_zero_ranges) == ([1], 1)


class TestPoses:
    def test_laser_lines_come_first_so_that_both_kinds_are_in_one_frame(self):
        text = odom(9, 9, 0, 1) + odom(9, 9, 0, 1, "GLOBALPOS") + flaser([1], (1, 0, 0), time=1)
        readings = read(text + sonar([1, 1]) + flaser([1], (3, 0, 0), time=3))
        np.testing.assert_allclose(readings.origin, expected(2, 0, 0))
        assert readings.notes.poses == "laser lines, interpolated in time"
        for name, x in (("ODOM", 9), ("GLOBALPOS", 9), ("laser lines", 2)):
            assert read(text + sonar([1, 1]) + flaser([1], (3, 0, 0), time=3), frame=name).origin[0, 0] == x + 0.1
        with pytest.raises(ConfigError, match="laser lines, GLOBALPOS, ODOM"):
            read(text + sonar([1, 1]), frame="TRUEPOS")

    @pytest.mark.parametrize(("first", "second"), [("GLOBALPOS", "TRUEPOS"), ("TRUEPOS", "ODOM")])
    def test_order_of_the_others(self, first, second):
        readings = read(odom(9, 0, 0, 1, second) + odom(1, 0, 0, 1, first) + sonar([1, 1]))
        assert readings.notes.poses.startswith(first)
        assert readings.origin[0, 0] == 1.1

    def test_the_robots_pose_is_taken_where_the_laser_sits_ahead_of_it(self):
        def laser(x, heading, time):
            pose = (x + 0.3 * np.cos(heading), 0.3 * np.sin(heading), heading)
            return flaser([1], pose, (x, 0, heading), time=time)

        readings = read(laser(0, 0, 1) + sonar([1, 1]) + laser(2, 1, 3))
        np.testing.assert_allclose(readings.origin, expected(1, 0, 0.5))
        assert readings.notes.remarks == ()

    def test_the_lasers_pose_is_taken_where_the_robots_is_uncorrected(self):
        def laser(x, time):
            return flaser([1], (x, 0, 0), (3 * x, 1, 0.3), time=time)

        readings = read(laser(0, 1) + sonar([1, 1]) + laser(2, 3))
        np.testing.assert_allclose(readings.origin, expected(1, 0, 0))
        assert "another frame" in readings.notes.remarks[0]

    def test_only_the_first_laser_gives_poses(self):
        rear = flaser([1], (5, 5, 3.1), (5, 5, 0), time=2.5, kind="RLASER")
        readings = read(flaser([1], (0, 0, 0), time=1) + rear + sonar([1, 1]) + flaser([1], (2, 0, 0), time=3))
        np.testing.assert_allclose(readings.origin, expected(1, 0, 0))

    def test_tied_time_stamps_give_the_last_pose_before(self):
        readings = read(odom(0, 0, 0, 5) + odom(1, 0, 0, 5) + sonar([1, 1], 5) + odom(7, 0, 0, 5))
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
        message = refusal(odom(0, 0, 0, 1) + line + sonar([1, 1]))
        assert message.startswith("a.log:2: ")
        assert words in message

    def test_no_geometry(self):
        message = refusal(old_sonar([1, 1, 1]))
        assert message.startswith("a.log:1: the log does not give the places of its 3 transducers")
        assert "3 transducers" in refusal(OFFSETS + old_sonar([1, 1, 1]))

    def test_no_poses(self):
        assert "no line that has one" in refusal(sonar([1, 1]))
        assert "no reading lies within the time" in refusal(odom(0, 0, 0, 1) + odom(1, 0, 0, 2) + sonar([1, 1], 60))

    def test_no_sonar(self):
        with pytest.raises(NoReadings):
            read(odom(0, 0, 0, 1))
