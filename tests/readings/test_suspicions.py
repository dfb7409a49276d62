from __future__ import annotations

import dataclasses
import logging

import numpy as np
import pytest

from prf.readings.describe import find_spoiling, warn_of_spoiling
from prf.readings.readings import Readings
from prf.readings.table import read_table
from prf.readings.thinning import thin
from tests.readings.test_describe import drive, straight, summary_of


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
    def test_a_turn_is_given_in_radians(self):
        poses = [(x, y, 1.3 * (i >= 4)) for i, (x, y, _) in enumerate(straight(8, 0.05))]
        assert jump_in(drive(poses, seconds=0.1)).endswith("the largest by 74 degrees at scan 4")

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

    def test_arrays_without_scans_or_beams(self, caplog):
        readings = Readings.from_arrays((0.0, 0.0), [0.1, 0.2], [1.0, 2.0])
        assert warnings_of(caplog, readings) == []
        assert warnings_of(caplog, dataclasses.replace(readings.select(np.zeros(2, dtype=bool)))) == []
