"""Posed scans as an input of a verb: a folder, or several files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mapq.commands._options import beside

if TYPE_CHECKING:
    from mapq.cloud import PointCloud
    from mapq.configuration import Configuration
    from mapq.posed import FindSettings

METADATA, BAGS = "metadata.yaml", (".bag", ".db3", ".mcap")
"""What makes a folder a ROS 2 bag."""


class ScanOptions(NamedTuple):
    """What the options of a verb say of scans."""

    poses: str | None
    calibration: str | None
    pattern: str | None
    every: int
    submaps: bool

    @property
    def is_given(self) -> bool:
        """Whether any of them is."""
        return self != ScanOptions(None, None, None, 1, False)


def are_scans(inputs: Sequence[str], given: ScanOptions) -> bool:
    """Return whether inputs are scans: by the options, or several files, or a folder that is no map in tiles, nor bag.

    Raises UsageError for standard input beside other files or options of scans.
    """
    from mapq.tiled.source import is_tiled
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    if not given.is_given and len(inputs) == 1:
        folder = Path(inputs[0])
        if inputs[0] == STREAM or not folder.is_dir() or is_tiled(inputs[0]):
            return False
        return not any(each.name == METADATA or each.suffix in BAGS for each in folder.iterdir())
    if STREAM in inputs:
        raise UsageError("scans are read from files, not from standard input. Name them, or their folder.")
    return True


def default_name(inputs: Sequence[str], given: ScanOptions, suffix: str) -> str:
    """Return the default name of an output: the input's with another suffix; of scans that of their folder, beside it.

    "." has the name of its folder.
    """
    if not are_scans(inputs, given):
        return beside(inputs[0], suffix)
    folder = inputs[0] if os.path.isdir(inputs[0]) else os.path.dirname(inputs[0]) or "."
    folder = os.path.abspath(folder) if set(folder) <= {".", os.sep} else folder.rstrip(os.sep)
    return folder + suffix


def find_settings(given: ScanOptions, chosen: Configuration) -> FindSettings:
    """Return where scans and poses are to be found, by the options and the settings."""
    from mapq.posed import FindSettings

    scans = chosen.scans
    return FindSettings(
        given.poses, given.calibration, given.pattern, scans.quaternion, scans.frame, chosen.cloud.options()
    )


def read_map(inputs: Sequence[str], given: ScanOptions, chosen: Configuration) -> PointCloud:
    """Return the map of scans."""
    from mapq.api import read_scans

    merging = chosen.scans.merging(given.submaps)
    return read_scans(inputs, find=find_settings(given, chosen), merging=merging, every=given.every)
