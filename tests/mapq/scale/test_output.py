"""The result of a map in tiles moves to its place: nothing of two results ever stands together."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import read_cloud
from mapq.scale.label import _open_ply
from mapq.scale.output import Output, publish
from prf.shell import files
from prf.shell.errors import OutputError


def make_work(folder: Path) -> tuple[Path, Output]:
    """Return a work folder with a cloud that is made, and where it goes, beside the JSON of an older result."""
    work = folder / "work"
    work.mkdir()
    (work / "made_a.ply").write_text("new")
    (folder / "a.ply").write_text("old")
    (folder / "a.json").write_text("old")
    return work, Output(str(folder / "a.ply"), False, {str(folder / "a.ply"): [0]}, str(folder / "a.json"))


def test_both_are_replaced(tmp_path: Path) -> None:
    work, output = make_work(tmp_path)
    publish(str(work), output, {"tiles": 3}, [{"patch": 0}])
    assert (tmp_path / "a.ply").read_text() == "new"
    assert json.loads((tmp_path / "a.json").read_text())["tiles"] == 3


def test_tiles_of_other_fields_are_not_mixed_in_one_cloud(tmp_path: Path) -> None:
    xyz, path = np.eye(3), str(tmp_path / "a.ply")
    first, same, other, large = (
        PointCloud.from_world(xyz, fields, f"{number}.laz")
        for number, fields in enumerate(
            [
                {"truth": np.arange(3)},
                {"truth": np.arange(3, 6)},
                {"quality": np.arange(3)},
                {"truth": np.arange(3) + 2**31},
            ]
        )
    )
    for strange, words in ((other, r"2\.laz has other fields"), (large, r"field truth of 3\.laz does not fit")):
        with _open_ply(path, 6) as ply:
            ply.write(first)
            with pytest.raises(OutputError, match=words):
                ply.write(strange)
    wide = PointCloud.from_world(xyz, {"height": np.array([1.5, np.nan, 2.0])})
    with _open_ply(path, 6) as ply:
        ply.write(PointCloud.from_world(xyz, {"height": np.zeros(3, np.float32)}))
        ply.write(wide)
    np.testing.assert_array_equal(read_cloud(path).fields["height"], [0.0, 0.0, 0.0, 1.5, np.nan, 2.0])
    with _open_ply(path, 6) as ply:
        ply.write(first)
        ply.write(same)
    assert read_cloud(path).fields["truth"].tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("name", ["a.ply", "a.json"])
def test_interrupted_in_between_the_old_ones_come_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    def replace(source: str, target: str | Path) -> None:
        if Path(target).name == name:
            raise KeyboardInterrupt
        os.rename(source, target)

    work, output = make_work(tmp_path)
    monkeypatch.setattr(files.os, "replace", replace)
    with pytest.raises(KeyboardInterrupt):
        publish(str(work), output, {"tiles": 3}, [{"patch": 0}])
    assert (tmp_path / "a.ply").read_text() == (tmp_path / "a.json").read_text() == "old"


def test_an_error_before_leaves_the_old_ones(tmp_path: Path) -> None:
    work, output = make_work(tmp_path)
    with pytest.raises(ZeroDivisionError):
        publish(str(work), output, {"tiles": 3}, ({"patch": 1 // n} for n in (1, 0)))
    assert (tmp_path / "a.ply").read_text() == (tmp_path / "a.json").read_text() == "old"
