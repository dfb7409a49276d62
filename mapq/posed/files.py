"""Which files of a folder are scans, and which file holds their poses."""

from __future__ import annotations

import fnmatch
import os
import re
from collections.abc import Sequence
from pathlib import Path

from mapq.io.content import suffix_of
from prf.shell.errors import InputError, system_reason

UOS_SUFFIX, E57_SUFFIX = ".3d", ".e57"
SCAN_SUFFIXES = (".bin", ".pcd", ".ply", ".xyz", ".npy", ".npz", ".las", ".laz", ".ptx", UOS_SUFFIX, E57_SUFFIX)
POSE_NAME = re.compile(r"(pose|traj|graph|odometry).*\.(txt|json|csv|tum|g2o)$", re.IGNORECASE)
"""Names that files of poses have; ``graph.txt`` is that of gtsam_points: a name, a place and a quaternion a row."""
STAMP = re.compile(r"\d+\.\d+")
"""Stem of a file that is named after a time in seconds."""
LAST_NUMBER = re.compile(r"\d+(?=\D*$)")
"""What numbers the files of a set: ``scan2_007.pcd`` is the seventh."""
LONGEST_NAME = 255
"""Letters; a table of poses may have longer ones."""
SCANS_SHOWN = 4
"""Sets of scans, or files of poses, that a message names."""


def scan_files(folder: str, pattern: str | None) -> list[str]:
    """Return the scans of a folder or of a folder in it, in natural order.

    Parameters
    ----------
    folder : str
    pattern : str or None
        Names of the scans, such as ``planes_*.bin``; None: all files of points whose names differ in a number alone.
    """
    here = Path(folder)
    try:
        os.scandir(here).close()
    except OSError as error:
        raise InputError(f"{folder}: {system_reason(error)}.") from error
    files = sorted(path for path in (*here.glob("*"), *here.glob("*/*")) if path.is_file())
    if pattern is not None:
        named = (path for path in files if fnmatch.fnmatch(path.relative_to(here).as_posix(), pattern))
        found = sorted((str(path) for path in named), key=natural_key)
        if not found:
            raise InputError(f"{folder}: no file in it is called {pattern}. Check --scans.")
        return found
    families: dict[str, list[str]] = {}
    for path in files:
        if suffix_of(path.name) in SCAN_SUFFIXES:
            families.setdefault(family(path.relative_to(here)), []).append(str(path))
    several = {name: found for name, found in families.items() if "*" in name or suffix_of(name) == E57_SUFFIX}
    if not several:
        raise InputError(f"{folder}: no scans in it: no numbered files such as 000000.bin, 0.pcd or scan000.3d.")
    if len(several) > 1:
        names = ", ".join(f"{name} ({len(found)})" for name, found in list(several.items())[:SCANS_SHOWN])
        raise InputError(f"{folder}: several sets of scans: {names}. Choose one with --scans.")
    return sorted(next(iter(several.values())), key=natural_key)


def stem_of(path: str) -> str:
    """Return the name of a file without its suffix, nor that of gzip."""
    return Path(path).name.removesuffix(".gz").rpartition(".")[0]


def stamp_of(path: str) -> float | None:
    """Return the time that the name of a file is, as 1305031102.1753.pcd tells one; None if it is none."""
    stem = stem_of(path)
    return float(stem) if STAMP.fullmatch(stem) else None


def family(path: Path) -> str:
    """Return the name of a path with its last number replaced by ``*``; of a time, all of it."""
    number = STAMP if stamp_of(path.name) is not None else LAST_NUMBER
    stem, found = number.subn("*", stem_of(path.name), count=1)
    name = f"{stem}{suffix_of(path.name)}" if found else path.name
    return (path.parent / name).as_posix()


def natural_key(path: str) -> tuple[list[tuple[int, float, str]], str]:
    """Return what sorts names by the numbers in them, 2 before 10, and names that are times by these."""
    stamp = stamp_of(path)
    parts = re.findall(r"\d+|\D+", path if stamp is None else os.path.dirname(path))
    key: list[tuple[int, float, str]] = [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]
    return key if stamp is None else [*key, (0, stamp, "")], path


def number_of(path: str) -> int | None:
    """Return the last number in the name of a file, None if it has none, or one of more digits than names have."""
    numbers = re.findall(r"\d+", stem_of(path))
    return int(numbers[-1]) if numbers and len(numbers[-1]) <= LONGEST_NAME else None


def pose_file(files: Sequence[str]) -> str:
    """Return the only file of poses beside the scans, or in the folder above theirs."""
    folder = Path(files[0]).parent
    for place in (folder, folder.parent):
        found = [str(path) for path in sorted(place.glob("*")) if path.is_file() and POSE_NAME.search(path.name)]
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(found[:SCANS_SHOWN])
            raise InputError(f"{folder}: which file has the poses: {names}? Name it with --poses.")
    raise InputError(f"{files[0]}: no file of poses beside the scans. Name it with --poses.")


def refuse_missing(files: Sequence[str]) -> None:
    """Raise InputError for the first scan that is no file, before those before it are read."""
    for path in files:
        if Path(path).is_dir():
            raise InputError(f"{path}: this is a folder; give one folder alone, or files.")
        if not Path(path).is_file():
            raise InputError(f"{path}: no such file or directory.")
