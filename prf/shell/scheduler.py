"""The client of a Dask scheduler, as both tools make it: what is wrong is said in one line, and soon."""

from __future__ import annotations

import asyncio
import importlib
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from prf.shell.errors import ConfigError, InputError

CONNECT_SECONDS = 10.0
"""A scheduler that does not answer for so long is not there."""
_LOUD = ("distributed", "distributed.client", "asyncio")
"""Loggers that show tracebacks of what answers and is no scheduler, and of a scheduler that is lost."""


class Cluster:
    """A client of a scheduler whose workers have the same version of a tool; Dask says nothing until it is closed.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://10.0.0.1:8786``.
    tool : str
        Its name.
    version : callable
        Of a module of the tool that workers need; they call it too.

    Attributes
    ----------
    dask : module
        The package ``distributed``.
    client : distributed.Client

    Raises
    ------
    ConfigError
        If the extra ``distributed`` is not installed, there are no workers, or they have another version.
    InputError
        If no scheduler answers at the address.
    """

    def __init__(self, address: str, tool: str, version: Callable[[], str]) -> None:
        self.dask = _import_dask()
        with ExitStack() as open_things:
            open_things.enter_context(_silence())
            self.client = _client(self.dask, address)
            open_things.callback(self.client.close)
            _check_versions(self.client, address, tool, version)
            self._open = open_things.pop_all()

    def close(self) -> None:
        """Leave the scheduler and its workers to themselves."""
        self._open.close()


def _import_dask() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise ConfigError("--scheduler needs the extra: pip install 'prf-mapq[distributed]'") from error


def _client(dask: Any, address: str) -> Any:
    """Return a client, once it is known that a scheduler answers.

    Of what is no scheduler a client waits for the end, half a minute or for ever, and it prints a traceback then.
    """
    message = f"--scheduler {address}: no scheduler answers there. Start one: dask scheduler."
    who = _ask(dask, address)
    if not isinstance(who, dict) or "workers" not in who:
        raise InputError(message) from (who if isinstance(who, Exception) else None)
    try:
        return dask.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise InputError(message) from error


def _ask(dask: Any, address: str) -> Any:
    """Return what answers at an address says of itself, or the error that comes of asking, or None.

    In a thread of its own it can be asked under an event loop, as in a notebook, and given up.
    """
    found: list[Any] = []

    async def identity() -> Any:
        security = dask.Security().get_connection_args("client")
        async with dask.rpc(address, timeout=CONNECT_SECONDS, connection_args=security) as remote:
            return await asyncio.wait_for(remote.identity(), CONNECT_SECONDS)

    def ask() -> None:
        try:
            found.append(asyncio.run(identity()))
        # The first bytes of what else answers may be taken for a length beyond all memory, and the next for anything.
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(2.0 * CONNECT_SECONDS)
    return found[0] if found else None


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
def _silence() -> Iterator[None]:
    """Keep Dask from saying in many lines what is said in one."""
    loggers = [logging.getLogger(name) for name in _LOUD]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
