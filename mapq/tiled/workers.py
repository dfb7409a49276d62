"""Who works on the tiles: this process, processes beside it, or the workers of a Dask scheduler."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from typing import Any

from mapq import __version__
from prf.shell.errors import InputError, PrfError, require
from prf.shell.scheduler import open_client

Workers = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Yields what a function returns for each task, in their order."""

RETRIES = 3
"""Times that Dask repeats a task whose worker is lost."""


@contextmanager
def open_workers(n_workers: int, scheduler: str | None) -> Iterator[Workers]:
    """Give what maps a function over tasks.

    `n_workers`: processes on this machine; one is this process. `scheduler`: address of a Dask scheduler, whose workers
    are used instead. They must see the files of the map and the work folder under the same names. Errors as
    :func:`prf.shell.scheduler.open_client`; InputError also if workers are lost.
    """
    if scheduler is not None:
        with open_client(scheduler, "mapq", _version) as client:
            yield lambda function, tasks: _on_cluster(client, scheduler, function, tasks)
    elif n_workers <= 1:
        yield map
    else:
        with _processes(n_workers) as pool:
            yield lambda function, tasks: _in_pool(pool, function, tasks)


def _on_cluster(client: Any, address: str, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
    dask = require("distributed", "distributed", "--scheduler")
    futures = [client.submit(function, task, pure=False, retries=RETRIES) for task in tasks]
    try:
        for future in futures:
            yield future.result()
    except PrfError:
        raise
    except (dask.CancelledError, dask.KilledWorker, OSError, TimeoutError) as error:
        raise InputError(
            f"--scheduler {address}: scheduler or workers are lost ({type(error).__name__}). Start them again."
        ) from error


def _version() -> str:
    return __version__


def _in_pool(pool: ProcessPoolExecutor, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # no traceback of a worker that starts
    try:
        found = pool.map(function, tasks)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        yield from found
    except BrokenProcessPool as error:
        raise InputError(
            "a worker was lost. It may need more memory: make --tile-points smaller, or use fewer --workers."
        ) from error


@contextmanager
def _processes(n_workers: int) -> Iterator[ProcessPoolExecutor]:
    context = multiprocessing.get_context("spawn")
    watched, leader = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(n_workers, context, _end_with, (watched,))
    try:
        yield pool
    except BaseException:
        leader.close()  # ends the workers in the middle of their tasks
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _end_with(leader: Connection) -> None:
    """Have this worker end silently on Ctrl-C, and as soon as the other end of `leader` is closed."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=lambda: (wait_for([leader]), os._exit(1)), daemon=True).start()
