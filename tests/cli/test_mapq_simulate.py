"""The verb `mapq simulate`: its map, its numbers, its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mapq.io import read_cloud
from mapq.simulate import Settings, simulate
from tests.cli.calls import mapq

ARGS = ("simulate", "--size", "small", "--n-points", "4000")


def test_the_map_and_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "map.ply"
    assert mapq(*ARGS, "--seed", "2", "-o", str(path)) == 0
    cloud = read_cloud(str(path))
    made = simulate(Settings.of_size("small", {"n_points": 4000}), 2)
    np.testing.assert_array_equal(cloud.world(), made.world())
    for name, values in made.fields.items():
        np.testing.assert_array_equal(cloud.fields[name], values)
        assert cloud.fields[name].dtype == values.dtype
    table = capsys.readouterr().out
    assert f"points          {len(cloud):,}: " in table
    assert f"{made.fields['truth'].mean():.1%} of the points" in table
    assert table.endswith(f"seed            2\nmap             {path}\n")


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    for name, seed in (("a.ply", "3"), ("b.ply", "3"), ("c.ply", "4")):
        assert mapq(*ARGS, "--seed", seed, "-o", str(tmp_path / name), "-q") == 0
    contents = [(tmp_path / name).read_bytes() for name in ("a.ply", "b.ply", "c.ply")]
    assert contents[0] == contents[1] != contents[2]


def test_json_options_and_the_seed_that_was_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "map.ply"
    options = (
        "--drift",
        "0",
        "--set",
        "simulate.look_alikes=0",
        "--set",
        "simulate.clutter=0.5",
        "--set",
        "simulate.loops=1",
        "--json",
        "-o",
        str(path),
    )
    assert mapq(*ARGS, *options) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["schema"] == "mapq.simulate/1"
    assert (first["output"], first["passes"], first["final_drift"]) == (str(path), 2, 0.0)
    assert (first["suspicious_points"], first["look_alike_surfaces"]) == (0.0, 0.0)
    assert first["settings"]["loops"] == 1
    assert sum(first["points_by_kind"].values()) == first["points"]
    assert mapq(*ARGS, *options, "--seed", str(first["seed"]), "-f") == 0
    assert json.loads(capsys.readouterr().out) == first
