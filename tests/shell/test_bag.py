from __future__ import annotations

from pathlib import Path

import pytest

from prf.shell.bag import bag_in, bag_suffix, named_bag
from prf.shell.errors import InputError


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


def test_a_bag_gets_a_name_that_tells_its_format(tmp_path: Path) -> None:
    file = tmp_path / "recording"
    file.write_bytes(b"content")
    with named_bag(file, ".bag") as path:
        assert (path.suffix, path.read_bytes()) == (".bag", b"content")
    assert not path.exists()
    right = file.rename(tmp_path / "recording.bag")
    with named_bag(right, ".bag") as path:
        assert path == right
