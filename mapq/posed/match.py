"""Which pose is that of which scan: by times, names, order or numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mapq.posed.files import number_of, stamp_of, stem_of
from prf.shell.errors import InputError
from prf.shell.poses.files import PoseFile, interpolate, rigid

SAME_TIME = 1e-3
"""Seconds within which the name of a scan is the time of a pose: either may have been rounded."""
CLOSE_POSES = 0.25
"""Seconds between two poses, between which a scan's is interpolated: a robot moves evenly for so long."""

Floats = NDArray[np.float64]


def times_of(names: Sequence[str]) -> Floats | None:
    """Return the times (k,) in seconds that all scans are named after; None if they are not."""
    stamps = [stamp_of(name) for name in names]
    return None if None in stamps else np.array(stamps, np.float64)


def with_poses_at(table: PoseFile, names: Sequence[str]) -> PoseFile:
    """Return the poses in the order of time, and one more at the time of each scan that lies between close ones."""
    stamps = times_of(names)
    if table.times is None or stamps is None or table.names is not None:
        return table
    times, first = np.unique(table.times, return_index=True)
    after = np.searchsorted(times, stamps)
    inside = np.flatnonzero((after > 0) & (after < len(times)))
    low, high, at = times[after[inside] - 1], times[after[inside]], stamps[inside]
    between = (high - low <= CLOSE_POSES) & (np.minimum(at - low, high - at) > SAME_TIME)
    if not between.any():
        return table
    new, poses = np.unique(at[between]), table.poses[first]
    place, turn = interpolate(times, poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]), new)
    order = np.argsort(np.concatenate([times, new]))
    return table._replace(
        poses=np.concatenate([poses, rigid(turn.as_matrix(), place)])[order], times=np.concatenate([times, new])[order]
    )


def match_poses(names: Sequence[str], table: PoseFile, path: str) -> NDArray[np.int64]:
    """Return the row (k,) of the table that is the pose of each scan, -1 where there is none of its time or name.

    Scans whose names are times are matched by time, where the table has times; else by the names of the table, or the
    last numbers in these if they are those of the scans; else one row a scan by order; else the last number in a scan's
    name picks the row of that number or, without names, of that place, from 0: as the poses of a whole KITTI sequence
    and some of its scans.
    """
    found = _by_time(names, table)
    found = found if found is not None else _by_name(names, table)
    if found is not None:
        return found
    keys = range(len(table.poses)) if table.names is None else (number_of(f"{name}.x") for name in table.names)
    known = {number: row for row, number in enumerate(keys)}
    rows = [known.get(number_of(name), -1) for name in names]
    if len(table.poses) == len(names):
        is_numbered = table.names is not None and sorted(rows) == list(range(len(rows)))
        return np.array(rows, np.int64) if is_numbered else np.arange(len(names))
    some = [row for row in rows if row >= 0]
    is_known = bool(some) if table.names is not None else len(some) == len(rows)
    if not is_known or len(set(some)) < len(some) or times_of(names) is not None:
        raise InputError(
            f"{path}: {len(table.poses)} poses for {len(names)} scans, and neither times nor numbers in the names of "
            "the scans identify theirs. Give other poses, or other scans (in a folder: --scans)."
        )
    if table.times is not None:
        _refuse_other_numbers(names, rows, table.times, path)
    return np.array(rows, np.int64)


def _by_time(names: Sequence[str], table: PoseFile) -> NDArray[np.int64] | None:
    """Return the rows of scans that are named after times; None if none of these is that of a pose."""
    stamps = times_of(names)
    if table.times is None or stamps is None:
        return None
    order = np.argsort(table.times, kind="stable")
    middle = 0.5 * (table.times[order][1:] + table.times[order][:-1])
    nearest = order[np.searchsorted(middle, stamps)]
    near = np.abs(table.times[nearest] - stamps) <= SAME_TIME
    return np.where(near, nearest, -1) if near.any() else None


def _by_name(names: Sequence[str], table: PoseFile) -> NDArray[np.int64] | None:
    """Return the rows of scans whose files, or their stems, the table names; None if it names none."""
    named = [Path(name).name for name in table.names or ()]
    known = {stem_of(name): row for row, name in enumerate(named)} | {name: row for row, name in enumerate(named)}
    rows = [known.get(Path(name).name, known.get(stem_of(name), -1)) for name in names]
    return np.array(rows, np.int64) if max(rows) >= 0 else None


def _refuse_other_numbers(names: Sequence[str], rows: list[int], times: Floats, path: str) -> None:
    """Raise InputError if the first column may be numbers of scans, by which other rows are theirs than by place."""
    row_of: dict[float | None, int] = {time: row for row, time in enumerate(times.tolist())}
    by_number = [row_of.get(number_of(name), -1) for name in names]
    if min(by_number) >= 0 and by_number != rows:
        raise InputError(
            f"{path}: is the first column times, or numbers of scans? By number {names[0]} has row {by_number[0] + 1}, "
            f"by place row {rows[0] + 1}. Give a row a scan, or leave the column out."
        )
