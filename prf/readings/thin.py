"""Fewer readings: every k-th scan or beam, a run of scans, or all but a run of scans."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.readings.readings import Readings
from prf.readings.text import IntArray
from prf.shell.errors import ConfigError, InputError


def thin(
    readings: Readings,
    every_scan: int = 1,
    every_beam: int = 1,
    scans: str | None = None,
    skip_scans: str | None = None,
) -> Readings:
    """Return the readings that pass every one of the given conditions.

    Scans and beams are selected by their numbers in the log, so selections such as ``skip_scans="9::10"`` and
    ``scans="9::10"`` share no beam however they are combined with the other conditions.

    `readings`: the whole log. `every_scan`: K keeps scans 0, K, 2 K ... `every_beam`: K keeps beams 0, K, 2 K ... of
    each scan. `scans`: ``START:STOP:STEP`` keeps scans START, START + STEP ... below STOP. As in Python, each part may
    be empty, and a negative START or STOP counts from the end of the log. `skip_scans`: the same for scans to leave
    out.
    """
    if not readings.n_beams:
        raise InputError(f"{readings.source}: there are no readings to choose from.")
    for flag, step in (("--every-scan", every_scan), ("--every-beam", every_beam)):
        if step < 1:
            raise ConfigError(f"{flag} {step}: must be at least 1.")
    n_scans = _log_length(readings)
    keep = _multiple(readings.scan, every_scan) & _multiple(readings.beam, every_beam)
    if scans is not None:
        keep &= _in_slice(readings.scan, scans, n_scans, "--scans")
    if skip_scans is not None:
        keep &= ~_in_slice(readings.scan, skip_scans, n_scans, "--skip-scans")
    if not keep.any():
        raise InputError(
            f"{readings.source}: no reading is left of {readings.n_beams} in scans 0 to {n_scans - 1}. "
            "Widen --scans, or lower --every-scan, --every-beam or --skip-scans."
        )
    return readings.where(keep)


def parse_slice(text: str, flag: str) -> slice:
    """Return ``START:STOP`` or ``START:STOP:STEP`` of option `flag` as a slice; STEP is at least 1."""
    parts = text.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise ConfigError(f"{flag} {text!r}: give START:STOP:STEP in whole numbers, e.g. 0:100:5 or 50: or ::10.")
    chosen = slice(*numbers)
    if chosen.step is not None and chosen.step < 1:
        raise ConfigError(f"{flag} {text!r}: STEP must be at least 1.")
    return chosen


def _in_slice(scan: IntArray, text: str, n_scans: int, flag: str) -> NDArray[np.bool_]:
    start, stop, step = parse_slice(text, flag).indices(n_scans)
    return (scan >= start) & (scan < stop) & _multiple(scan - start, step)


def _multiple(number: IntArray | NDArray[np.int32], step: int) -> NDArray[np.bool_]:
    """Return which numbers are multiples of `step`, a Python integer of any size."""
    multiple: NDArray[np.bool_] = number.astype(np.int64) % min(step, np.iinfo(np.int64).max) == 0
    return multiple


def _log_length(readings: Readings) -> int:
    """Return one more than the highest scan number of the log, scans that lost all their beams included."""
    numbers = readings.notes.scans.number
    return int(max(readings.scan.max(), numbers.max() if len(numbers) else 0)) + 1
