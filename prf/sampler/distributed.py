"""Tiles and chains on the workers of a Dask scheduler: tasks of which each depends on what it is given alone.

A task carries the state that it starts from and gives back the one that it ends in, so that a worker that is lost costs
its tasks and no more: the scheduler has others repeat them. What is big and never changes, the readings and the tables
made of them, each worker keeps under the name of the run, and makes again if it has lost it.
"""

from __future__ import annotations

import copy
import hashlib
import json
import pickle
import threading
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from prf import __version__
from prf.posterior import Settings
from prf.sampler.chain import ChainSampler
from prf.sampler.chain_state import Arrays, chain_arrays, restore
from prf.sampler.probes import probe_pixels
from prf.sampler.record import Draw, Record
from prf.sampler.tiles import Round, TileData, TiledChain, TileResult, make_tile_data, work_tile
from prf.shell.errors import InputError
from prf.shell.scheduler import Cluster

RETRIES = 3
"""Times that a task is repeated if it fails, besides those that a lost worker makes necessary."""
MOST_KEPT = 2
"""Runs of which a worker keeps the readings."""
MOST_IDLE = 8
"""Chains of a run that a worker keeps ready."""


class Remote:
    """The workers of a scheduler, as one run uses them."""

    def __init__(self, address: str, settings: Settings) -> None:
        self.address = address
        self._cluster = Cluster(address, "prf", _version)
        self._client = self._cluster.client
        payload = pickle.dumps(settings)
        self.key = hashlib.sha256(payload).hexdigest()
        self._readings = self._send(payload)

    def close(self) -> None:
        """Leave the scheduler and its workers to themselves."""
        self._cluster.close()

    def work_tiles(self, chains: Sequence[TiledChain], begun: Sequence[Round]) -> list[list[TileResult]]:
        """Have the tiles of all chains worked."""
        futures = []
        for each in begun:
            sent = self._send(each)
            futures.append([self._submit(remote_tile, sent, number) for number in range(len(each.tiles))])
        assert len(futures) == len(chains)
        results: list[list[TileResult]] = self._gather(futures)
        return results

    def advance(self, chains: Sequence[ChainSampler], latest: int | None, blocks: int) -> None:
        """Run some blocks in every chain, side by side, no step beyond `latest`."""
        futures = [self._submit(remote_blocks, state_to_send(chain), latest, blocks) for chain in chains]
        for chain, arrays in zip(chains, self._gather(futures), strict=True):
            take_state(chain, arrays)

    def _send(self, value: Any) -> Any:
        """Return a future of `value` that the scheduler can make again if the worker that holds it is lost."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the size: it is sent once
            return self._client.submit(_keep, value, pure=False, retries=RETRIES)

    def _submit(self, function: Any, *arguments: Any) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self._client.submit(function, self.key, self._readings, *arguments, pure=False, retries=RETRIES)

    def _gather(self, futures: Any) -> Any:
        """Wait for the values of futures; what goes wrong on the way ends the run in one line."""
        dask = self._cluster.dask
        try:
            return self._client.gather(futures)
        except (dask.CancelledError, dask.KilledWorker, OSError, TimeoutError) as error:
            raise InputError(
                f"--scheduler {self.address}: scheduler or workers are lost ({type(error).__name__}). "
                "Start them again, and go on with --resume."
            ) from error


def _version() -> str:
    return __version__


def _keep(value: Any) -> Any:
    return value


# What follows runs on workers.

_lock = threading.Lock()
_data: dict[str, TileData] = {}
_idle: dict[str, dict[str, ChainSampler]] = {}
"""By run and by the state they are in: chains ready to go on."""


def remote_tile(key: str, readings: bytes, begun: Round, number: int) -> TileResult:
    """Work one tile on a worker."""
    with _lock:
        if key not in _data:
            _forget(_data)
            _data[key] = make_tile_data(pickle.loads(readings))
    return work_tile(_data[key], begun, number)


def remote_blocks(key: str, readings: bytes, arrays: Arrays, latest: int | None, blocks: int) -> Arrays:
    """Run some blocks of one chain on a worker, from the state in `arrays`."""
    sampler = _taken(key, readings, arrays)
    steps, best = arrays["record.steps"].tolist(), arrays["record.best"].tolist()
    sampler.record = Record(sampler.record.probes)
    sampler.record.thin = int(arrays["record.thin"])
    # Of draws that stay behind only steps count here, and of the best map how good it is.
    nothing: Any = None
    sampler.record.draws = [Draw(step, nothing, nothing, nothing) for step in steps]
    if best:
        sampler.record.best = Draw(-1, nothing, np.array(best), nothing)
    for _ in range(blocks):
        sampler.advance(latest)
    found = state_with_draws(sampler, [draw for draw in sampler.record.draws if draw.coloring is not nothing])
    with _lock:
        _idle[key][_state(found)] = sampler
    return found


def _taken(key: str, readings: bytes, arrays: Arrays) -> ChainSampler:
    """Return a chain in the state of `arrays`: the one that came to it here, or any that is put into it."""
    with _lock:
        if key not in _idle:
            _forget(_idle)
        idle = _idle.setdefault(key, {})
        standing = idle.pop(_state(arrays), None)
        if standing is not None:
            return standing
        spare = idle.pop(next(iter(idle))) if len(idle) >= MOST_IDLE else None
    if spare is None:
        settings = pickle.loads(readings)
        spare = ChainSampler(settings, np.random.default_rng(0), probe_pixels(settings))
    restore(spare, arrays)
    return spare


def _forget(kept: dict[str, Any]) -> None:
    """Make room for another run: forget the oldest."""
    while len(kept) >= MOST_KEPT:
        del kept[next(iter(kept))]


def _state(arrays: Arrays) -> str:
    """Return what no two states have in common: the generator's."""
    return json.dumps(json.loads(str(arrays["generator"])), sort_keys=True)


# What follows serves both ends.


def state_to_send(sampler: ChainSampler) -> Arrays:
    """Return the state of a chain without its draws."""
    best = sampler.record.best
    arrays = state_with_draws(sampler, [], with_best=False)
    arrays["record.best"] = np.array([] if best is None else best.functionals, np.float64)
    return arrays


def state_with_draws(sampler: ChainSampler, draws: list[Draw], with_best: bool = True) -> Arrays:
    """Return the state of a chain with some of its draws, and the best if it is a map."""
    light = copy.copy(sampler)
    light.record = Record(sampler.record.probes)
    light.record.thin = sampler.record.thin
    light.record.draws = draws
    best = sampler.record.best
    light.record.best = best if with_best and best is not None and best.step >= 0 else None
    arrays = chain_arrays(light)
    return {**arrays, "record.steps": np.array([draw.step for draw in sampler.record.draws], np.int64)}


def take_state(sampler: ChainSampler, arrays: Arrays) -> None:
    """Put a chain into the state that :func:`remote_blocks` gave back, its draws added to those that it has."""
    before, best = sampler.record.draws, sampler.record.best
    restore(sampler, arrays)
    kept = set(arrays["record.steps"].tolist())
    sampler.record.draws = [draw for draw in (*before, *sampler.record.draws) if draw.step in kept]
    sampler.record.best = sampler.record.best or best
