"""Long runs: memory of sampling and annealing stays flat, and a leak would be seen; a report stays small.

What recurs over a day (checkpoints, draws that are thinned when they are many, rounds) is made to recur within seconds.
"""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import prf.sampler.chain
import prf.sampler.session
from mapq.report.findings import read_findings
from mapq.report.page import write_report
from prf.configuration import Configuration
from prf.results import names
from prf.sampler.anneal import anneal
from prf.sampler.prepare import read_prepared
from prf.sampler.session import Session, StopRule, drive
from prf.shell.cli.storage import spawn_generators
from tests.conftest import ROOT
from tests.mapq.report.results import save_result
from tests.mapq.town import town

LOG = str(ROOT / "data" / "demo-office.log.gz")
CHAINS = 2
THIN = 2
"""Steps between draws at first."""
FLAT = 0.1
"""MB by which memory in the last third of a run may exceed that in the middle third."""


def shorten(monkeypatch: pytest.MonkeyPatch, block: int, most_draws: int, seconds: float) -> None:
    """Make rounds, draws and checkpoints follow each other quickly."""
    places: tuple[tuple[Any, str, Any], ...] = (
        (prf.sampler.chain, "FIRST_THIN", THIN),
        (prf.sampler.chain, "FIRST_EPOCH", THIN),
        (prf.sampler.chain, "MOST_DRAWS", most_draws),
        (prf.sampler.chain, "SHORTEST_BLOCK", block),
        (prf.sampler.chain, "LONGEST_BLOCK", block),
        (prf.sampler.session, "CHECKPOINT_SECONDS", seconds),
    )
    for module, name, value in places:
        monkeypatch.setattr(module, name, value)


def sample(n_rounds: int, block: int, folder: Path, look: Callable[[Any], None]) -> None:
    """Sample the demo office in so many rounds; call `look` with the chains after each."""
    config = Configuration.of(chains=CHAINS, every_scan=10, every_beam=10, resolution=0.5, start="empty")
    session = Session.start([LOG], read_prepared([LOG], config), folder, 1, 1)
    session.open()
    for found in drive(session.ensemble, StopRule(steps=n_rounds * block)):
        session.progress = found
        look(session.ensemble)
        if found.status == "running":
            session.write_if_due()
    session.finish()


def test_draws_are_capped_by_doubling_their_spacing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    block, most = 1500, 128
    shorten(monkeypatch, block, most, -1.0)
    seen: list[tuple[int, int, int]] = []

    def look(sampler: Any) -> None:
        records = [chain.record for chain in sampler.chains]
        size = (tmp_path / "run" / names.DRAWS).stat().st_size if (tmp_path / "run" / names.DRAWS).exists() else 0
        seen.append((sum(len(each.draws) for each in records), records[0].thin, size))

    sample(8, block, tmp_path / "run", look)
    draws, spacing, size = np.array(seen).T
    assert draws.max() <= CHAINS * most
    assert draws[1:].min() >= CHAINS * most // 2
    steps = block * np.arange(1, 9)
    np.testing.assert_array_equal(spacing, THIN * 2 ** np.floor(np.log2(steps / (THIN * most)) + 1))
    assert size[2:].max() < 3 * size[2:].min()


@pytest.fixture
def memory() -> Iterator[Callable[[int], Callable[[Any], None]]]:
    """Make a function that notes the traced memory, MB, and leaks so many bytes a call."""
    tracemalloc.start(1)

    def make(leak: int) -> Any:
        notes, kept = np.full(10_000, np.nan), []

        def look(*_: object) -> None:
            kept.append(bytes(leak))
            notes[len(kept)] = tracemalloc.get_traced_memory()[0] / 1e6

        look.notes = notes  # type: ignore[attr-defined]
        return look

    yield make
    tracemalloc.stop()


def growth(notes: np.ndarray) -> float:
    """Return the median of the last third less that of the middle third, MB; the map grows in the first third."""
    seen = notes[~np.isnan(notes)]
    third = len(seen) // 3
    return float(np.median(seen[-third:]) - np.median(seen[third : 2 * third]))


@pytest.mark.slow
@pytest.mark.parametrize("leak", [0, 5000])
@pytest.mark.parametrize(("n_rounds", "block", "seconds"), [(100, 1500, -1.0), (3000, 100, math.inf)])
def test_memory_of_sampling_stays_flat_and_a_leak_is_seen(
    n_rounds: int, block: int, seconds: float, leak: int, memory: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shorten(monkeypatch, block, 8, seconds)
    look = memory(leak)
    sample(n_rounds, block, tmp_path / "run", look)
    assert (growth(look.notes) > FLAT) == bool(leak)


@pytest.mark.slow
@pytest.mark.parametrize("leak", [0, 150])
def test_memory_of_annealing_stays_flat_and_a_leak_is_seen(
    leak: int, memory: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shorten(monkeypatch, 100, 8, math.inf)
    look = memory(leak)
    target = read_prepared([LOG], Configuration.of(every_scan=10, every_beam=10)).target
    anneal(target, spawn_generators(1, CHAINS), StopRule(steps=300_000), on_progress=look)
    assert (growth(look.notes) > FLAT) == bool(leak)


def test_a_report_stays_small_however_many_patches_there_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapq.report.findings.MAX_LISTED", 100)
    sizes = []
    for n_patches in (200, 1600):
        findings = read_findings(str(save_result(tmp_path / f"{n_patches}.ply", town(n_patches))))
        sizes.append(write_report(str(tmp_path / "r.html"), findings, max_points=2000)[0])
    assert sizes[1] < sizes[0] + 100_000
