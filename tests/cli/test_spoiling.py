"""What would spoil a map is warned of by the verbs that make one, a line each; a sane log is taken without a word."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

import prf
from prf.cli import app
from prf.readings import read_readings
from prf.shell.cli.run import run_app

VERBS = {
    "sample": ["-o", "out", "--chains", "1", "--steps", "10", "--seed", "1", "--scale", "0.001"],
    "anneal": ["-o", "out.geojson", "--chains", "1", "--steps", "10", "--seed", "1", "--scale", "0.001"],
    "grid": ["-o", "out.npz", "--resolution", "1", "--window", "-9", "-9", "999", "9"],
}
"""A small scale: a window of some kilometres, as millimetres taken for metres make it, has few edges then."""
SCALES = {
    "sane": ((1.0, 1.0, 1.0), None),
    "millimetres": ((1.0, 1.0, 1000.0), "are they in millimetres?"),
    "degrees": ((1.0, 57.29578, 1.0), "are they in degrees?"),
    "positions": ((1000.0, 1.0, 1.0), "are the positions in millimetres?"),
    "sonar": ((1.0, 1.0, 1.0), "--sonar"),
}
"""Factors of positions, angles and ranges; what is said of them."""


def write(path: Path, defect: str) -> str:
    (place, turn, far), _ = SCALES[defect]
    angles = np.linspace(-3.0, 3.0, 40)
    rows = [f"{0.2 * i * place},0,{a * turn},{far * (1.5 + 0.1 * i)}" for i in range(4) for a in angles]
    cone = (",cone", ",0.349") if defect == "sonar" else ("", "")
    path.write_text("\n".join([f"x,y,theta,range{cone[0]}", *(row + cone[1] for row in rows)]) + "\n")
    return str(path)


@pytest.mark.parametrize("defect", SCALES)
@pytest.mark.parametrize("verb", VERBS)
def test_verbs_warn_once(verb: str, defect: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    words = [verb, "--laser", write(tmp_path / "a.csv", defect), *VERBS[verb]]
    for more in ([], ["-q"]):
        assert run_app(app, "prf", [*words, *more, "--force"]) == 0
        warned = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning:")]
        is_due = defect != "sane" and not more
        assert len(warned) == is_due, warned
        assert not is_due or SCALES[defect][1] in warned[0]


def test_python_callers_are_warned_too(tmp_path: Path, caplog) -> None:
    path = write(tmp_path / "a.csv", "millimetres")
    for readings in (path, read_readings(path)):
        caplog.clear()
        with caplog.at_level(logging.WARNING, logger="prf"):
            prf.sample(
                readings, prf.Prior(0.001), chains=1, steps=10, seed=1, resolution=500.0, start="empty", progress=False
            )
        assert [record.levelname for record in caplog.records] == ["WARNING"]
        assert "millimetres" in caplog.text
