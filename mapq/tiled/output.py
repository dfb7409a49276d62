"""Where the result of a map in tiles is written: one cloud with a JSON beside it, or a folder of both."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import groupby
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from typing import Any, NamedTuple

from mapq import __version__
from mapq.cloud import PointCloud
from mapq.io.ply import write_ply_pieces
from mapq.io.results import claim_result, json_beside, result_lines
from mapq.io.tiles import RESULT_JSON, MapFiles
from mapq.io.write import LAS_SUFFIXES, WRITERS, open_las_pieces, write_cloud
from prf.shell.cli.files import STREAM, atomic_write, together
from prf.shell.cli.outputs import claim, claim_output
from prf.shell.errors import InputError, OutputExists, UsageError
from prf.shell.scheduler import Workers, open_pool

CLOUD_SUFFIXES = (*LAS_SUFFIXES, *WRITERS)
IN_PIECES = (*LAS_SUFFIXES, ".ply")
"""Formats that are written piece by piece."""
COPC = ".copc.laz"


class Output(NamedTuple):
    """What is written: the file for the points of each source, and the JSON."""

    path: str
    is_folder: bool
    files: tuple[str, ...]
    json: str


def plan_output(path: str, whole: MapFiles, is_tiled: bool, force: bool) -> Output:
    """Return what is written under a name: a folder for a folder, unless the name is that of a cloud.

    Raises OutputExists, OutputError if it exists and `force` is not given, holds other tiles, or cannot be written;
    UsageError if it is standard output, in a format that is not written in tiles, or the folder of the input.
    """
    if path == STREAM:
        raise UsageError("a map in tiles cannot be written to standard output. Name a file or a folder with -o.")
    if not is_tiled or path.lower().endswith(CLOUD_SUFFIXES) or path == os.devnull:
        if whole.heads[0].las_header and path.lower().endswith(CLOUD_SUFFIXES) and not path.lower().endswith(IN_PIECES):
            raise UsageError(f"{path}: a map from LAS in tiles is written as LAS, LAZ or PLY. Name such a file.")
        claim_result(path, force)
        return Output(path, False, (path,) * len(whole.heads), json_beside(path))
    folder = Path(path)
    if folder.is_dir() and any(os.path.samefile(folder, Path(head.path).parent) for head in whole.heads):
        raise UsageError(f"{path} is the input and would be overwritten. Name another folder with -o.")
    if not folder.is_dir():
        claim_output(path, force)
    elif not force and any(folder.iterdir()):
        raise OutputExists(f"{path} already exists. Use --force to overwrite.")
    files = tuple(str(folder / _name(head.path)) for head in whole.heads)
    others = sorted({str(each) for each in folder.glob("*") if each.suffix.lower() in LAS_SUFFIXES} - set(files))
    if others:
        raise OutputExists(f"{others[0]} would be taken for a tile of the result. Remove it, or name another folder.")
    claim(path)
    return Output(path, True, files, str(folder / RESULT_JSON))


def _name(path: str) -> str:
    """Return the name of a tile of the result: that of its source; COPC becomes plain LAZ."""
    name = Path(path).name
    return name[: -len(COPC)] + ".laz" if name.lower().endswith(COPC) else name


def write_map(
    work: str,
    output: Output,
    whole: MapFiles,
    clouds: Iterable[tuple[int, PointCloud]],
    json: tuple[Mapping[str, Any], Iterable[Mapping[str, Any]]],
) -> None:
    """Write all files in the work folder, and move them to their places together.

    `clouds` (int, PointCloud): pieces of the result in order, with the number of their file. `json` (mapping, iterable
    of mapping): head and patches. Raises OutputError if that cannot be done; then all files are as they were before.
    """
    if output.path == os.devnull:
        return
    made = {name: os.path.join(work, f"made_{Path(name).name}") for name in output.files}
    for name, pieces in groupby(clouds, lambda piece: output.files[piece[0]]):
        if not whole.heads[0].las_header:
            write_cloud(made[name], next(pieces)[1])
            continue
        if not name.lower().endswith(LAS_SUFFIXES):
            write_ply_pieces(made[name], whole.n_points, (cloud for _, cloud in pieces))
            continue
        with open_las_pieces(made[name]) as sink:
            for _, cloud in pieces:
                sink.write(cloud)
    if output.is_folder:
        Path(output.path).mkdir(exist_ok=True)
    with together() as group:
        for name, path in made.items():
            group.add(path, Path(os.path.realpath(name)))
        with atomic_write(output.json) as stream:
            stream.writelines(result_lines(*json))


@contextmanager
def open_workers(n_workers: int, scheduler: str | None) -> Iterator[Workers]:
    """Give what maps a function over tasks.

    `n_workers`: processes on this machine; one is this process. `scheduler`: address of a Dask scheduler, whose workers
    are used instead. They must see the files of the map and the work folder under the same names. Errors as
    :func:`prf.shell.scheduler.open_pool`; InputError also if a process is lost.
    """
    if scheduler is not None:
        with open_pool(1, scheduler, "mapq", _version) as workers:
            yield workers
    elif n_workers <= 1:
        yield map
    else:
        with _processes(n_workers) as pool:
            yield lambda function, tasks: _in_pool(pool, function, tasks)


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
