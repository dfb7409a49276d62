"""Which files of a folder are scans, and which file holds their poses."""

from __future__ import annotations

import fnmatch
import os
import re
from collections.abc import Sequence
from pathlib import Path

from mapq.io.content import suffix_of
from prf.shell.errors import InputError

UOS_SUFFIX, E57_SUFFIX = ".3d", ".e57"
SCAN_SUFFIXES = (".bin", ".pcd", ".ply", ".xyz", ".npy", ".npz", ".las", ".laz", ".ptx", UOS_SUFFIX, E57_SUFFIX)
POSE_NAME = re.compile(r"(pose|traj|graph|odometry).*\.(txt|json|csv|tum|g2o)$", re.IGNORECASE)
"""Names that files of poses have; ``graph.txt`` is that of gtsam_points: a name, a place and a quaternion a row."""
STAMP = re.compile(r"\d+\.\d+|[1-9](?:\d{18}|\d{15}|\d{12}|\d{9})")
"""Stem of a file that is named after a time: in seconds, or a whole number of s, ms, us or ns since 1970."""
TICKS = {10: 1.0, 13: 1e-3, 16: 1e-6, 19: 1e-9}
"""Digits of such a number to its unit in seconds."""
LAST_NUMBER = re.compile(r"\d+(?=\D*$)")
"""What numbers the files of a set: ``scan2_007.pcd`` is the seventh."""
RESULT = ".classified."
"""In the names of results, which are not scans."""
MOST_LISTED = 4
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
    refuse_run(folder)
    files = [path for path in (*here.glob("*"), *here.glob("*/*")) if path.is_file()]
    if pattern is not None:
        named = [str(path) for path in files if fnmatch.fnmatch(path.relative_to(here).as_posix(), pattern)]
        if not named:
            raise InputError(f"{folder}: no file in it is called {pattern}. Check --scans.")
        return sorted(named, key=natural_key)
    families: dict[str, list[str]] = {}
    for path in sorted(files):
        name = family(path.relative_to(here))
        is_scan = suffix_of(path.name) in SCAN_SUFFIXES and RESULT not in name
        if is_scan and ("*" in name or suffix_of(name) == E57_SUFFIX):
            families.setdefault(name, []).append(str(path))
    if not families:
        raise InputError(f"{folder}: no scans in it: no numbered files such as 000000.bin, 0.pcd or scan000.3d.")
    if len(families) > 1:
        names = ", ".join(f"{name} ({len(found)})" for name, found in list(families.items())[:MOST_LISTED])
        raise InputError(f"{folder}: several sets of scans: {names}. Choose one with --scans.")
    return sorted(next(iter(families.values())), key=natural_key)


def refuse_run(folder: str) -> None:
    """Raise InputError if a folder is what prf wrote."""
    if (Path(folder) / "manifest.json").is_file():
        raise InputError(f"{folder}: a RUN of prf, whose maps are of the plane. Show it: prf report {folder}")


def stem_of(path: str) -> str:
    """Return the name of a file without its suffix, nor that of gzip."""
    return Path(path.removesuffix(".gz")).stem


def stamp_of(path: str) -> float | None:
    """Return the time in seconds that a file is named after, such as 1305031102.1753.pcd; None if it is not."""
    stem = stem_of(path)
    if not STAMP.fullmatch(stem):
        return None
    return float(stem) if "." in stem else int(stem) * TICKS[len(stem)]


def family(path: Path) -> str:
    """Return the name of a path with its last number, or the time that it is, replaced by ``*``."""
    number = STAMP if stamp_of(path.name) is not None else LAST_NUMBER
    stem, found = number.subn("*", stem_of(path.name), count=1)
    return (path.parent / (f"{stem}{suffix_of(path.name)}" if found else path.name)).as_posix()


def natural_key(path: str) -> tuple[list[tuple[int, float, str]], str]:
    """Return what sorts names by the numbers in them, 2 before 10, and names that are times by these."""
    stamp = stamp_of(path)
    parts = re.findall(r"\d+|\D+", path if stamp is None else os.path.dirname(path))
    key: list[tuple[int, float, str]] = [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]
    return key if stamp is None else [*key, (0, stamp, "")], path


def number_of(path: str) -> int | None:
    """Return the last number in the name of a file, None if it has none."""
    numbers = re.findall(r"\d+", stem_of(path))
    return int(numbers[-1]) if numbers else None


def pose_names(folder: str | os.PathLike[str]) -> list[str]:
    """Return the files of poses in a folder."""
    return [str(path) for path in sorted(Path(folder).glob("*")) if path.is_file() and POSE_NAME.search(path.name)]


def pose_file(files: Sequence[str]) -> str | None:
    """Return the only file of poses beside the scans, or in the folder above theirs; None if there is none."""
    folder = Path(files[0]).parent
    for place in (folder, folder.parent):
        found = pose_names(place)
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(found[:MOST_LISTED])
            raise InputError(f"{folder}: which file has the poses: {names}? Name it with --poses.")
    return None
