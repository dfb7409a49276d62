from __future__ import annotations

import errno
import os
from pathlib import Path
from unittest import mock

import pytest

from prf.shell.errors import InputError
from prf.shell.poses.bag import bag_in, bag_suffix, open_bag


@pytest.mark.parametrize(
    ("head", "suffix"),
    [
        (b"#ROSBAG V2.0\n", ".bag"),
        (b"\x89MCAP0\r\n", ".mcap"),
        (b"SQLite format 3\0", ".db3"),
        (b"#ROSBAG V1.2\n", ""),
        (b"", ""),
    ],
)
def test_bags_are_known_by_their_content(head: bytes, suffix: str) -> None:
    assert bag_suffix(head) == suffix


def test_the_bag_in_a_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"without metadata.yaml and with no bag file. Give a log."):
        bag_in(tmp_path, "Give a log.")
    (tmp_path / "a.mcap").touch()
    assert bag_in(tmp_path, "") == tmp_path / "a.mcap"
    (tmp_path / "b.db3").touch()
    with pytest.raises(InputError, match="with 2 bag files"):
        bag_in(tmp_path, "")
    (tmp_path / "metadata.yaml").touch()
    assert bag_in(tmp_path, "") == tmp_path


def test_a_disk_that_fails_is_not_taken_for_a_damaged_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("rosbags.highlevel.AnyReader.__init__", fail)
    file = tmp_path / "a.bag"
    file.touch()
    with pytest.raises(InputError, match=r"^a log: cannot be read \(input/output error\)\.$"), open_bag(file, "a log"):
        pass


def test_messages_that_lack_what_their_type_has_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rosbags.highlevel.AnyReader", mock.MagicMock())
    monkeypatch.setattr("prf.shell.poses.bag.Bag", mock.MagicMock())
    body = type("sensor_msgs__msg__LaserScan", (), {})()
    words = r"^a log: its sensor_msgs/LaserScan has no range_max\. Record"
    with pytest.raises(InputError, match=words), open_bag(tmp_path, "a log"):
        _ = body.range_max
    with pytest.raises(AttributeError, match="nothing"), open_bag(tmp_path, "a log"):
        _ = tmp_path.nothing  # type: ignore[attr-defined]
