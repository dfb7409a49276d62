"""Who does the tasks: this process, processes beside it, or the workers of a Dask scheduler.

A task is a function of what it is given and of the files of the work folder, and writes files of its own whole or not
at all. So it may be done twice: a worker that is lost costs its task, which another does again, and nothing else.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from typing import Any, Protocol, TypeVar

from mapq import __version__
from prf.shell.errors import InputError, PrfError
from prf.shell.scheduler import Cluster

RETRIES = 3
"""Times that a task is done again if it fails or its worker is lost."""

Task = TypeVar("Task")
Found = TypeVar("Found")


class Workers(Protocol):
    """What does tasks."""

    def each(
        self, function: Callable[[Task], Found], tasks: Sequence[Task], done: Callable[[int], None]
    ) -> list[Found]:
        """Return what `function` makes of each task, in their order; `done` is told the place of each that is done."""


class Here:
    """The process itself, which does one task after the other."""

    def each(
        self, function: Callable[[Task], Found], tasks: Sequence[Task], done: Callable[[int], None]
    ) -> list[Found]:
        """Do the tasks in order."""
        found = []
        for place, task in enumerate(tasks):
            found.append(_repeated(function, task))
            done(place)
        return found


def _repeated(function: Callable[[Task], Found], task: Task) -> Found:
    """Do a task, and again if the system refuses it; what is wrong with the input stays wrong."""
    for _ in range(RETRIES):
        try:
            return function(task)
        except OSError:
            continue
    return function(task)


def end_with(leader: Connection) -> None:
    """Have this worker end as soon as the other end of `leader` is closed, or Ctrl-C is pressed, and say nothing.

    A leader that is killed closes it too. Else its workers would wait for a next task for ever: each holds the writing
    end of its own queue, which thus never closes.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_await_end, args=(leader,), daemon=True).start()


def _await_end(leader: Connection) -> None:
    wait_for([leader])
    os._exit(1)


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Keep Ctrl-C for the end of the block; a process that starts in it gets none until it asks for it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Processes:
    """Processes on this machine, each with a pool of its own, so that one that is lost does not take the others along.

    Parameters
    ----------
    n_workers : int
    """

    def __init__(self, n_workers: int) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._watched, self._leader = self._context.Pipe(duplex=False)
        self._pools = [self._pool() for _ in range(n_workers)]

    def _pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, self._context, end_with, (self._watched,))

    def close(self) -> None:
        """End the processes at once, also in the middle of a task that nobody waits for any more."""
        self._leader.close()
        for pool in self._pools:
            pool.shutdown(cancel_futures=True)
        self._watched.close()

    def each(
        self, function: Callable[[Task], Found], tasks: Sequence[Task], done: Callable[[int], None]
    ) -> list[Found]:
        """Do the tasks, as many at a time as there are processes; errors as of the function.

        Raises
        ------
        InputError
            If a task loses its process again and again.
        """
        waiting = list(range(len(tasks)))[::-1]
        failed = [0] * len(tasks)
        found: dict[int, Found] = {}
        running: dict[Future[Found], tuple[int, int]] = {}
        while waiting or running:
            busy = {slot for slot, _ in running.values()}
            for slot in (each for each in range(len(self._pools)) if each not in busy):
                if waiting:
                    place = waiting.pop()
                    running[self._submit(slot, function, tasks[place])] = (slot, place)
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                slot, place = running.pop(future)
                if self._take(future, slot, place, failed, found):
                    done(place)
                else:
                    waiting.append(place)
        return [found[place] for place in range(len(tasks))]

    def _submit(self, slot: int, function: Callable[[Task], Found], task: Task) -> Future[Found]:
        with _interrupts_held_back():
            try:
                return self._pools[slot].submit(function, task)
            except BrokenProcessPool:
                self._pools[slot] = self._pool()
                return self._pools[slot].submit(function, task)

    def _take(self, future: Future[Found], slot: int, place: int, failed: list[int], found: dict[int, Found]) -> bool:
        """Keep what a task gave, and return whether it gave anything; its process is replaced if it is lost."""
        try:
            found[place] = future.result()
        except (BrokenProcessPool, OSError) as error:
            failed[place] += 1
            if isinstance(error, BrokenProcessPool):
                self._pools[slot].shutdown()
                self._pools[slot] = self._pool()
            if failed[place] > RETRIES:
                raise InputError(
                    f"a part of the map failed {failed[place]} times ({type(error).__name__}: {error}). It may need "
                    "more memory: make --tile-points smaller, or use fewer --workers."
                ) from error
            return False
        return True


class Dask:
    """The workers of a Dask scheduler; they must see the files of the map and the work folder under the same names.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    ConfigError
        If the extra ``distributed`` is not installed, or the workers have another version of this package.
    InputError
        If no scheduler answers at the address.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._cluster = Cluster(address, "mapq", _version)
        self._dask, self._client = self._cluster.dask, self._cluster.client

    def close(self) -> None:
        """Leave the scheduler and its workers to themselves."""
        self._cluster.close()

    def each(
        self, function: Callable[[Task], Found], tasks: Sequence[Task], done: Callable[[int], None]
    ) -> list[Found]:
        """Have the tasks done; the scheduler gives those of a lost worker to others.

        Raises
        ------
        InputError
            If the scheduler is lost, or a task loses one worker after the other.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the size of what tasks are given
            futures = [self._client.submit(function, task, pure=False, retries=RETRIES) for task in tasks]
        place = {future.key: number for number, future in enumerate(futures)}
        found: dict[int, Found] = {}
        try:
            for future in self._dask.as_completed(futures, loop=self._client.loop):
                found[place[future.key]] = future.result()
                done(place[future.key])
        except PrfError:
            raise
        except (self._dask.CancelledError, self._dask.KilledWorker, OSError, TimeoutError) as error:
            raise InputError(
                f"--scheduler {self.address}: scheduler or workers are lost ({type(error).__name__}). Start them again."
            ) from error
        return [found[number] for number in range(len(tasks))]


def _version() -> str:
    return __version__


@contextmanager
def open_workers(n_workers: int, scheduler: str | None) -> Iterator[Workers]:
    """Give what does the tasks; one worker is this process.

    Parameters
    ----------
    n_workers : int
        Processes on this machine.
    scheduler : str or None
        Address of a Dask scheduler, whose workers are taken instead.
    """
    if scheduler is None and n_workers <= 1:
        yield Here()
        return
    workers: Any = Dask(scheduler) if scheduler is not None else Processes(n_workers)
    try:
        yield workers
    finally:
        workers.close()
