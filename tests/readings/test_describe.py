from __future__ import annotations

import dataclasses
import logging

import numpy as np
import pytest

from prf.model.sensors import SonarModel
from prf.readings import describe
from prf.readings.carmen import read_carmen
from prf.readings.describe import default_max_range, find_spoiling, warn_of_spoiling
from prf.readings.ground import thin
from prf.readings.readings import LogNotes, Readings
from prf.readings.table import read_table
from tests.readings.samples import flaser


def summary_of(text: str):
    return describe(read_carmen(text.encode(), "a.log"), "a.log")


def test_the_largest_float_is_no_return():
    """Some drivers write it so; taken for a range it would be the maximum of the sensor."""
    rows = "".join(f"0,0,{beam},{distance}\n" for beam, distance in enumerate([2.0, 3.4028235e38, 1e300, 4.0]))
    readings = read_table(b"x,y,theta,range\n" + rows.encode(), "a.csv")
    assert readings.range.tolist() == [2.0, np.inf, np.inf, 4.0]
    assert default_max_range(readings) == pytest.approx(0.97 * 4.0)
    of_driver = dataclasses.replace(readings, notes=dataclasses.replace(readings.notes, sensor_max=3.4028235e38))
    assert default_max_range(of_driver) == pytest.approx(0.97 * 4.0)
    assert default_max_range(dataclasses.replace(readings, notes=LogNotes(sensor_max=8.0))) == pytest.approx(0.97 * 8.0)


def drive(poses, seconds=1.0, kind="FLASER", n=3):
    return "".join(flaser([1.0] * n, pose, time=seconds * i, kind=kind) for i, pose in enumerate(poses))


def straight(n, step=0.5):
    return [(step * i, 0, 0) for i in range(n)]


def found(text: str) -> dict[str, tuple[int, ...]]:
    return {suspicion.code: suspicion.scans for suspicion in summary_of(text).suspicions}


class TestSummary:
    def test_counts_extents_and_shares(self):
        text = flaser([2, 3, 10], (0, 0, 0), time=1) + flaser([1, 81.83, 80], (3, 4, 0), time=11)
        summary = summary_of(text)
        assert (summary.n_scans, summary.n_beams, summary.beams_per_scan) == (2, 6, (3, 3))
        assert summary.path_extent == (0, 0, 3, 4)
        assert summary.path_length == 5
        assert summary.returns_extent == pytest.approx((0, -2, 3, 10), abs=1e-9)
        assert summary.duration == 10
        assert summary.largest_range == 81.83
        assert summary.max_range == pytest.approx(0.97 * 81.83)
        assert summary.share_no_return == pytest.approx(2 / 6)
        assert summary.share_far == pytest.approx(3 / 6)

    def test_sonars_have_the_maximum_of_their_model_and_no_echo_is_not_far(self):
        rows = "".join(f"1,2,0,{echo},0.349\n" for echo in ("0.9", "2.1", "9.0", ""))
        summary = describe(read_table(b"x,y,theta,range,cone\n" + rows.encode(), "a"), "a")
        assert (summary.largest_range, summary.max_range) == (9.0, SonarModel().max_range)
        assert (summary.share_no_return, summary.share_far) == (0.5, 0.0)

    def test_a_table_without_returns_times_or_headings(self):
        summary = describe(read_table(b"x,y,theta,range\n1,2,0,\n1,2,1,\n", "a"), "a")
        assert summary.returns_extent is None
        assert np.isnan([summary.duration, summary.largest_range, summary.max_range]).all()
        assert summary.share_no_return == 1
        assert [suspicion.code for suspicion in summary.suspicions] == ["no-return"]


class TestSuspicions:
    def test_an_ordinary_drive_has_none(self):
        assert found(drive(straight(30))) == {}

    def test_a_jump_in_place(self):
        poses = straight(10) + [(x + 3, y, h) for x, y, h in straight(20)[10:]]
        assert found(drive(poses)) == {"pose-jump": (10,)}

    def test_a_turn_too_fast(self):
        poses = [(x, y, 1.3 * (i >= 4)) for i, (x, y, _) in enumerate(straight(8, 0.05))]
        assert found(drive(poses, seconds=0.1)) == {"pose-jump": (4,)}
        assert found(drive(poses, seconds=2.0)) == {}

    def test_a_heading_that_wraps_is_no_turn(self):
        poses = [(x, y, 3.1 if i % 2 else -3.1) for i, (x, y, _) in enumerate(straight(9))]
        assert found(drive(poses, seconds=0.5)) == {}

    def test_front_and_rear_laser_are_followed_apart(self):
        text = "".join(
            flaser([1.0] * 3, (x, y, h), time=i) + flaser([1.0] * 3, (x - 0.2, y, np.pi), time=i, kind="RLASER")
            for i, (x, y, h) in enumerate(straight(20))
        )
        assert found(text) == {}

    def test_a_clock_that_stops_or_runs_backward(self):
        times = [0, 1, 1, 2, 1.5, 3]
        text = "".join(flaser([1.0], (0.5 * i, 0, 0), time=t) for i, t in enumerate(times))
        assert found(text) == {"time-backward": (4,), "time-tied": ()}

    def test_ranges_in_millimetres(self):
        assert "range-unit" in found(flaser([1410, 1500, 900], (0.5, 0, 0)))
        assert "range-unit" not in found(flaser([81.83, 1.5, 81.83], (0.5, 0, 0)))

    def test_ranges_of_zero_and_ranges_that_no_laser_has(self):
        assert found(flaser([0, 1, 3.4e5])) == {"zero-range": (), "largest-range": ()}

    def test_headings_in_degrees(self):
        assert "angle" in found(flaser([1.0], (0, 0, 270.0)))

    def test_lines_of_unknown_kinds(self):
        summary = summary_of(drive(straight(3)) + "GARBAGE 1\n" * 4 + "SONAR 1\n")
        assert [s.message for s in summary.suspicions] == ["lines of unknown kinds were skipped: 4 GARBAGE"]
        assert summary.odd_lines == {"GARBAGE": 4}
        assert summary.lines == {"SONAR": 1}

    def test_long_lists_are_cut_in_the_message_alone(self):
        poses = [(x + 3 * (i // 5), y, h) for i, (x, y, h) in enumerate(straight(60))]
        (jump,) = (s for s in summary_of(drive(poses)).suspicions if s.code == "pose-jump")
        assert len(jump.scans) == 11
        assert "5, 10, 15, 20, 25, 30, 35, 40 ... (11 in all)" in jump.message

    def test_beams_without_return_that_count_as_free_too_far(self):
        text = "".join(flaser([1.0, 5.3, 81.91], pose, time=i) for i, pose in enumerate(straight(20)))
        summary = summary_of(text)
        assert (summary.largest_return, summary.max_range_advice) == (5.3, 6.0)
        assert summary_of(text.replace("81.91", "7.5")).max_range_advice is None


def table(rows: list[tuple[float, ...]], header: str = "x,y,theta,range") -> Readings:
    return read_table("\n".join([header, *(",".join(map(repr, row)) for row in rows)]).encode(), "a.csv")


def codes(readings: Readings) -> list[str]:
    return [suspicion.code for suspicion in find_spoiling(readings)]


def jump_in(text: str) -> str:
    return next(each.message for each in summary_of(text).suspicions if each.code == "pose-jump")


def warnings_of(
    caplog: pytest.LogCaptureFixture, readings: Readings, used: Readings | None = None, **more
) -> list[str]:
    with caplog.at_level(logging.WARNING, logger="prf"):
        warn_of_spoiling(readings, used or readings, **{"kind": "laser", "max_range": None, **more})
    return [record.getMessage() for record in caplog.records]


class TestJumps:
    def test_a_step_is_given_in_metres_and_both_where_both_jump(self):
        poses = [(x + 3 * (i >= 10), y, 1.3 * (i >= 15)) for i, (x, y, _) in enumerate(straight(20))]
        assert jump_in(drive(poses[:14])).endswith("the largest by 3.5 m at scan 10")
        assert jump_in(drive(poses, seconds=0.3)).endswith(
            "the largest by 3.5 m at scan 10 and by 74 degrees at scan 15"
        )


class TestUnits:
    def test_ranges_in_millimetres_are_reported_once(self):
        assert codes(table([(0, 0, 0.1 * i, 1400.0 + i) for i in range(20)])) == ["range-unit"]

    def test_echoes_in_centimetres(self):
        rows = [(0, 0, 0.1 * i, 80.0 + i, 0.349) for i in range(20)]
        assert codes(table(rows, "x,y,theta,range,cone")) == ["range-unit"]
        assert codes(table([row[:4] for row in rows])) == []

    def test_positions_in_millimetres_are_no_jumps(self):
        assert codes(table([(250.0 * i, 0, 0.1 * i, 1.5, 0.1 * i) for i in range(20)], "x,y,theta,range,t")) == [
            "pose-unit"
        ]

    @pytest.mark.parametrize(
        ("theta", "is_degrees"),
        [
            (np.arange(-90.0, 91.0), True),
            (np.arange(-9.0, 10.0), True),
            (np.arange(0.0, 6.0), False),
            (np.linspace(-6.4, 6.4, 50), False),
            (np.linspace(-90.0, 90.0, 50), True),
        ],
    )
    def test_angles_in_degrees(self, theta, is_degrees):
        """Whole numbers beyond 2 pi, or any beyond 4 pi."""
        assert codes(table([(0, 0, float(angle), 1.5) for angle in theta])) == ["angle"] * is_degrees


class TestWarnings:
    def test_a_sane_log_has_none(self, caplog, data_dir):
        from prf.readings import read_readings

        assert warnings_of(caplog, read_readings(str(data_dir / "demo-office.log.gz"))) == []

    def test_what_does_no_harm_has_none(self, caplog):
        """Range 0 is dropped, a clock is not used."""
        rows = [(0.1 * i, 0, 0.1, float(i % 2), 5.0 - i) for i in range(20)]
        readings = table(rows, "x,y,theta,range,t")
        assert warnings_of(caplog, readings) == []

    def test_a_sonar_is_no_laser(self, caplog):
        readings = table([(0, 0, 0.1, 1.5, 0.349)], "x,y,theta,range,cone")
        (warning,) = warnings_of(caplog, readings)
        assert warning.startswith("a.csv: ")
        assert "--sonar" in warning
        caplog.clear()
        assert warnings_of(caplog, readings, kind="sonar") == []

    def test_a_jump_counts_where_it_is_used(self, caplog):
        readings = table([(0.1 * i + 9 * (i >= 10), 0, 0.1, 1.5, i) for i in range(20)], "x,y,theta,range,scan")
        (warning,) = warnings_of(caplog, readings)
        assert "jumps before scan 10" in warning
        caplog.clear()
        assert warnings_of(caplog, readings, thin(readings, scans="0:10")) == []
        assert warnings_of(caplog, readings, thin(readings, scans="10:20")) == []
        assert len(warnings_of(caplog, readings, thin(readings, every_scan=4))) == 1

    def test_a_largest_range_counts_where_it_is_taken(self, caplog):
        readings = table([(0, 0, 0.1 * i, 65535.0 if i == 7 else 1.5) for i in range(20)])
        assert warnings_of(caplog, readings, max_range=8.0) == []
        (warning,) = warnings_of(caplog, readings)
        assert "maximum range" in warning
