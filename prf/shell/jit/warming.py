"""The verb ``warm`` of both tools: small jobs that have all kernels compiled before they are needed."""

from __future__ import annotations

import contextlib
import io
import logging
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from prf.shell.cli import console, storage
from prf.shell.cli.run import run_app
from prf.shell.errors import PrfError, UsageError
from prf.shell.jit.cache import KernelCache

logger = logging.getLogger(__name__)


class Job(NamedTuple):
    """What has the kernels of one kind of job compiled: command lines, and a function for what no short one calls."""

    commands: tuple[str, ...]
    call: Callable[[], None] = lambda: None


def warm(
    app: Any, tool: str, cache: KernelCache, jobs: Mapping[str, Job], files: Mapping[str, str], chosen: Sequence[str]
) -> dict[str, Any]:
    """Run the `chosen` jobs, or all, once for every state of the kernels, in a folder that has the `files`.

    Returns what `--json` prints. Raises UsageError for a job that is not there, PrfError if one fails.
    """
    unknown = [name for name in chosen if name not in jobs]
    if unknown:
        raise UsageError(f"--for {unknown[0]}: not one of {', '.join(jobs)}.")
    start = time.monotonic()
    for name in chosen or jobs:
        stamp = cache.folder / f"{name}.warm"
        if not stamp.exists():
            logger.info(f"compiling what {name} needs ...")
            run_job(app, tool, jobs[name], files)
            stamp.touch()
    return {
        "kernels": len(cache.compiled),
        "seconds": round(time.monotonic() - start, 1),
        "cache": str(cache.folder),
    }


def run_job(app: Any, tool: str, job: Job, files: Mapping[str, str]) -> None:
    """Run a job in a folder of its own; all that shows is that kernels are compiled."""
    before = dict(vars(console.settings))
    flags = [] if console.show_progress() else ["--no-progress"]
    logging.disable(logging.CRITICAL)
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            contextlib.chdir(folder),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            for name, text in files.items():
                Path(name).write_text(text)
            for line in job.commands:
                if run_app(app, tool, [*line.split(), *flags]) != 0:
                    raise PrfError(f"{tool} {line}: failed. Run it alone to see why.")
            job.call()
    finally:
        logging.disable(logging.NOTSET)
        vars(console.settings).update(before)


def report(tool: str, found: Mapping[str, Any], json: bool) -> None:
    """Print what was compiled."""
    if json:
        storage.emit_object(f"{tool}.warm/1", found)
    else:
        console.emit(f"{found['kernels']} kernels compiled in {found['seconds']:.0f} s")
        console.emit(f"cache  {found['cache']}")
