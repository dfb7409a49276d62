"""Several logs of one kind of sensor, joined: nothing is dropped, and each keeps its scans, devices and poses."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from prf.configuration import Configuration
from prf.readings import Readings, join_logs, read_logs, thin
from prf.readings.poses import read_poses
from prf.readings.several import warn_of_frames
from prf.readings.way import sensor_tracks
from prf.sampler.prepare import read_prepared
from prf.shell.errors import ConfigError


def table(path: Path, scans: int, x: float, wall: float = 6.0) -> str:
    """A log of a sensor that drives along a wall, and its name."""
    rows = [
        f"{x + 0.1 * scan},1.0,{theta},{(wall - 1.0) / np.sin(theta)},{scan},{scan}"
        for scan in range(scans)
        for theta in np.linspace(0.8, 2.3, 31)
    ]
    path.write_text("\n".join(["x,y,theta,range,scan,t", *rows]))
    return str(path)


@pytest.fixture
def logs(tmp_path: Path) -> list[str]:
    return [table(tmp_path / "a.csv", 20, 0.0), table(tmp_path / "b.csv", 30, 1.0)]


def test_no_log_is_dropped_and_scan_numbers_go_on(logs: list[str]) -> None:
    laser, sonar = read_logs(logs, [])
    assert sonar is None
    assert laser is not None
    assert laser.n_beams == 50 * 31
    assert laser.lengths == (20, 30)
    assert laser.names == tuple(logs)
    assert np.unique(laser.scan[laser.log == 1]).tolist() == list(range(20, 50))
    assert [len(track) for track in sensor_tracks(laser)] == [20, 30]


def test_scans_are_chosen_in_each_log(logs: list[str]) -> None:
    laser, _ = read_logs(logs, [])
    assert laser is not None
    assert np.unique(thin(laser, every_scan=10).scan).tolist() == [0, 10, 20, 30, 40]
    assert np.unique(thin(laser, scans="-2:").scan).tolist() == [18, 19, 48, 49]
    assert np.unique(thin(laser, skip_scans="1:").scan).tolist() == [0, 20]


def test_two_logs_are_one_with_all_their_rows(logs: list[str], tmp_path: Path) -> None:
    rows = [row.split(",") for row in Path(logs[1]).read_text().splitlines()[1:]]
    later = [",".join([*row[:4], str(int(row[4]) + 20), row[5]]) for row in rows]
    (tmp_path / "both.csv").write_text("\n".join([Path(logs[0]).read_text(), *later]))
    two, one = (read_prepared(each, Configuration.of(every_scan=2)) for each in (logs, [str(tmp_path / "both.csv")]))
    assert two.config == one.config
    assert two.target.laser is not None
    assert one.target.laser is not None
    for name in ("origin", "angle", "range", "scan"):
        np.testing.assert_array_equal(
            getattr(two.target.laser.readings, name), getattr(one.target.laser.readings, name)
        )


def test_each_log_has_the_poses_of_its_own_file(tmp_path: Path) -> None:
    names, files = [], []
    for log, n in (("a.csv", 20), ("b.csv", 30)):
        rows = [f"{theta},5.0,{t},{t}" for t in range(n) for theta in np.linspace(0.8, 2.3, 31)]
        (tmp_path / log).write_text("\n".join(["theta,range,scan,t", *rows]))
        names.append(str(tmp_path / log))
    for name, n, y in (("a.tum", 20, 5.0), ("b.tum", 30, 7.0)):
        rows = [f"{t} {0.1 * t} {y} 0 0 0 0 1" for t in range(n)]
        (tmp_path / name).write_text("\n".join(rows))
        files.append(read_poses(str(tmp_path / name), 2.0))
    laser, _ = read_logs(names, [], poses=files)
    assert laser is not None
    assert set(laser.origin[laser.log == 0, 1]) == {5.0}
    assert set(laser.origin[laser.log == 1, 1]) == {7.0}
    with pytest.raises(ConfigError, match=r"--poses: 2 files for 3 logs of --laser"):
        read_logs([*names, names[0]], [], poses=files)


def test_a_log_in_another_frame_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    good = [Readings.from_arrays(np.zeros((1, 2)), np.zeros(1), np.ones(1))]
    warn_of_frames(good)
    with caplog.at_level(logging.WARNING):
        read_logs([table(tmp_path / "a.csv", 30, 0.0), table(tmp_path / "b.csv", 30, 0.0, 6.02)], [])
        assert not caplog.records
        read_logs([table(tmp_path / "a.csv", 30, 0.0), table(tmp_path / "c.csv", 30, 0.0, 6.6)], [])
    assert "c.csv: of its returns" in caplog.text
    assert "are all in one frame?" in caplog.text


def test_joined_logs_join_again(logs: list[str]) -> None:
    both, _ = read_logs(logs, [])
    assert both is not None
    again = join_logs([both, both])
    assert np.unique(again.log).tolist() == [0, 1, 2, 3]
    assert again.scan.max() == 99
    assert again.names == tuple(logs * 2)
