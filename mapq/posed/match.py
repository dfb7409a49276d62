"""Which pose of a table is that of which scan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapq.posed.files import number_of, stamp_of
from mapq.posed.poses import PoseTable
from prf.shell.errors import InputError

SAME_TIME = 1e-3
"""Seconds within which the name of a scan is the time of a pose: either may have been rounded."""


def match_poses(names: Sequence[str], table: PoseTable, path: str) -> NDArray[np.int64]:
    """Return the row (k,) of the table that is the pose of each scan.

    Scans whose names are times go by these, where the table has them. Else one row a scan goes by order, and else the
    last number in a scan's name picks the row of that name or, without names, of that place, from 0: as the poses of a
    whole KITTI sequence go with some of its scans.

    Raises
    ------
    InputError
        If neither fits.
    """
    stamps = [stamp_of(name) for name in names]
    found = _match_times(np.array(stamps, np.float64), table.times) if table.times is not None else None
    if found is not None:
        return found
    if len(table.poses) == len(names):
        return np.arange(len(names))
    wrong = InputError(
        f"{path}: {len(table.poses)} poses for {len(names)} scans, and the numbers in the names of the scans do not "
        f"tell which are theirs. Choose scans with --scans, or other poses with --poses."
    )
    if any(stamp is not None for stamp in stamps):
        raise wrong
    if table.names is not None:
        known = {number_of(f"{name}.x"): row for row, name in enumerate(table.names)}
    else:
        known = {row: row for row in range(len(table.poses))}
    rows = [known.get(number_of(name), -1) for name in names]
    if min(rows) < 0 or len(set(rows)) < len(rows):
        raise wrong
    if table.times is not None:
        _refuse_other_numbers([number_of(name) for name in names], rows, table.times, path)
    return np.array(rows, np.int64)


def _refuse_other_numbers(
    numbers: Sequence[int | None], rows: Sequence[int], times: NDArray[np.float64], path: str
) -> None:
    """Raise InputError if the first column may be numbers of scans, by which other rows are theirs than by place."""
    row_of = {float(time): row for row, time in enumerate(times.tolist())}
    by_number = [row_of.get(-1.0 if number is None else float(number), -1) for number in numbers]
    if min(by_number) >= 0 and by_number != list(rows):
        raise InputError(
            f"{path}: are the whole numbers of its first column times, or the numbers of scans? By these scan "
            f"{numbers[0]} has row {by_number[0] + 1}, by its place row {rows[0] + 1}. Give a row a scan, or leave the "
            f"column out."
        )


def _match_times(stamps: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.int64] | None:
    """Return the row (k,) of the times (n,) that each stamp (k,) is; None where one is none, or two are the same."""
    if not np.isfinite(stamps).all():
        return None
    order = np.argsort(times, kind="stable")
    middle = 0.5 * (times[order][1:] + times[order][:-1])
    rows = order[np.searchsorted(middle, stamps)]
    is_one = len(set(rows.tolist())) == len(rows) and (np.abs(times[rows] - stamps) <= SAME_TIME).all()
    return rows if is_one else None
