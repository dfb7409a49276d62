"""The public corrected logs: 11 CARMEN files with every oddity that the reader knows."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from prf.readings import describe, read_poses, read_readings
from prf.readings.readings import half_circle
from prf.shell.errors import InputError, PrfError
from tests.readings.samples import save

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
    assert {suspicion.code for suspicion in summary.suspicions} <= {"time-tied", "time-backward"}


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


def test_scans_of_a_drifting_log_with_the_poses_of_the_corrected_one(carmen, tmp_path):
    name = str(carmen / "freiburg-101-corrected.log.gz")
    right = read_readings(name)
    pose, time = right.notes.scans.pose, right.notes.scans.time
    text = gzip.decompress(Path(name).read_bytes()).decode()
    lines = [line.split() for line in text.splitlines() if line.startswith("FLASER")]
    drifting = [[*line[:362], *[str(0.1 * k)] * 6, *line[368:]] for k, line in enumerate(lines)]
    log = save(tmp_path, "".join(" ".join(line) + "\n" for line in drifting))
    half, zero = pose[:, 2] / 2, np.zeros(len(pose))
    np.savetxt(tmp_path / "tum", np.column_stack([time, pose[:, :2], *[zero] * 3, np.sin(half), np.cos(half)]))
    np.savetxt(tmp_path / "csv", np.column_stack([time, pose]), delimiter=",", header="t,x,y,theta", comments="")
    for file in ("tum", "csv"):
        found = read_readings(log, poses=read_poses(str(tmp_path / file), 2.0))
        np.testing.assert_allclose(found.origin, right.origin, atol=1e-12)
        np.testing.assert_allclose(np.exp(1j * found.angle), np.exp(1j * right.angle), atol=1e-12)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("unlocalized/loop5.log.gz", "unlocalized"),
        ("ros1/scan_tools-laser_scan_splitter-demo.bag", "before 1.3"),
        ("ros1/scan_tools-laser_scan_matcher-demo.bag", "of a version that cannot be read"),
        ("ros1/meeting.pgm", "PGM"),
        ("tof4/olsson-demo.log", r"/crazyflie2/state_ranger_qxyzw \(RawData\)"),
        ("maps/intel_map.png", "PNG"),
        ("arak/test.cf", "unknown format"),
        ("sonar/corridor8/poses.txt", "unknown format"),
    ],
)
def test_what_is_no_log_of_ours_is_refused(shared_data, path, words):
    with pytest.raises(InputError, match=words):
        read_readings(str(shared_data / "prf" / path))


def test_raw_odometry_is_read_where_it_is_expected(shared_data):
    readings = read_readings(str(shared_data / "prf/unlocalized/loop5.log.gz"), odometry=True)
    assert (readings.n_scans, readings.n_beams) == (551, 551 * 181)
    assert "drifts" in readings.notes.remarks[0]


READ = re.compile(r"carmen/.*|player/.*|ros1/(trace0|simpath2)\.bag")


def test_every_file_is_read_or_refused_in_one_line(shared_data):
    folder = shared_data / "prf"
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_dir() or name.startswith("carmen/"):
            continue
        if READ.match(name):
            assert read_readings(str(path), None).n_beams > 0
        else:
            with pytest.raises(PrfError) as caught:
                read_readings(str(path), None)
            assert "\n" not in str(caught.value)


def test_player(shared_data):
    readings = read_readings(str(shared_data / "prf/player/mydata2021_03_02_17_13_30.log.gz"))
    summary = describe(readings, "player")
    assert (summary.n_scans, readings.n_beams) == (731, 731 * 361)
    assert summary.poses == "position2d:0, interpolated in time"
    assert summary.largest_range == 8.0
    assert summary.max_range == pytest.approx(7.76)
    assert summary.remarks[0].startswith("the poses of position2d:0")
    # A simulated robot: turned by a degree, its walls would blur.
    turned = readings.angle + np.radians(1.0)
    assert occupied_cells(readings, readings.angle) < 0.9 * occupied_cells(readings, turned)


def test_bag_of_a_real_robot(shared_data):
    path = str(shared_data / "prf/ros1/trace0.bag")
    readings = read_readings(path)
    summary = describe(readings, path)
    assert (summary.n_scans, summary.beams_per_scan) == (958, (726, 726))
    # 26 % are nan, 8 % codes such as 0.006, below range_min.
    assert summary.n_invalid / (958 * 726) == pytest.approx(0.345, abs=0.005)
    assert readings.range.min() >= 0.0199
    assert summary.largest_range <= 5.6
    # The robot comes back to the corridor where it began: localized its walls are single, by odometry alone double.
    assert return_gap(readings) < 0.1
    assert return_gap(read_readings(path, frame="odom")) > 0.2


def return_gap(readings) -> float:
    """Return the median distance from end points of the last 100 scans to the nearest of the first 100, metres."""
    first, last = (readings.select(part) for part in (readings.scan < 100, readings.scan >= 858))
    distance, _ = cKDTree(end_points(first)).query(end_points(last)[::10])
    return float(np.median(distance))


def end_points(readings):
    hit = readings.select(np.isfinite(readings.range))
    return hit.origin + hit.range[:, None] * np.column_stack((np.cos(hit.angle), np.sin(hit.angle)))


def test_simulated_bag_against_its_true_map(shared_data):
    folder = shared_data / "prf/ros1"
    pixels = read_pgm(folder / "meeting.pgm")
    readings = read_readings(str(folder / "simpath2.bag"), frame="/base_pose_ground_truth")
    assert describe(readings, "simpath2").largest_range == pytest.approx(5.6)
    row, column = np.nonzero(pixels < 128)
    walls = np.column_stack(((column - 301.0) * 0.05 * 1.0337, (296.3 - row) * 0.05 * 1.0305))
    distance, _ = cKDTree(walls).query(end_points(readings)[::20])
    assert np.mean(distance < 0.1) > 0.9


def read_pgm(path: Path):
    data = path.read_bytes()
    match = re.match(rb"P5\s(?:#[^\n]*\n)*(\d+)\s+(\d+)\s+255\s", data)
    assert match is not None
    width, height = int(match[1]), int(match[2])
    return np.frombuffer(data[match.end() :], dtype=np.uint8).reshape(height, width)
