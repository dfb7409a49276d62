"""Paths from CSV files: waypoints and poses, and where they cannot be driven."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shapely import box

from prf.shell.errors import InputError
from prf.simulate import World
from prf.simulate.path_file import PathFile, read_path
from prf.window import Window

WORLD = World.from_polygons(box(4.0, 1.0, 5.0, 7.0), Window(0.0, 0.0, 10.0, 8.0))


def written(folder: Path, text: str) -> PathFile:
    (folder / "path.csv").write_text(text)
    return read_path(folder / "path.csv")


def test_columns_by_name_or_in_order(tmp_path: Path) -> None:
    named = written(tmp_path, "u,theta,y,x\n# drive\n\n0,1.5,2,3\n1,-1,4,5\n")
    assert named.rows.tolist() == [[3.0, 2.0, 1.5], [5.0, 4.0, -1.0]]
    assert named.line.tolist() == [4, 5]
    assert named.has_headings
    assert written(tmp_path, "1, 2\n3, 4\n").rows.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert not written(tmp_path, "y,x,name\n1,2,a\n").has_headings
    assert not written(tmp_path, "x,y,t\n1,2,5\n").has_headings
    assert written(tmp_path, "1,2,0.5\n").has_headings


def test_poses_are_scans_as_they_stand(tmp_path: Path) -> None:
    scans = written(tmp_path, "x,y,theta\n1,1,0\n2,1,3\n2,2,-3\n").scans()
    assert scans.pose.tolist() == [[1.0, 1.0, 0.0], [2.0, 1.0, 3.0], [2.0, 2.0, -3.0]]
    # 2 s a metre, 1 s a radian
    assert scans.time == pytest.approx([0.0, 5.0, 7.0 + 2.0 * np.pi - 6.0], abs=1e-3)
    timed = written(tmp_path, "t,x,y,theta\n0.5,1,1,0\n9.25,2,1,3\n").scans()
    assert timed.time.tolist() == [0.5, 9.25]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n", "no waypoint"),
        ("", "no waypoint"),
        ("x,y\n1,2\n1\n", r"path\.csv:3: '1' is no waypoint"),
        ("x,y,theta\n1,2,nan\n", r"path\.csv:2"),
        ("x,y\n1,two\n", r"path\.csv:2"),
        ("name\nx\n", r"path\.csv:1"),
    ],
)
def test_what_is_no_path_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        written(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,1\n4.5,2\n", r"path\.csv:3: \(4\.5, 2\) is occupied or outside"),
        ("x,y\n1,1\n-1,2\n", r"path\.csv:3"),
        ("x,y\n1,2\n2,2\n\n8,2\n", r"path\.csv:5: the way from the waypoint of line 3 runs into a wall"),
    ],
)
def test_ways_into_walls_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        written(tmp_path, text).check(WORLD)


def test_poses_may_lie_on_both_sides_of_a_wall(tmp_path: Path) -> None:
    written(tmp_path, "x,y,theta\n1,2,0\n8,2,0\n").check(WORLD)
