"""CPU seconds and memory of the stages of a job, read from the kernel: nothing but Linux is asked for."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

MB = 1e6


class Stage(NamedTuple):
    """What a stage took.

    Attributes
    ----------
    name : str
    seconds : float
        Of CPU, all threads.
    peak, after : float
        Resident memory in MB: the most during the stage, and what was left at its end.
    note : str
        Counts that tell what was done.
    """

    name: str
    seconds: float
    peak: float
    after: float
    note: str = ""


class Meter:
    """Stages of a job in order; each is printed as it ends."""

    def __init__(self, shown: bool = True) -> None:
        self.stages: list[Stage] = []
        self.shown = shown

    @contextmanager
    def stage(self, name: str) -> Iterator[list[str]]:
        """Measure what is done inside; what is added to the list becomes the note."""
        forget_peak()
        begun, note = time.process_time(), list[str]()
        yield note
        self.stages.append(Stage(name, time.process_time() - begun, peak(), resident(), ", ".join(note)))
        if self.shown:
            print(line(self.stages[-1]), flush=True)


def line(stage: Stage) -> str:
    """Return a stage as a row of a Markdown table."""
    return f"| {stage.name} | {stage.seconds:.1f} | {stage.peak:,.0f} | {stage.after:,.0f} | {stage.note} |"


def resident() -> float:
    """Return the resident memory of this process now, MB."""
    return _status("VmRSS")


def peak() -> float:
    """Return the most since :func:`forget_peak`, MB."""
    return _status("VmHWM")


def forget_peak() -> None:
    """Let the peak count from now on."""
    Path("/proc/self/clear_refs").write_text("5")


def _status(name: str) -> float:
    for row in Path("/proc/self/status").read_text().splitlines():
        if row.startswith(f"{name}:"):
            return float(row.split()[1]) * 1024.0 / MB
    raise LookupError(name)
