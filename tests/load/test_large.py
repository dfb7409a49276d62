"""The large jobs of ``python -m tests.load`` in small, and what must not grow with them, by counts."""

from __future__ import annotations

import json
import mmap

import pytest

from mapq.report import read_findings, write_report
from prf.run import read_run
from tests.load import beams, edges, patches
from tests.load.meter import Meter, forget_peak, peak, resident
from tests.load.town import town
from tests.mapq.report.results import save_result


def test_memory_is_seen_while_it_is_held():
    forget_peak()
    before = resident()
    with mmap.mmap(-1, 40_000_000) as held:  # fresh pages, where numpy may be given ones that the process held before
        held.write(b"1" * 40_000_000)
        assert resident() - before > 30.0
    assert resident() - before < 20.0
    assert peak() - before > 30.0


@pytest.mark.slow
@pytest.mark.parametrize("n_edges", [200, 10_000])
def test_a_map_of_many_edges_goes_through_every_verb(n_edges, tmp_path):
    meter = Meter(shown=False)
    found = edges.run(n_edges, 2000 if n_edges < 1000 else 20_000, tmp_path, meter)
    assert found > 0.5 * n_edges
    assert len(meter.stages) == 15
    assert read_run(tmp_path / "run").draws.n_edges.max() < 4 * n_edges


@pytest.mark.parametrize("n_beams", [2000, pytest.param(20_000, marks=pytest.mark.slow)])
def test_a_log_of_many_beams_goes_through_every_verb(n_beams, tmp_path):
    meter = Meter(shown=False)
    beams.run(n_beams, 2000, tmp_path, meter)
    kept = [len(read_run(tmp_path / name).beams.range) for name in ("whole", "thinned")]
    assert kept[0] == pytest.approx(n_beams, rel=0.1)
    assert kept[1] <= min(kept[0], 60_000)


@pytest.mark.parametrize("n_patches", [200, pytest.param(20_000, marks=pytest.mark.slow)])
def test_a_map_of_many_patches_goes_from_patches_to_its_report(n_patches, tmp_path):
    meter = Meter(shown=False)
    assert patches.run(n_patches, tmp_path, meter) < 9_000_000
    assert [stage.name for stage in meter.stages][-1] == "report"
    rows = json.loads((tmp_path / "town.json").read_text())["patches"]
    assert len(rows) == n_patches


def test_a_report_stays_small_however_many_patches_there_are(tmp_path, monkeypatch):
    monkeypatch.setattr("mapq.report.source.MOST_TOLD", 100)
    sizes = []
    for n_patches in (200, 1600):
        told = read_findings(str(save_result(tmp_path / f"{n_patches}.ply", town(n_patches))))
        sizes.append(write_report(str(tmp_path / "r.html"), told, n_most=2000).n_bytes)
    assert sizes[1] < sizes[0] + 100_000
