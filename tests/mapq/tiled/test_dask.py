"""Tiles on the workers of a Dask scheduler, one of which is killed."""

from __future__ import annotations

import json
import logging
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mapq.configuration import Configuration, TileSettings
from mapq.io import read_cloud
from mapq.model import Model
from mapq.simulate.city import write_city
from mapq.tiled.run import classify_map

N_POINTS = 147_000


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    dask = pytest.importorskip("distributed")
    with dask.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
    ) as cluster:
        yield cluster


def kill_when_cutting(folder: Path, victim: int) -> None:
    """Kill a worker as soon as a tile is segmented; give up after two minutes."""
    for _ in range(12_000):
        if list(folder.glob(".far.*.work/points_*")):
            os.kill(victim, signal.SIGKILL)
            return
        time.sleep(0.01)


@pytest.mark.slow
def test_a_worker_that_is_killed_changes_nothing(cluster: Any, model: Model, tmp_path: Path) -> None:
    write_city(tmp_path / "city", N_POINTS, 5)

    def classified(name: str, scheduler: str | None) -> dict[str, Any]:
        target = str(tmp_path / name)
        settings = Configuration(tiles=TileSettings(tile_points=20_000, scheduler=scheduler))
        classify_map(str(tmp_path / "city"), target, model, settings, False)
        content: dict[str, Any] = json.loads((tmp_path / name / "result.json").read_text())
        return content

    near = classified("near", None)
    with cluster.get_client() as client:
        client.wait_for_workers(2, timeout=60)
        victim = next(iter(client.run(os.getpid).values()))
    killer = threading.Thread(target=kill_when_cutting, args=(tmp_path, victim))
    killer.start()
    far = classified("far", cluster.scheduler_address)
    killer.join()
    assert near["tiles"] > 4
    assert near["patches"] == far["patches"]
    one, other = (read_cloud(str(tmp_path / name / "tile_000_000.laz")) for name in ("near", "far"))
    for name, values in one.fields.items():
        np.testing.assert_array_equal(values, other.fields[name])
    with cluster.get_client() as client:
        client.wait_for_workers(1, timeout=60)
        assert victim not in client.run(os.getpid).values()
