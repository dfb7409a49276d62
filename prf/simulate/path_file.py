"""A path from a CSV file: waypoints to drive along, or the poses of the scans themselves."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from prf.shell.errors import InputError
from prf.shell.files import open_input
from prf.simulate.path import SPEED, TURNING, Scans
from prf.simulate.world import Floats, World

COLUMNS = ("x", "y", "theta", "t")


class PathFile(NamedTuple):
    """The rows of a file.

    Attributes
    ----------
    source : str
    line : (n,) int64
        Lines of the rows.
    rows : (n, 2), (n, 3) or (n, 4) float64
        Waypoints x, y in metres, or poses with the heading in radians and perhaps the time in seconds.
    """

    source: str
    line: np.ndarray[tuple[int], np.dtype[np.int64]]
    rows: Floats

    @property
    def has_headings(self) -> bool:
        """Whether the rows are poses at which to measure."""
        return bool(self.rows.shape[1] > 2)

    def scans(self) -> Scans:
        """Return scans at the poses; without times the robot turns and drives from one to the next."""
        if self.rows.shape[1] == len(COLUMNS):
            return Scans.rounded(self.rows[:, :3], self.rows[:, 3])
        turn = np.abs(np.angle(np.exp(1j * np.diff(self.rows[:, 2]))))
        seconds = np.hypot(*np.diff(self.rows[:, :2], axis=0).T) / SPEED + turn / TURNING
        return Scans.rounded(self.rows, np.r_[0.0, np.cumsum(seconds)])

    def check(self, world: World) -> None:
        """Refuse a path that runs into a wall or out of the window.

        Raises
        ------
        InputError
            With the line of the first row that cannot be driven to.
        """
        free = world.free_at(self.rows[:, :2])
        if not free.all():
            first = int(np.argmin(free))
            x, y = self.rows[first, :2]
            raise InputError(f"{self.source}:{self.line[first]}: ({x:g}, {y:g}) is occupied or outside the world.")
        if self.has_headings or len(self.rows) < 2:
            return
        legs = shapely.linestrings(np.stack([self.rows[:-1], self.rows[1:]], axis=1))
        hit = shapely.intersects(world.occupied, legs)
        if hit.any():
            first = int(np.argmax(hit))
            a, b = self.line[first], self.line[first + 1]
            raise InputError(f"{self.source}:{b}: the way from the waypoint of line {a} runs into a wall.")


def read_path(path: str | os.PathLike[str]) -> PathFile:
    """Read a path: CSV with the columns x, y and perhaps theta and t; without a header, in this order.

    With theta the rows are poses to measure at, and t is the time; without theta they are waypoints and t is not read.
    Blank lines and lines that start with # are passed over.

    Parameters
    ----------
    path : path
        ``-`` is standard input.

    Raises
    ------
    InputError
        If the file is missing or has no rows, or a row has no finite numbers; with ``path:line``.
    """
    with open_input(path) as stream:
        try:
            text = stream.read().decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: not UTF-8 text. Give a CSV with the columns x,y or x,y,theta.") from error
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    rows = [(reader.line_num, row) for row in reader if any(map(str.strip, row)) and not row[0].startswith("#")]
    places = _places(rows[0][1]) if rows else []
    if places:
        rows = rows[1:]
    if not rows:
        raise InputError(f"{path}: no waypoint in it. Give a CSV with the columns x,y or x,y,theta.")
    places = places or list(range(min(len(rows[0][1]), len(COLUMNS))))
    numbers = [_numbers(f"{path}:{line}", row, places) for line, row in rows]
    return PathFile(str(path), np.array([line for line, _ in rows]), np.array(numbers))


def _places(header: Sequence[str]) -> list[int]:
    """Return the places of the columns in a header; none if the row is no header."""
    names = [name.strip().lower() for name in header]
    if not {"x", "y"} <= set(names):
        return []
    wanted = COLUMNS if "theta" in names else COLUMNS[:2]
    return [names.index(name) for name in wanted if name in names]


def _numbers(where: str, row: Sequence[str], places: Sequence[int]) -> list[float]:
    try:
        numbers = [float(row[place]) for place in places]
    except (ValueError, IndexError):
        numbers = []
    if len(numbers) < 2 or not all(map(math.isfinite, numbers)):
        raise InputError(
            f"{where}: {','.join(row)!r} is no waypoint. Give finite x,y in metres, theta in radians, t in seconds."
        )
    return numbers
