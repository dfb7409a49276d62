"""One command makes a useful picture, also of a log whose poses are odometry or in a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from prf.output.run import read_run
from tests.cli.calls import call
from tests.readings.bags import LEVEL, START, Maker, Note, yaw
from tests.readings.samples import flaser

WIDTH, DEPTH = 6.0, 4.0
"""Of a room with its corner in the origin."""
N_BEAMS = 36
BEARINGS = np.linspace(-np.pi, np.pi, N_BEAMS, endpoint=False)
AHEAD = np.linspace(-np.pi / 2, np.pi / 2, N_BEAMS + 1)
WAY = np.array([(1.0 + 0.8 * k, 1.0 + 0.4 * k, 0.3 * k) for k in range(6)])
"""Poses of the laser, a second apart."""
SMALL = (
    "--steps 10000 --chains 1 --seed 1 --set sampler.start=grid --max-range 20 --scale 0.2 --window -1 -1 7 5 "
    "--resolution 0.1"
)


def ranges(pose: np.ndarray, bearings: np.ndarray = BEARINGS) -> np.ndarray:
    """Return the distances to the walls of the room."""
    ahead = np.stack([np.cos(pose[2] + bearings), np.sin(pose[2] + bearings)])
    walls = np.array([[0.0, 0.0], [WIDTH, DEPTH]])[:, :, None]
    with np.errstate(divide="ignore"):
        return ((walls - pose[:2, None]) / ahead).max(axis=0).min(axis=0).round(4)


BEAMS = [(pose, angle, far) for pose in WAY for angle, far in zip(AHEAD, ranges(pose, AHEAD), strict=True)]


def carmen(folder: Path, is_right: bool = True) -> str:
    lines = [flaser(ranges(p, AHEAD), p if is_right else (9 - k, 9, 0), time=k) for k, p in enumerate(WAY)]
    (folder / "a.log").write_text("".join(lines))
    return "a.log"


def odometry_bag(folder: Path) -> str:
    make = Maker("ros1")
    step = {"angle_min": BEARINGS[0], "angle_increment": BEARINGS[1] - BEARINGS[0], "range_max": 20.0}
    notes = [Note("/tf_static", START, make.tf(START, "base_link", "laser", (0.0, 0.0, 0.3), LEVEL))]
    for k, pose in enumerate(WAY):
        now = START + k
        notes.append(Note("/tf", now, make.tf(now, "odom", "base_link", (*pose[:2], 0.0), yaw(pose[2]))))
        notes.append(Note("/scan", now, make.scan(now, ranges(pose), **step)))
    make.write(folder / "a.bag", notes)
    return "a.bag"


def with_poses(layout: str) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        if layout == "tum":
            rows = [f"{k} {x} {y} 0 0 0 {np.sin(a / 2)} {np.cos(a / 2)}\n" for k, (x, y, a) in enumerate(WAY)]
        else:
            rows = [f"VERTEX_SE2 {k} {x} {y} {a}\n" for k, (x, y, a) in enumerate(WAY)]
        (folder / "way.txt").write_text("".join(rows))
        return f"{carmen(folder, is_right=False)} --poses way.txt"

    return write


LOGS: dict[str, tuple[Callable[[Path], str], str]] = {
    "CARMEN": (carmen, ""),
    "ROS 1 without map": (odometry_bag, "poses are those of 'odom', odometry, which drifts"),
    "TUM": (with_poses("tum"), "way.txt (TUM, 6 poses) matched by time"),
    "g2o": (with_poses("g2o"), "way.txt (g2o, 6 poses) matched by order"),
}


@pytest.mark.parametrize("kind", LOGS)
def test_one_command_makes_a_picture(kind: str, tmp_path: Path) -> None:
    write, words = LOGS[kind]
    done = call(f"prf sample --laser {write(tmp_path)} -o run {SMALL}", tmp_path)
    assert done.code == 0, done.err
    assert words in done.err
    assert (tmp_path / "run" / "posterior.png").stat().st_size > 10_000
    image = read_run(tmp_path / "run").image
    assert image is not None
    for share, low, high in ((0.5, 0.0, 0.02), (1.0, 0.7, 1.0)):
        ends = [
            p[:2] + (share * r + 0.07 * share) * np.array([np.cos(p[2] + a), np.sin(p[2] + a)]) for p, a, r in BEAMS
        ]
        column, row = ((np.array(ends) + 1.0) / 0.1).astype(int).T
        assert low <= image.occupancy[row, column].mean() <= high, "free half way, a wall where beams end"
