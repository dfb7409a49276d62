"""The verb `prior`: its file, its summary, its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from prf.model.coloring import read_geojsonl, violations
from prf.model.window import Window
from tests.cli.calls import prf

ARGS = ("prior", "--scale", "0.5", "--window", "-1", "-2.5", "3", "0.1")


def test_draws_and_summary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "draws.geojsonl"
    assert prf(*ARGS, "--draws", "40", "--method", "exact", "--seed", "3", "-o", str(path)) == 0
    draws = read_geojsonl(path)
    assert len(draws) == 40
    assert draws.window == Window(-1.0, -2.5, 3.0, 0.1)
    assert not any(violations(draw) for draw in draws)
    table = capsys.readouterr().out
    assert f"{draws.n_edges.mean():.4f}" in table
    assert "seed        3" in table


def test_the_same_seed_gives_the_same_file(tmp_path: Path) -> None:
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        assert prf(*ARGS, "--draws", "5", "--seed", seed, "-o", str(tmp_path / name), "-q") == 0
    contents = [(tmp_path / name).read_bytes() for name in "abc"]
    assert contents[0] == contents[1] != contents[2]


def test_json_and_the_seed_that_was_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    assert prf(*ARGS, "--draws", "300", "--json") == 0
    first = json.loads(capsys.readouterr().out)
    assert first["schema"] == "prf.prior/1"
    assert (first["n_draws"], first["thin"], first["output"]) == (300, None, None)
    assert first["mean_edges"] == pytest.approx(first["expected_edges"], rel=0.15)
    assert prf(*ARGS, "--draws", "300", "--json", "--seed", str(first["seed"])) == 0
    assert json.loads(capsys.readouterr().out) == first


def test_draws_to_standard_output_leave_the_summary_to_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert prf(*ARGS, "--draws", "3", "--seed", "1", "-o", "-") == 0
    streams = capsys.readouterr()
    lines = [json.loads(line) for line in streams.out.splitlines()]
    assert [line["type"] for line in lines] == ["Feature"] * 3
    assert "draws       3" in streams.err


def test_the_chain_draws_maps_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "draws.geojsonl"
    args = ("--draws", "20", "--method", "mcmc", "--thin", "200", "--seed", "2", "-o", str(path), "--json")
    assert prf(*ARGS, *args) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["method"], summary["thin"], summary["n_draws"]) == ("mcmc", 200, 20)
    draws = read_geojsonl(path)
    assert not any(violations(draw) for draw in draws)
    assert np.all(np.diff(draws.vertex_offsets) >= 0)
