"""Chains and tiles as tasks of a scheduler: the same to the last bit, whatever becomes of a worker."""

from __future__ import annotations

import dataclasses
import logging
import os
import pickle
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import prf.sampler.distributed as distributed
import prf.sampler.tiles.schedule as schedule
from prf.posterior import Settings
from prf.sampler import Sampler
from prf.sampler.chain import ChainSampler
from prf.sampler.distributed import Remote, remote_blocks, state_to_send, take_state
from prf.sampler.probes import probe_pixels
from prf.shell.errors import ConfigError
from prf.shell.seeds import spawn_generators
from prf.window import Window
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 12.0, 10.0)


@pytest.fixture(scope="module")
def settings() -> Settings:
    world = draw_world(0.25, ROOM, Sensor(8.0), 4, 30, np.random.default_rng(3))
    return Settings(ROOM, 0.25, world.data, resolution=0.5)


def assert_same(one: ChainSampler, two: ChainSampler) -> None:
    assert digest(one.chain, one.rng) == digest(two.chain, two.rng)
    assert one.record.thin == two.record.thin
    for draws, twins in ((one.record.draws, two.record.draws), ([one.record.best], [two.record.best])):
        assert [draw.step for draw in draws if draw] == [draw.step for draw in twins if draw]
        for draw, twin in zip(draws, twins, strict=True):
            assert draw is not None
            assert twin is not None
            # Maps of the burn-in are not sent.
            assert draw.step <= one.burn_in or np.array_equal(draw.coloring.xy, twin.coloring.xy)
            assert np.array_equal(draw.functionals, twin.functionals)
            assert np.array_equal(draw.probe_black, twin.probe_black)


def blocks_as_tasks(sampler: ChainSampler, settings: Settings, n: int, key: str) -> None:
    """What a scheduler would have done, with everything pickled on the way."""
    readings = pickle.dumps(settings)
    for _ in range(n):
        arrays = pickle.loads(pickle.dumps(state_to_send(sampler)))
        take_state(sampler, pickle.loads(pickle.dumps(remote_blocks(key, readings, arrays, None, 2))))


@pytest.mark.parametrize("forgets", [False, True])
def test_blocks_as_tasks_are_the_same_blocks(
    settings: Settings, forgets: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the worker still has the chain from its last task, or puts one into the state that it is given."""
    if forgets:
        monkeypatch.setattr(distributed, "_state", lambda arrays: str(np.random.default_rng().random()))
    monkeypatch.setattr("prf.sampler.record.MOST_DRAWS", 24)
    probes = probe_pixels(settings)
    local, remote = (ChainSampler(settings, spawn_generators(7, 1)[0], probes) for _ in range(2))
    for _ in range(8):
        local.advance()
    blocks_as_tasks(remote, settings, 4, f"forgets {forgets}")
    assert local.record.thin > 2000
    assert_same(local, remote)


def test_a_missing_extra_is_named(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"prf-mapq\[distributed\]"):
        Remote("tcp://127.0.0.1:8786", settings)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    dask = pytest.importorskip("distributed")
    with dask.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=":0",
        silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster


def run(settings: Settings, remote: Remote | None, blocks: int, victim: Any = None) -> Sampler:
    with Sampler(settings, spawn_generators(7, 2), 2, remote) as sampler:
        for number in range(blocks):
            if victim is not None and number == blocks - 3:
                threading.Timer(0.05, os.kill, (victim, signal.SIGKILL)).start()
            sampler.advance()
    return sampler


@pytest.mark.slow
@pytest.mark.parametrize("tiles", [0, 5])
def test_a_cluster_changes_no_result_even_if_a_worker_is_killed(
    settings: Settings, cluster: Any, tiles: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(schedule, "ROUND_LENGTHS", (64_000, 64_000))
    tiled = dataclasses.replace(settings, tiles=tiles)
    cluster.scale(2)
    remote = Remote(cluster.scheduler_address, tiled)
    remote._client.wait_for_workers(2, timeout=60)
    victim = next(iter(remote._client.run(os.getpid).values()))
    blocks = 12
    one, two = run(tiled, None, blocks), run(tiled, remote, blocks, victim)
    for local, far in zip(one.chains, two.chains, strict=True):
        assert_same(local, far)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one.occupancy(), two.occupancy(), strict=True))
    pids = set()
    with cluster.get_client() as client:
        client.wait_for_workers(1, timeout=60)
        pids = set(client.run(os.getpid).values())
    assert victim not in pids
