"""A shortened day: draws are capped by doubling their spacing, and memory stays flat; a leak would be seen."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from tests.load import steady
from tests.load.meter import MB
from tests.load.steady import BLOCK, CHAINS, MOST, THIN, day, sample

FLAT = 0.1
"""MB by which the last third of a run may lie above the middle third."""


def test_a_day_has_so_many_checkpoints_and_doublings():
    assert day(20_000.0)[:2] == (1440, 10)
    assert day(200_000.0)[:2] == (1440, 14)


def test_draws_are_capped_by_doubling_their_spacing(tmp_path):
    seen = sample(8, tmp_path / "run")
    assert seen.draws.max() <= CHAINS * MOST
    assert seen.draws[1:].min() >= CHAINS * MOST // 2
    steps = BLOCK * np.arange(1, 9)
    np.testing.assert_array_equal(seen.spacing, THIN * 2 ** np.floor(np.log2(steps / (THIN * MOST)) + 1))
    assert seen.bytes[2:].max() < 3 * seen.bytes[2:].min()


class Traced:
    """Memory that Python, numpy and kernels have asked for and not given back, MB, and so many bytes more a look.

    Of this process alone, and all of it: what an allocator has free takes leaks in for a long time.
    """

    def __init__(self, leak: int) -> None:
        self.leak, self.kept = leak, b""

    def __call__(self) -> float:
        self.kept += bytes(self.leak)
        return tracemalloc.get_traced_memory()[0] / MB


@pytest.fixture
def traced(monkeypatch):
    """Trace memory, with so few draws kept that their number is not what is seen."""
    monkeypatch.setattr(steady, "MOST", 8)
    tracemalloc.start(1)
    yield Traced
    tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("leak", [0, 5000])
def test_memory_stays_flat_over_checkpoints_and_a_leak_is_seen(leak, traced, tmp_path):
    seen = steady.sample(100, tmp_path / "run", memory=traced(leak))
    assert (steady.growth(seen.memory) > FLAT) == bool(leak)


@pytest.mark.slow
@pytest.mark.parametrize("leak", [0, 150])
def test_memory_stays_flat_over_rounds_and_a_leak_is_seen(leak, traced, tmp_path):
    seen = steady.sample(3000, tmp_path / "run", checkpoints=False, block=100, memory=traced(leak))
    assert (steady.growth(seen.memory) > FLAT) == bool(leak)


@pytest.mark.slow
@pytest.mark.parametrize("leak", [0, 150])
def test_memory_of_an_annealing_stays_flat_and_a_leak_is_seen(leak, traced):
    assert (steady.growth(steady.cool(3000, traced(leak), block=100).memory) > FLAT) == bool(leak)
