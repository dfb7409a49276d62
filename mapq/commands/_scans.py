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

BAG_FILES = (".yaml", ".db3", ".mcap", ".bag")
"""Suffixes of what is in the folder of a ROS bag."""


class ScanOptions(NamedTuple):
    """What the options of a verb give about scans."""

    poses: str | None = None
    calibration: str | None = None
    pattern: str | None = None
    every: int = 1
    submaps: bool = False


def are_scans(inputs: Sequence[str], given: ScanOptions) -> bool:
    """Return whether inputs are scans: by the options, several files, or a folder but a map in tiles or a bag."""
    if given != ScanOptions() or len(inputs) > 1:
        return True
    if not os.path.isdir(inputs[0]):
        return False
    from mapq.tiled.source import is_tiled

    return not (is_tiled(inputs[0]) or any(each.suffix in BAG_FILES for each in Path(inputs[0]).iterdir()))


def default_name(inputs: Sequence[str], suffix: str) -> str:
    """Return the default name of an output: the input's with another suffix; for a folder or its files beside it.

    "." has the name of its folder.
    """
    if len(inputs) == 1 and not os.path.isdir(inputs[0]):
        return beside(inputs[0], suffix)
    folder = inputs[0] if len(inputs) == 1 else os.path.dirname(inputs[0]) or "."
    return (os.path.abspath(folder) if set(folder) <= {".", os.sep} else folder.rstrip(os.sep)) + suffix


def find_settings(given: ScanOptions, chosen: Configuration) -> FindSettings:
    """Return where scans and poses are to be found, by the options and the settings."""
    from mapq.posed import FindSettings

    scans, options = chosen.scans, chosen.cloud.options()
    return FindSettings(given.poses, given.calibration, given.pattern, scans.quaternion, scans.frame, options)


def read_map(inputs: Sequence[str], given: ScanOptions, chosen: Configuration) -> PointCloud:
    """Return the map of scans."""
    from mapq.api import read_scans

    find, merging = find_settings(given, chosen), chosen.scans.merging(given.submaps)
    return read_scans(inputs, find=find, merging=merging, every=given.every)
