"""Two processes on one output: the second is refused in one line, by every verb that writes."""

from __future__ import annotations

import importlib
import shutil
from pathlib import Path

import pytest

from prf.shell.lock import exclusive
from prf.shell.run import run_app
from tests.cli.mapq_samples import save_cloud, save_patches
from tests.killed.child import ROOT

LOG = str(ROOT / "data" / "demo-office.log.gz")
WRITING = {
    "prf sample": ("--laser", LOG, "-o", "out.run"),
    "prf anneal": ("--laser", LOG, "-o", "out.geojson"),
    "prf grid": ("--laser", LOG, "-o", "out.npz"),
    "prf simulate": ("-o", "out.sim"),
    "prf prior": ("--scale", "0.1", "--window", "0", "0", "9", "9", "--draws", "1", "-o", "out.geojsonl"),
    "prf calibrate": ("--map", "map.geojson", "--laser", LOG, "-o", "out.toml"),
    "prf render": ("draws.geojsonl", "-o", "out.png"),
    "prf export": ("map.geojson", "--format", "svg", "-o", "out.svg"),
    "mapq segment": ("walls1.ply", "-o", "out.patches"),
    "mapq label": ("walls1.patches", "--from-field", "truth"),
    "mapq train": ("walls1.patches", "-o", "out.json"),
    "mapq classify": ("walls1.ply", "-o", "out.ply"),
    "mapq classify --workers 2": ("walls1.ply", "-o", "out.ply"),
    "mapq report": ("result.ply", "-o", "out.html"),
    "mapq render": ("walls1.ply", "-o", "out.png"),
    "mapq simulate": ("-o", "out.ply"),
    "mapq simulate --size city": ("-o", "out.city"),
    "mapq perturb": ("0.ply", "1.ply", "--poses", "poses.txt", "-o", "out.ply"),
}


@pytest.mark.parametrize("verb", WRITING)
def test_an_output_that_another_process_writes_is_refused(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cloud = save_cloud(tmp_path)
    for number in range(2):
        shutil.copy(cloud, f"{number}.ply")
    save_patches(tmp_path, labelled=verb != "mapq label")
    Path("poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2)
    Path("map.geojson").write_text("{}")
    tool, *words = verb.split()
    output = WRITING[verb][-1] if "-o" in WRITING[verb] else "walls1.patches"
    before = sorted(tmp_path.iterdir())
    with exclusive(output):
        app = importlib.import_module(f"{tool}.cli").app
        code = run_app(app, tool, [*words, *WRITING[verb]])
    out, err = capsys.readouterr()
    assert (code, out) == (4, ""), err
    assert err.count("\n") == 1
    assert "another process (pid" in err
    assert sorted(tmp_path.iterdir()) == before
