"""Who does the tasks of a long job: threads of this process, or the workers of a Dask scheduler.

What is wrong with a scheduler is reported in one line, and soon.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from typing import Any

from prf.shell.errors import ConfigError, InputError, PrfError, require

CONNECT_SECONDS = 10.0
"""A scheduler that does not answer for so long is not there."""
RETRIES = 3
"""Times that Dask repeats a task whose worker is lost."""
LARGE_GRAPH = {"distributed.admin.large-graph-warning-threshold": "1TB"}
"""A task holds all that it works on, so that another worker can repeat it: Dask warns of that from 10 MB on."""


Workers = Callable[..., Iterable[Any]]
"""Yields what a function returns for each task, in their order, as :func:`map` does."""


@contextmanager
def open_pool(threads: int, scheduler: str | None, tool: str, version: Callable[[], str]) -> Iterator[Workers]:
    """Give what maps a function over tasks: in threads, or on the workers of the scheduler at an address.

    There each task works on a copy of its arguments. Errors as :func:`open_client`; InputError also if scheduler or
    workers are lost.
    """
    if scheduler is None:
        with ThreadPoolExecutor(threads) as pool:
            yield pool.map
    else:
        with open_client(scheduler, tool, version) as client:
            yield lambda function, *tasks: _on_cluster(client, scheduler, function, *tasks)


def _on_cluster(client: Any, address: str, function: Callable[..., Any], *tasks: Iterable[Any]) -> Iterator[Any]:
    dask = require("distributed", "distributed", "--scheduler")
    with require("dask", "distributed", "--scheduler").config.set(LARGE_GRAPH):
        rows = zip(*tasks, strict=False)
        futures = [client.submit(function, *each, pure=False, retries=RETRIES) for each in rows]
    try:
        for future in futures:
            yield future.result()
    except PrfError:
        raise
    except (dask.CancelledError, dask.KilledWorker, OSError, TimeoutError) as error:
        raise InputError(
            f"--scheduler {address}: scheduler or workers are lost ({type(error).__name__}). Start them again."
        ) from error


@contextmanager
def open_client(address: str, tool: str, version: Callable[[], str]) -> Iterator[Any]:
    """Give a client of the scheduler at `address`, say ``tcp://10.0.0.1:8786``, whose workers have the same `tool`.

    `version`: of a module of the tool that workers need; they call it too. ConfigError if there are no workers, or they
    have another version; InputError if no scheduler answers.
    """
    dask = require("distributed", "distributed", "--scheduler")
    with _silence("distributed", "distributed.client", "asyncio"):
        try:
            client = dask.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                f"--scheduler {address}: no scheduler answers there. Start one: dask scheduler."
            ) from error
        with closing(client):
            _check_versions(client, address, tool, version)
            yield client


def _check_versions(client: Any, address: str, tool: str, version: Callable[[], str]) -> None:
    """Raise ConfigError if the workers have another version than this process, or there are none."""
    own = version()
    try:
        versions = set(client.run(version).values())
    except Exception as error:
        raise ConfigError(f"--scheduler {address}: its workers cannot import {tool} {own}. Install it.") from error
    if versions != {own}:
        what = f"its workers have {tool} {', '.join(sorted(versions))}" if versions else "it has no workers"
        raise ConfigError(f"--scheduler {address}: {what}. Start workers with {tool} {own}.")


@contextmanager
def _silence(*names: str) -> Iterator[None]:
    """Keep these loggers from many lines where an error has one."""
    loggers = [logging.getLogger(name) for name in names]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
