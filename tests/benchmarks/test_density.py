"""The benchmarks of dense logs: their cases and tables, on the office's log."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import density, score_time
from prf.coloring import Coloring

SCORES = {"beam_nll": -0.5, "nll": 0.2, "brier": 0.03, "within_0.2m": 0.9}


@pytest.fixture(scope="module")
def log(data_dir: Path) -> density.Log:
    return density.open_log(data_dir / "demo-office.log.gz")


def test_cases_grow_share_a_window_and_are_thinned_or_whole(log: density.Log) -> None:
    counts = []
    for size in density.SIZES:
        thinned, n = log.settings(size, 0.5)
        whole, same = log.settings(size, 0.0)
        assert thinned.laser is not None
        assert whole.laser is not None
        assert n == same == len(whole.laser.readings)
        assert len(thinned.laser.readings) <= n
        assert thinned.window == whole.window == log.window
        counts.append(n)
    assert counts == sorted(counts)
    assert counts[-1] == log.readings.n_beams, "the log has no fifty scans, of which one would be held out"


def test_speed_is_measured_beside_the_sparsest_case(log: density.Log) -> None:
    settings, _ = log.settings("1.7M", 0.5)
    empty = Coloring.empty(settings.window)
    case, sparse = (density.settled(settings, empty, 500, seed) for seed in (1, 2))
    found = density.speed(case, sparse, 500)
    assert found["steps_per_second"] > 0.0
    assert found["slower_range"][0] <= found["slower"] <= found["slower_range"][1]


def test_tables_have_a_row_a_case_and_a_dash_for_what_was_not_run() -> None:
    row = {"beams": 5000, "way": "thinned", "used": 4000, "steps_per_second": 1e5, "slower": 1.5, "edges": 10}
    row |= {"slower_range": [1.0, 2.0]}
    text = density.table([{**row, "run": None}, {**row, "run": {"peak_gb": 0.9, "score": SCORES}}])
    lines = text.splitlines()
    assert len(lines) == 4
    assert len({line.count("|") for line in lines}) == 1
    assert "–" in lines[2]
    assert "| 0.90 | -0.500 |" in lines[3]


def test_curve_tables_have_a_column_for_each_score() -> None:
    scores = dict.fromkeys(score_time.COLUMNS, 0.5)
    rows = [{"map": "thinned", "beams": 10, "seconds": 3.2, "steps": 1000, **scores}]
    lines = score_time.table("intel", rows).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert "| 1,000 |" in lines[2]
