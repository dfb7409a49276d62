"""Chains on the workers of a Dask scheduler: the draws of threads, also with what only some schedules hold."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from prf import __version__
from prf.model.window import Window
from prf.sampler import Ensemble, StopRule, drive
from prf.sampler.schedules import LadderPlan
from prf.sampler.target import Execution, Target
from prf.shell.cli.storage import spawn_generators
from prf.shell.scheduler import Workers, open_pool
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)


def version() -> str:
    return __version__


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    dask = pytest.importorskip("distributed")
    with dask.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
    ) as cluster:
        yield str(cluster.scheduler_address)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["regions", "ladder", "tiles"])
def test_chains_on_a_cluster_make_the_draws_of_threads(kind: str, address: str) -> None:
    data = draw_world(0.2, ROOM, Sensor(6.0), 2, 30, np.random.default_rng(1)).data
    execution = Execution(resolution=0.5, tiles=4 if kind == "tiles" else 0)
    plan = LadderPlan(2) if kind == "ladder" else None
    steps = 260_000 if kind == "tiles" else 30_000

    def sampled(workers: Workers) -> Ensemble:
        target = Target(ROOM, 0.2, data, execution=execution)
        ensemble = Ensemble(target, spawn_generators(7, 2), plan, starts_from="grid")
        deque(drive(ensemble, StopRule(steps), workers), maxlen=0)
        return ensemble

    with open_pool(1, None, "prf", version) as threads, open_pool(1, address, "prf", version) as cluster:
        near, far = sampled(threads), sampled(cluster)
    one, other = (each.sample() for each in (near, far))
    assert len(one.draws) > 0
    assert np.array_equal(one.draws.xy, other.draws.xy)
    for a, b in zip(near.chains, far.chains, strict=True):
        assert digest(a.chain, a.rng) == digest(b.chain, b.rng)
    pairs: Any = zip(near.occupancy(), far.occupancy(), strict=True)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
