"""What readings show of the ground before any map, and beams of a dense log thinned to those that differ.

The window of the readings, and the cells that they saw: of cells that no reading crossed or ended in a map knows the
prior alone.

:func:`thin_beams` keeps a step as cheap for a longer log (docs/large-jobs.md). Beams are drawn evenly from strata:
those of one stratum end in one square, are from one of eight directions, and all have a return or all have none. Their
information is nearly the same, so of n beams some n^EVENNESS are kept. With the exponent 1 that is plain subsampling;
with 0 every place has the same number, and what is rare (people who walked by, the fringe of a wall blurred by errors
of the poses) weighs as much as the wall.

Free space is known by the beams that cross it, and some of it by a few alone: those that look through a door, or along
a wall. A cell that is passed must stay passed by some beams, or what was seen would become unseen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels.readings.cones import MAX_DISTANCE
from prf.kernels.score.passed_cells import choose_lacking, count_passes, mark_cones, mark_up_to
from prf.kernels.state.grid import Grid, cells_of, make_grid, most_cells
from prf.model.arak import expected_edges
from prf.model.layout import image_grid
from prf.model.ranges import make_poses, unit_vectors, window_exit
from prf.model.sensors import SonarModel
from prf.model.window import Window
from prf.readings.points import PointTable
from prf.readings.readings import Readings
from prf.readings.text import IntArray
from prf.shell.errors import ConfigError, InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

KEPT_RETURNS = 0.995
"""Share of the returns that the default window holds at least."""
MARGIN = 1.0
"""Metres between them and the border of the default window."""
MOST_EDGES = 2.5e6
"""Of maps by the prior alone: a window of 4.5 km at scale 0.1, where each chain takes 2 GB and draws never agree."""


def chosen_window(requested: Sequence[float] | None, sensors: Sequence[Readings], scale: float = 0.0) -> Window:
    """Return the window requested, or one round all sensors and 99.5 % of the returns.

    Raises
    ------
    InputError
        If no machine could hold a polygonal map of it at `scale` (1/m; 0: not asked), as of ranges in another unit.
    ConfigError
        The same of what was requested, or if that is no window.
    """
    if requested is not None:
        window = Window.checked(*requested)
        if expected_edges(scale, window) > MOST_EDGES:
            raise ConfigError(f"--window: {_too_large(window, scale)}. Give a smaller one, or a smaller --scale.")
        return window
    origin, angle, ranges = (
        np.concatenate([getattr(part, name) for part in sensors]) for name in ("origin", "angle", "range")
    )
    hit = np.isfinite(ranges)
    ends = origin[hit] + ranges[hit, None] * unit_vectors(angle[hit])
    low, high = origin.min(axis=0), origin.max(axis=0)
    if len(ends) > 0:
        # A quarter of what may be left out on each of the four sides.
        tail = (1.0 - KEPT_RETURNS) / 4.0
        low = np.minimum(low, np.quantile(ends, tail, axis=0, method="lower"))
        high = np.maximum(high, np.quantile(ends, 1.0 - tail, axis=0, method="higher"))
    window = Window.checked(*(low - MARGIN).tolist(), *(high + MARGIN).tolist())
    if expected_edges(scale, window) > MOST_EDGES:
        source = " and ".join(part.source for part in sensors if part.n_beams)
        usual = float(np.median(ranges[hit])) if hit.any() else 0.0
        raise InputError(
            f"{source}: the readings reach over {_too_large(window, scale)}; half of the ranges are above {usual:.4g} "
            "m. Save ranges and poses in metres, or give --max-range, --window or a smaller --scale."
        )
    return window


def _too_large(window: Window, scale: float) -> str:
    return f"{window.width:.0f} x {window.height:.0f} m, of which no memory holds maps at scale {scale:g}"


def seen_cells(
    window: Window, resolution: float, laser: Readings | None, sonar: Readings | None, points: PointTable | None
) -> NDArray[np.bool_]:
    """Return the cells (ny, nx) of the image that readings crossed or ended in; values at points concern all of it."""
    grid = image_grid(window, resolution)
    seen = np.full((grid.ny, grid.nx), points is not None)
    if laser is not None:
        seen |= seen_by_beams(grid, window, laser)
    if sonar is not None:
        seen |= seen_by_cones(grid, window, sonar.origin, sonar.angle, sonar.cone, sonar.range, sonar.max_range)
    return seen


def beam_ends(window: Window, origin: Floats, angle: Floats, ranges: Floats, max_range: float) -> tuple[Floats, Bools]:
    """Return where beams end inside the window and within reach (n, 2), and which of them (n,) by a return.

    `origin` (n, 2), `angle` (n,), `ranges` (n,).
    """
    direction = unit_vectors(angle)
    reach = np.minimum(window_exit(window, origin, direction), max_range)
    returned: Bools = ranges < reach
    return origin + np.where(returned, ranges, reach)[:, None] * direction, returned


def count_beams(
    grid: Grid, window: Window, origin: Floats, angle: Floats, ranges: Floats, max_range: float
) -> tuple[Ints, Ints, Floats]:
    """Return how many beams reach each cell of a grid (n_cells,), how many return from it, and these returns (m, 2).

    Parameters and units as of :func:`beam_ends`.
    """
    passes = np.zeros(grid.nx * grid.ny, np.int64)
    end, returned = beam_ends(window, origin, angle, ranges, max_range)
    path = np.empty(most_cells(grid), np.int32)
    count_passes(grid, np.ascontiguousarray(origin), np.ascontiguousarray(end), path, passes)
    hits = np.bincount(cells_of(grid, end[returned]), minlength=len(passes))
    return passes, hits, end[returned]


def seen_by_beams(grid: Grid, window: Window, laser: Readings) -> Bools:
    """Return which cells (ny, nx) of a grid beams crossed or ended in.

    One without a return counts up to the first wall that other beams show: that wall is what did not return it.
    """
    start = np.ascontiguousarray(laser.origin)
    end, returned = beam_ends(window, start, laser.angle, laser.range, laser.max_range)
    end, is_empty = np.ascontiguousarray(end), laser.range >= laser.max_range
    path, passes = np.empty(most_cells(grid), np.int32), np.zeros(grid.nx * grid.ny, np.int64)
    count_passes(grid, start[~is_empty], end[~is_empty], path, passes)
    surfaces = np.zeros_like(passes)
    count_passes(grid, *_surfaces(laser, end, returned), path, surfaces)
    seen = passes > 0
    is_wall = (surfaces > 0) & (surfaces >= SOLID * passes)
    mark_up_to(grid, start[is_empty], end[is_empty], is_wall, path, seen)
    return seen.reshape(grid.ny, grid.nx)


def _surfaces(laser: Readings, end: Floats, returned: Bools) -> tuple[Floats, Floats]:
    """Return the pieces of surfaces (s, 2), (s, 2) between returns of a scan that follow one another closely.

    `end` (n, 2), `returned` (n,): of its beams.
    """
    order = np.lexsort((laser.beam, laser.scan))
    one, other = order[:-1], order[1:]
    close = np.hypot(*(end[other] - end[one]).T) < PLACE
    chosen = returned[one] & returned[other] & (laser.scan[one] == laser.scan[other]) & close
    return np.ascontiguousarray(end[one[chosen]]), np.ascontiguousarray(end[other[chosen]])


def seen_by_cones(
    grid: Grid, window: Window, origin: Floats, angle: Floats, cone: Floats, ranges: Floats, max_range: float
) -> Bools:
    """Return which cells (ny, nx) of a grid sonar cones covered up to their readings, or without return their reach.

    `origin` (n, 2), `angle` (n,), `cone` (n,), `ranges` (n,).
    """
    seen: Bools = np.zeros((grid.ny, grid.nx), np.bool_)
    room = min(2 * math.ceil(max_range / grid.cell) + 3, max(grid.nx, grid.ny)) ** 2
    pose = make_poses(SonarModel(max_range=max_range), origin, angle, cone, ranges, window)
    reach = np.minimum(ranges, pose[:, MAX_DISTANCE])
    mark_cones(grid, pose, reach, np.empty(room, np.int32), np.empty(room), seen.reshape(-1))
    return seen


SOLID = 0.25  # pieces of surface for each beam that passes a cell, from which on it is wall to a beam without return
WORTH_IT = 0.75  # a log is used whole, and exactly, where thinning would keep more than this share of it
PLACE = 0.5  # side of a square in metres: wide beside the blur of a wall, so that all across it is thinned alike
DIRECTIONS = 8  # sectors of the direction of a beam
EVENNESS = 0.75  # exponent of the number of beams; measured in docs/large-jobs.md
RARE = 2.0  # beams with a return that each square keeps at least, if it has as many, and beams without one likewise
HALVINGS = 60  # of the interval that holds the factor common to all quotas
CELL = 0.25  # side of a cell in metres
SQUARE = 4
"""Cells along a side of the squares that seen ground is measured by: 1 m, so that few beams see it as well as many."""
MAX_CELLS = 4_000_000  # cells are larger in a window that would need more
PASSING = 2  # beams that stay in each cell at least, if as many pass it or end in it
GAINS = (16, 4, 1)
"""Cells lacking a beam that a beam must pass to be taken: first those that pass many, so that few are taken."""


def thin_beams(
    window: Window,
    origin: Floats,
    angle: Floats,
    ranges: Floats,
    max_range: float,
    density: float,
    share: Floats | None = None,
) -> tuple[NDArray[np.int64], Floats]:
    """Return the beams to keep, by index and in their order, and the share of such beams that is kept of each.

    Of a dense log about `density` beams a square metre of the ground that its beams pass stay, plus what it takes to
    have every passed cell passed. One with little more than that is kept whole. No random
    number is used: the same beams in the same order give the same choice.

    `origin` (n, 2): sensor positions inside the window, metres. `angle` (n,): directions in the world frame, radians.
    `ranges` (n,): metres; at or above `max_range`: no return. `max_range`: metres. `density`: beams a square metre; 0
    keeps all. `share` (n,): which they are already of more beams, so that parts of a log that were thinned apart are
    thinned as all of it. Returns (m,), (m,).
    """
    everything = np.arange(len(ranges), dtype=np.int64)
    share = np.ones(len(ranges)) if share is None else share
    if density == 0.0 or len(ranges) <= 1:
        return everything, share
    end, returned = beam_ends(window, origin, angle, ranges, max_range)
    passages = Passages(window, origin, end)
    budget = density * passages.seen_area()
    if budget > WORTH_IT * len(ranges):
        return everything, share
    strata = strata_of(window, origin, end, returned, 1.0 / share)
    wanted = weights(strata, budget)
    kept = draw_evenly(strata, wanted)
    passages.complete(kept)
    left = np.empty(len(ranges))
    left[strata.order] = np.repeat(wanted, strata.n)
    return everything[kept], np.minimum(share, left)[kept]


class Strata(NamedTuple):
    """Beams sorted by stratum, in their own order within each; neighbouring squares follow one another."""

    order: Ints  # (n,) the beams, stratum by stratum
    n: Ints  # (k,) of each stratum, at least 1
    size: Floats  # (k,) those that they are left of
    alike: Floats  # (k,) the same of all that end in the same square with the same outcome, whatever their direction
    stands_for: Floats  # (n,) how many each is left of, in their order by stratum


def strata_of(window: Window, origin: Floats, end: Floats, returned: Bools, stands_for: Floats | None = None) -> Strata:
    """Return the strata of beams.

    `origin`, `end` (n, 2): metres, inside the window. `returned` (n,). `stands_for` (n,): beams that each is left of;
    None: 1.
    """
    column, row = (np.maximum(end - np.array(window[:2]), 0.0) // PLACE).astype(np.int64).T
    across = int(window.width // PLACE) + 2
    # Every other row runs backward, so that rounding at the end of one is compensated at its neighbour's.
    square = row * across + np.where(row % 2 == 0, column, across - 1 - column)
    toward = np.arctan2(end[:, 1] - origin[:, 1], end[:, 0] - origin[:, 0])
    sector = ((toward + np.pi) * (DIRECTIONS / (2.0 * np.pi))).astype(np.int64) % DIRECTIONS
    group = 2 * square + returned
    key = DIRECTIONS * group + sector
    order = np.argsort(key, kind="stable")
    _, first, n = np.unique(key[order], return_index=True, return_counts=True)
    each = np.ones(len(order)) if stands_for is None else stands_for[order]
    size = np.add.reduceat(each, first) if len(first) else np.zeros(0)
    _, member = np.unique(group[order[first]], return_inverse=True)
    return Strata(order, n, size, np.bincount(member, size).astype(np.float64)[member], each)


def weights(strata: Strata, budget: float) -> Floats:
    """Return the share (k,) of each stratum to keep: `budget` beams in all, more only if the rare need it."""
    least = np.minimum(1.0, RARE / strata.alike)
    falling = strata.size ** (EVENNESS - 1.0)

    def shares(factor: float) -> Floats:
        found: Floats = np.minimum(1.0, np.maximum(least, factor * falling))
        return found

    low, high = 0.0, 1.0 / falling.min()
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if strata.size @ shares(middle) > budget else (middle, high)
    return shares(high)


def draw_evenly(strata: Strata, share: Floats) -> Bools:
    """Return which beams (n,) to keep: every 1/w-th of a stratum whose share is w, rounding carried on to the next."""
    each = np.repeat(share, strata.n) * strata.stands_for
    # Those kept for certain are not counted, which rounding could make miss one of them.
    filled = 0.5 + np.cumsum(np.where(each < 1.0, each, 0.0))
    taken = (np.diff(np.floor(filled), prepend=0.0) > 0.0) | (each >= 1.0)
    kept = np.zeros(len(each), np.bool_)
    kept[strata.order[taken]] = True
    return kept


class Passages:
    """Beams as segments, and how many of them pass each cell.

    `start`, `end` (n, 2): of the beams, metres, inside the window.
    """

    def __init__(self, window: Window, start: Floats, end: Floats) -> None:
        self._grid = make_grid(*window, max(CELL, math.sqrt(window.area / MAX_CELLS)))
        self._path = np.empty(most_cells(self._grid), np.int32)
        self._start, self._end = np.ascontiguousarray(start), np.ascontiguousarray(end)
        self._passes = self._count(np.ones(len(start), np.bool_))

    def seen_area(self) -> float:
        """Return the ground that beams pass, square metres."""
        nx, ny = self._grid.nx, self._grid.ny
        seen = np.pad((self._passes > 0).reshape(ny, nx), ((0, -ny % SQUARE), (0, -nx % SQUARE)))
        squares = seen.reshape(seen.shape[0] // SQUARE, SQUARE, seen.shape[1] // SQUARE, SQUARE)
        return float(np.count_nonzero(squares.any(axis=(1, 3)))) * (SQUARE * self._grid.cell) ** 2

    def complete(self, kept: Bools) -> None:
        """Add to `kept` (n,) beams by which every cell is passed :data:`PASSING` times, or as often as by all."""
        wanted = np.minimum(self._passes, PASSING) - self._count(kept)
        for least in GAINS:
            choose_lacking(self._grid, self._start, self._end, least, self._path, wanted, kept)

    def _count(self, chosen: Bools) -> Ints:
        passes = np.zeros(self._grid.nx * self._grid.ny, np.int64)
        count_passes(self._grid, self._start[chosen], self._end[chosen], self._path, passes)
        return passes


def thin(
    readings: Readings,
    every_scan: int = 1,
    every_beam: int = 1,
    scans: str | None = None,
    skip_scans: str | None = None,
) -> Readings:
    """Return the readings that pass every one of the given conditions.

    Scans and beams are selected by their numbers in the log, or in each of several that were joined, so selections such
    as ``skip_scans="9::10"`` and ``scans="9::10"`` share no beam however they are combined with the other conditions.

    `readings`: the whole log. `every_scan`: K keeps scans 0, K, 2 K ... `every_beam`: K keeps beams 0, K, 2 K ... of
    each scan. `scans`: ``START:STOP:STEP`` keeps scans START, START + STEP ... below STOP. As in Python, each part may
    be empty, and a negative START or STOP counts from the end of the log. `skip_scans`: the same for scans to leave
    out.
    """
    if not readings.n_beams:
        raise InputError(f"{readings.source}: it has no readings to choose from.")
    for flag, step in (("--every-scan", every_scan), ("--every-beam", every_beam)):
        if step < 1:
            raise ConfigError(f"{flag} {step}: must be at least 1.")
    lengths = np.array(readings.lengths)
    of_log = readings.log if len(lengths) > 1 else np.zeros(readings.n_beams, np.int64)
    scan = readings.scan - (np.cumsum(lengths) - lengths)[of_log]
    keep = _multiple(scan, every_scan) & _multiple(readings.beam, every_beam)
    for log, n_scans in enumerate(lengths.tolist()):
        own = of_log == log
        if scans is not None:
            keep &= ~own | _in_slice(scan, scans, n_scans, "--scans")
        if skip_scans is not None:
            keep &= ~own | ~_in_slice(scan, skip_scans, n_scans, "--skip-scans")
    if not keep.any():
        raise InputError(
            f"{readings.source}: no reading is left of {readings.n_beams} in scans 0 to {lengths.max() - 1}. "
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
