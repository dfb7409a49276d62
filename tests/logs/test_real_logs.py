"""The public corrected logs: 11 CARMEN files with every oddity that the reader knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from prf.logs import describe, read_readings
from prf.logs.carmen import half_circle
from prf.shell.errors import InputError

# name: scans, beams a scan, width and height of the path in metres, largest range
LOGS = {
    "intel": (910, 180, 26, 26, 81.83),
    "freiburg-079": (4791, 360, 36, 15, 81.91),
    "freiburg-101": (292, 360, 49, 15, 81.91),
    "csail": (406, 361, 43, 58, 81.91),
    "aces": (440, 180, 45, 40, 50.0),
    "belgioioso": (395, 361, 21, 85, 81.91),
    "edmonton": (340, 180, 72, 78, 51.16),
    "fhw": (488, 180, 20, 57, 51.1),
    "acapulco": (861, 181, 93, 44, 51.25),
    "infinite-corridor": (1941, 180, 232, 198, 51.16),
    "freiburg-campus": (2008, 360, 216, 180, 81.91),
}


@pytest.fixture(scope="module")
def carmen(shared_data) -> Path:
    return shared_data / "prf" / "carmen"


@pytest.mark.parametrize("name", LOGS)
def test_counts_and_extent(carmen, name):
    n_scans, n_beams, width, height, largest = LOGS[name]
    readings = read_readings(str(carmen / f"{name}-corrected.log.gz"))
    summary = describe(readings, name)
    assert (readings.n_scans, readings.n_beams) == (n_scans, n_scans * n_beams)
    assert summary.beams_per_scan == (n_beams, n_beams)
    extent = summary.path_extent
    assert extent.x_max - extent.x_min == pytest.approx(width, abs=1)
    assert extent.y_max - extent.y_min == pytest.approx(height, abs=1)
    assert summary.largest_range == largest
    assert (summary.remarks, summary.odd_lines) == ((), {})
    assert {suspicion.code for suspicion in summary.suspicions} <= {"time-tied", "time-backward", "time-span"}


@pytest.mark.parametrize("name", ["intel", "csail", "aces", "freiburg-101"])
def test_the_angle_convention_gives_the_sharpest_map(carmen, name):
    readings = read_readings(str(carmen / f"{name}-corrected.log.gz"))
    n = LOGS[name][1]
    other = -np.pi / 2 + np.arange(n) * np.pi / (n if n % 2 else n - 1)
    turned = readings.angle + np.tile(other - half_circle(n), readings.n_scans)
    assert occupied_cells(readings, readings.angle) < occupied_cells(readings, turned)


def occupied_cells(readings, angle) -> int:
    hit = readings.range < 0.97 * readings.largest_range
    ends = readings.origin + readings.range[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    return len(np.unique(np.floor(ends[hit] / 0.04).astype(np.int64), axis=0))


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("unlocalized/loop5.log.gz", "unlocalized"),
        ("player/mydata2021_03_02_17_13_30.log.gz", "Player"),
        ("ros1/trace0.bag", "ROS 1 bag"),
        ("ros1/scan_tools-laser_scan_splitter-demo.bag", "before 1.0"),
        ("tof4/olsson-demo.log", "ROS 1 bag"),
        ("ros1/meeting.pgm", "PGM"),
        ("maps/intel_map.png", "PNG"),
        ("arak/test.cf", "unknown format"),
    ],
)
def test_what_is_no_log_of_ours_is_refused(shared_data, path, words):
    with pytest.raises(InputError, match=words):
        read_readings(str(shared_data / "prf" / path))
