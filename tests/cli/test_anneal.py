"""`prf anneal`: what it writes, and that other verbs read it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import shapely

from prf.results.geojson import read_map_feature
from tests.cli.calls import prf


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, data_dir: Path) -> Path:
    target = tmp_path_factory.mktemp("anneal") / "office.geojson"
    arguments = ["--every-scan", "5", "--every-beam", "6", "--chains", "1", "--steps", "40000", "--seed", "1"]
    log = str(data_dir / "demo-office.log.gz")
    assert prf("anneal", "--laser", log, *arguments, "-o", str(target), "-q") == 0
    return target


def test_the_map_is_a_valid_multipolygon_that_prf_reads_back(made: Path) -> None:
    content = json.loads(made.read_text())
    assert content["geometry"]["type"] == "MultiPolygon"
    assert shapely.geometry.shape(content["geometry"]).is_valid
    coloring, properties = read_map_feature(made)
    assert coloring.n_edges == properties["n_edges"] > 0
    assert properties["seed"] == 1
    assert properties["configuration"]["every_beam"] == 6
    assert properties["inputs"][0]["path"].endswith("demo-office.log.gz")


def test_it_can_be_scored_and_exported(
    made: Path, data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(data_dir / "demo-office.log.gz")
    assert prf("score", str(made), "--laser", log, "--every-scan", "5", "--seed", "1", "--json") == 0
    assert json.loads(capsys.readouterr().out)["n_beams"] > 100
    assert prf("export", str(made), "--format", "svg", "-o", str(tmp_path / "a.svg"), "-q") == 0


def test_json_has_sizes(data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "a.geojson"
    arguments = ["--every-scan", "10", "--every-beam", "12", "--chains", "2", "--steps", "20000", "--seed", "1"]
    log = str(data_dir / "demo-office.log.gz")
    assert prf("anneal", "--laser", log, *arguments, "-o", str(target), "--json", "-q") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["geojson_bytes"] == target.stat().st_size
    assert result["packed_bytes"] == 4 * result["n_vertices"]
    assert len(result["score_by_chain"]) == 2
    assert result["complete"]
