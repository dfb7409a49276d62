"""Names of outputs that promise what is not written: every verb refuses them before it reads anything."""

from __future__ import annotations

from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from prf.shell.errors import UsageError
from prf.shell.output_names import refuse_other_format
from prf.shell.run import run_app

REFUSED = {
    "prf anneal --laser LOG -o map.png": "the map is written as GeoJSON",
    "prf grid --laser LOG -o grid.PNG": "a grid is written as a .npz archive",
    "prf prior --scale 1 --window 0 0 1 1 --draws 1 -o draws.svg": "draws are written as GeoJSON",
    "prf calibrate --map LOG --laser LOG -o fit.yaml": "parameters are written as a settings file",
    "mapq segment LOG -o patches.ply": "patches are written as a .patches file",
    "mapq train LOG -o model.npz": "a model is written as JSON",
    "mapq classify LOG -o result.png": "clouds are written as PLY, LAS or LAZ",
    "mapq report LOG -o report.pdf": "a report is a page of HTML",
}


@pytest.mark.parametrize("line", REFUSED)
def test_the_name_of_another_format_is_refused_at_once(line: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("LOG").write_text("nothing that any verb reads\n")
    tool, *arguments = line.split()
    assert run_app({"prf": prf.cli, "mapq": mapq.cli}[tool].app, tool, arguments) == 2
    told = capsys.readouterr()
    assert told.err.startswith(f"error: {arguments[-1]}: {REFUSED[line]}")
    assert not told.out
    assert [path.name for path in tmp_path.iterdir()] == ["LOG"]


@pytest.mark.parametrize(
    "name", ["map.geojson", "MAP.GeoJSON", "map", "map.json", "map.v2", "-", "/dev/null", "a.png/map"]
)
def test_other_names_are_taken(name: str) -> None:
    refuse_other_format(name, (".geojson",), "no")


def test_the_message_holds_name_and_advice() -> None:
    with pytest.raises(UsageError, match=r"^a/map\.tar\.gz: Name a \.geojson\.$"):
        refuse_other_format("a/map.tar.gz", (".geojson",), "Name a .geojson.")
