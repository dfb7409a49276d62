"""Readings from arrays are those of a table with the same numbers; what cannot be used is named."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import prf
from prf.api.science import by_kind
from prf.shell.errors import ArgumentError, InputError

POSE = np.array([[0.0, 0.0, 0.5], [1.0, 2.0, -0.5]])
ANGLE = np.array([-0.1, 0.0, 0.2])
RANGES = np.array([[1.0, 2.0, np.inf], [3.0, 4.0, 5.0]])


def test_a_laser_from_arrays_is_that_of_a_table(tmp_path: Path) -> None:
    rows = [
        f"{x!r},{y!r},{theta + a!r},{'' if np.isinf(r) else repr(r)},{scan}"
        for scan, (x, y, theta) in enumerate(POSE.tolist())
        for a, r in zip(ANGLE.tolist(), RANGES[scan].tolist(), strict=True)
    ]
    (tmp_path / "table.csv").write_text("\n".join(["x,y,theta,range,scan", *rows]))
    read, made = prf.read_readings(tmp_path / "table.csv"), prf.laser(POSE, ANGLE, RANGES)
    for name in ("origin", "angle", "range", "scan", "beam", "cone"):
        np.testing.assert_array_equal(getattr(made, name), getattr(read, name), name)


def test_angles_may_differ_from_scan_to_scan() -> None:
    both = np.stack([ANGLE, 2.0 * ANGLE])
    made = prf.laser(POSE, both, RANGES)
    np.testing.assert_allclose(made.angle, (POSE[:, 2, None] + both).ravel())


def test_transducers_may_stand_apart() -> None:
    apart = np.stack([POSE, POSE + 0.1, POSE - 0.1], axis=1)
    made = prf.sonar(apart, np.zeros(3), RANGES)
    np.testing.assert_array_equal(made.origin, apart[:, :, :2].reshape(-1, 2))
    np.testing.assert_array_equal(made.angle, apart[:, :, 2].ravel())
    np.testing.assert_array_equal(made.scan, [0, 0, 0, 1, 1, 1])
    with pytest.raises(ArgumentError, match=r"pose: has shape \(2, 2, 3\), must be \(2, 3, 3\)"):
        prf.sonar(apart[:, :2], np.zeros(3), RANGES)


def test_what_is_no_reading_is_left_out_and_counted() -> None:
    made = prf.laser(POSE, ANGLE, [[1.0, np.nan, np.inf], [0.0, 4.0, 5.0]])
    np.testing.assert_array_equal(made.range, [1.0, np.inf, 4.0, 5.0])
    np.testing.assert_array_equal(made.beam, [0, 2, 1, 2])
    assert (made.notes.n_invalid, made.notes.n_zero_ranges) == (1, 1)


def test_sonars_have_a_cone_and_lasers_have_none() -> None:
    laser, sonar = prf.laser(POSE, ANGLE, RANGES), prf.sonar(POSE, ANGLE, RANGES, cone=0.3)
    assert set(sonar.cone) == {0.3}
    values = prf.points([[0.0, 1.0]], [1])
    assert by_kind([values, sonar, laser]) == {"laser": [laser], "sonar": [sonar], "points": [values]}
    assert by_kind(values) == {"points": [values]}
    assert by_kind("a.log") == {"laser": ["a.log"]}
    assert by_kind({"laser": ["a.log", laser]}) == {"laser": ["a.log", laser]}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: prf.laser([1.0, 2.0, 3.0], ANGLE, RANGES), "pose: has shape (3,), must be (2, 3)"),
        (lambda: prf.laser(POSE, ANGLE[:2], RANGES), "angle: has shape (2,), must be (3,)"),
        (lambda: prf.laser(POSE, ANGLE, RANGES[0]), "ranges: has shape (3,), must be (n, n)"),
        (lambda: prf.laser(POSE * [np.nan, 1.0, 1.0], ANGLE, RANGES), "pose[0, 0] is nan: must be finite"),
        (lambda: prf.laser(POSE, np.degrees(ANGLE) + 90.0, RANGES), "must be finite and in radians"),
        (lambda: prf.laser(POSE, ANGLE, -RANGES), "ranges[0, 0] is -1: must be at least 0"),
        (lambda: prf.laser(POSE, ANGLE, 1e4 * RANGES), "ranges[0, 1] is 20000 m: must be a distance in metres"),
        (lambda: prf.laser(POSE, ANGLE, np.zeros((2, 3))), "so there is no reading"),
        (lambda: prf.laser(POSE, ["a", "b", "c"], RANGES), "angle: must be an array of numbers"),
        (lambda: prf.sonar(POSE, ANGLE, RANGES, cone=20.0), "cone 20.0"),
        (lambda: prf.points([[1.0, 2.0, 3.0]], [1]), "xy: has shape (1, 3), must be (n, 2)"),
        (lambda: prf.points([[1.0, 2.0]], [1, 0]), "value: has shape (2,), must be (1,)"),
        (lambda: prf.points([[1.0, 2.0]], [np.inf]), "value[0] is inf"),
        (lambda: prf.sample([]), "readings: give at least one"),
        (lambda: prf.sample(RANGES), "readings: ndarray is not a log"),
        (lambda: prf.sample([prf.points([[0.0, 1.0]], [1])] * 2), "points are given twice"),
        (lambda: prf.sample({"radar": "a.log"}), "'radar': must be one of laser, sonar, points"),
        (lambda: prf.sample("a.log", sensors=prf.SonarModel()), "no readings of the sonar"),
        (lambda: prf.sample("a.log", sensors="laser"), "str, must be one of LaserModel"),
        (lambda: prf.sample("a.log", prf.Prior(window=(0, 0, 1))), "window = [0, 0, 1]: has too few values"),
        (lambda: prf.sample("a.log", steps=10, seconds=1.0), "steps and seconds: give one"),
        (lambda: prf.sample("a.log", steps=0), "steps 0: must be at least 1"),
        (lambda: prf.sample("a.log", seconds=float("nan")), "seconds nan"),
        (lambda: prf.sample("a.log", chains=0), "chains = 0: must be at least 1"),
        (lambda: prf.sample("a.log", tiles=1), "tiles = 1: must be 0"),
    ],
)
def test_what_cannot_be_used_is_named(call: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=re.escape(words)) as caught:
        call()
    assert isinstance(caught.value, ValueError)


def test_a_missing_log_is_an_input_error() -> None:
    with pytest.raises(InputError, match=r"no-such\.log: no such file"):
        prf.sample("no-such.log")
