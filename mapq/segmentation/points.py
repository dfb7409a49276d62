"""The points of a cloud in an order that is not that of the file: along the Morton curve, each once."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.kernels.cells import LEVELS, find_bounds, first_levels, number_cells, sort_codes
from mapq.kernels.neighbours import find_neighbours
from mapq.kernels.normals import estimate_normals, trimmed_residuals

FAR = 100.0
"""Times the extent of the middle 98 % of the points: farther out is left out where cells are too coarse otherwise."""
COUNTED_LEVEL = 8
"""Its cells are counted by a table of 16 MB; finer ones are foreseen from it, as on a surface: a quarter a level."""
BEST_FILL = 8.0
"""Points a cell at which the search for neighbours is fastest; it costs a quarter more at worst."""
PART = 1 << 18
"""Points that a thread looks at in one go."""
CROWDED = 0.2
"""Share of points that share a finest cell with another place, from which on cells are too coarse."""


class Points(NamedTuple):
    """Distinct points, sorted."""

    xyz: NDArray[np.float64]  # (u, 3) along the Morton curve, ties by x, then y, then z
    code: NDArray[np.uint64]  # (u,) number on the curve
    frame: NDArray[np.float64]  # (4,) corner and side of the root cell
    first_level: NDArray[np.int8]  # (u,) see :func:`mapq.kernels.cells.first_levels`
    number: NDArray[np.int32]  # (n,) for each point of the cloud its place in `xyz`, -1 if it was left out
    n_not_finite: int  # left out for a missing coordinate; for lying absurdly far from all others
    n_far: int

    def multiplicity(self) -> NDArray[np.int64]:
        """Return how many points (u,) of the cloud share each place."""
        return np.bincount(self.number[self.number >= 0], minlength=len(self.xyz))


def sort_points(cloud: PointCloud) -> Points:
    """Return the distinct finite points of a cloud in canonical order.

    The finest cells are the extent / 2^21 wide. Where single absurd points make that so much that cells hold many
    places, they are left out.
    """
    finite = cloud.finite()
    points = _sorted(cloud, np.flatnonzero(finite), finite)
    crowded = np.count_nonzero(points.first_level > LEVELS) > CROWDED * len(points.xyz)
    near = finite & ~_far(cloud.xyz, finite) if crowded else finite
    return points if near.sum() == finite.sum() else _sorted(cloud, np.flatnonzero(near), finite)


def _sorted(cloud: PointCloud, kept: NDArray[np.int64], finite: NDArray[np.bool_]) -> Points:
    """Return the points of an index, sorted."""
    xyz = cloud.xyz if len(kept) == len(cloud) else cloud.xyz[kept]
    low, high = find_bounds(xyz) if len(xyz) else np.zeros((2, 3))
    side = float((high - low).max())
    frame = np.append(low, _root_side(xyz, low, side) if side > 0.0 else 1.0)
    points = sort_in_frame(xyz, frame)
    number = points.number
    if len(kept) < len(cloud):
        number = np.full(len(cloud), -1, np.int32)
        number[kept] = points.number
    n_finite = int(np.count_nonzero(finite))
    return points._replace(number=number, n_not_finite=len(cloud) - n_finite, n_far=n_finite - len(kept))


def sort_in_frame(xyz: NDArray[np.float64], frame: NDArray[np.float64]) -> Points:
    """Return the distinct ones of finite points (n, 3) in the canonical order of an octree with a given frame (4,)."""
    code = number_cells(xyz, frame[:3].copy(), float(frame[3]))
    code, order = _order(xyz, code)
    ordered = xyz.take(order, axis=0)
    new = np.ones(len(code), bool)
    new[1:] = code[1:] != code[:-1]
    tied = np.flatnonzero(~new)
    new[tied] = (ordered[tied] != ordered[tied - 1]).any(axis=1)
    number = np.empty(len(code), np.int32)
    number[order] = np.cumsum(new, dtype=np.int32) - 1
    if not new.all():
        ordered, code = ordered[new], code[new]
    return Points(ordered, code, frame, first_levels(code), number, 0, 0)


def _root_side(xyz: NDArray[np.float64], low: NDArray[np.float64], extent: float) -> float:
    """Return the side of the root, from the extent to twice that, at which cells of some level hold `BEST_FILL`."""
    shift = np.uint64(3 * (LEVELS - COUNTED_LEVEL))
    filled = np.zeros(8**COUNTED_LEVEL, bool)
    filled[number_cells(xyz, low, extent) >> shift] = True
    fill = len(xyz) / np.count_nonzero(filled)
    halvings = 0.5 * np.log2(fill / BEST_FILL)
    return float(extent * 2.0 ** (np.ceil(halvings) - halvings))


def _far(xyz: NDArray[np.float64], finite: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points (n,) lie far out from the middle ones."""
    low, high = np.quantile(xyz[finite], (0.01, 0.99), axis=0)
    reach = FAR * float((high - low).max())
    if reach == 0.0:
        return np.zeros(len(xyz), bool)
    with np.errstate(invalid="ignore"):
        return np.asarray(((xyz < low - reach) | (xyz > high + reach)).any(axis=1))


def _order(xyz: NDArray[np.float64], code: NDArray[np.uint64]) -> tuple[NDArray[np.uint64], NDArray[np.int32]]:
    """Return codes (n,) in ascending order, and the order by code, then by coordinates."""
    ahead, order = sort_codes(code)
    equal = np.zeros(len(code) + 1, bool)
    equal[1:-1] = ahead[1:] == ahead[:-1]
    tied = np.flatnonzero(equal[1:] | equal[:-1])
    among = order[tied]
    order[tied] = among[np.lexsort((*xyz[among].T[::-1], code[among]))]
    return ahead, order


SAMPLE = 3000
"""Size of the sample, taken evenly along the curve, that chooses a level: its standard error is about 2 %."""
LARGE_SAMPLE = 8_000
"""Points that spacing and noise are estimated from then, to about 1 %. Eight times as many would cost a third more time
on a million points."""
WIDEST = 48
"""Neighbours of the sample: enough to distinguish a plane with others beside it from a ball."""
TURNS = 28
"""Candidate planes of a robust fit."""
THIN = 0.03
"""A neighbourhood shows a plane if the nearest half of it has at most this thickness; half a ball has 0.05 or more."""
WIDTH_IN_NOISE, WIDTH_IN_LENGTH = 2.0, 0.22
"""And if its short side is wider than the noise and not too short for its length, else it may be one scan line. Both
are standard deviations; a half disc, at the edge of a wall, has a width of 0.5 of its length."""

CUT, KEPT_STD = 2.0, 0.8796
"""Distances up to `CUT` standard deviations, and the standard deviation of a normal law cut there (as a share)."""
START = 1.5
"""Times the scale of the nearest half, which is 0.4 standard deviations of one surface and 1 of two."""
MOST_ROUNDS = 200


class Sample(NamedTuple):
    """Neighbourhoods of some points."""

    spacing: NDArray[np.float64]  # (s,) metres between points, as if they lay on a square grid
    normal: NDArray[np.float32]  # (s, 3) of the plane through the point and its neighbours, whether it is one or not
    flat: NDArray[np.bool_]  # (s,) whether the neighbourhood shows a plane
    narrow: NDArray[np.bool_]  # (s,) whether it is too narrow to show one
    scale: NDArray[np.float64]  # (s,) root mean square in metres of the half that a plane fits best
    residual: NDArray[np.float64]  # (s, k) distances to that plane, nan where there are fewer


def look_at(
    xyz: NDArray[np.float64], code: NDArray[np.uint64], frame: NDArray[np.float64], n_neighbours: int, n_sample: int
) -> Sample:
    """Return the neighbourhoods of about `n_sample` of the sorted points."""
    place = np.unique(np.linspace(0, len(xyz) - 1, n_sample).astype(np.int64))
    wanted = np.zeros(len(xyz), bool)
    wanted[place] = True
    n_wide = min(max(WIDEST, n_neighbours), len(xyz) - 1)
    n_own = min(n_neighbours, n_wide)
    neighbours = neighbours_of(xyz, code, frame, wanted, n_wide)
    normal, spread = np.empty((len(place), 3), np.float32), np.empty((len(place), 3), np.float32)
    estimate_normals(xyz, place, neighbours[:, :n_own].copy(), normal, spread)
    scale, thickness = np.empty(len(place)), np.empty(len(place))
    residual = np.empty((len(place), n_wide + 1))
    trimmed_residuals(xyz, place, neighbours, TURNS, scale, thickness, residual)
    width, length = np.sqrt(spread[:, 1]), np.sqrt(spread[:, 2])
    narrow = ~((width > WIDTH_IN_NOISE * pooled_noise(scale, residual)) & (width > WIDTH_IN_LENGTH * length))
    reach = np.linalg.norm(xyz[neighbours[:, n_own - 1]] - xyz[place], axis=1)
    return Sample(reach * np.sqrt(np.pi / n_own), normal, ~narrow & (thickness <= THIN), narrow, scale, residual)


def neighbours_of(
    xyz: NDArray[np.float64],
    code: NDArray[np.uint64],
    frame: NDArray[np.float64],
    wanted: NDArray[np.bool_],
    n_neighbours: int,
    max_gap: float = np.inf,
) -> NDArray[np.int32]:
    """Return the nearest neighbours (w, k) of the points wanted, none beyond `max_gap`; -1 fills up."""
    before = np.zeros(len(xyz) + 1, np.int32)
    np.cumsum(wanted, out=before[1:])
    neighbours = np.empty((int(before[-1]), n_neighbours), np.int32)

    def search(begin: int, end: int) -> None:
        rows = np.clip(before, begin, end)
        rows -= begin
        find_neighbours(xyz, code, frame, rows, max_gap, neighbours[begin:end])

    in_parts(len(neighbours), search)
    return neighbours


def in_parts(n: int, task: Callable[[int, int], None]) -> None:
    """Call a task with the beginning and the end of each part of n rows, in as many threads as there are cores.

    What becomes of a row must depend on no other part.
    """
    begins = range(0, n, PART)
    if len(begins) == 1:
        task(0, n)
        return
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        for _ in pool.map(task, begins, (min(begin + PART, n) for begin in begins)):
            pass


def pooled_noise(scale: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Return the noise of the smoother surfaces from all neighbourhoods together, 0 if there is none.

    `scale` (s,): root mean square of the half of each neighbourhood that its plane fits best, nan where there is no
    plane. `residual` (s, k): distances of all its points, nan where there are fewer.
    """
    known = np.isfinite(scale)
    if not known.any():
        return 0.0
    low, usual = np.quantile(scale[known], (0.1, 0.25))
    pooled = residual[known][scale[known] <= 3.0 * usual].reshape(1, -1)
    return float(_raise(np.array([low]), pooled)[0])


def usual_noise(scale: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Return the noise that at least half of the surfaces keep to, 0 if there is none.

    That of all neighbourhoods together or, where surfaces differ, the median of each by itself, whichever is more: the
    first is drawn to the smooth ones, the second lies low by a third where all are alike. Parameters as of
    :func:`pooled_noise`.
    """
    known = np.isfinite(scale)
    if not known.any():
        return 0.0
    single = _raise(START * scale[known], residual[known])
    return max(pooled_noise(scale, residual), float(np.median(single)))


def _raise(noise: NDArray[np.float64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviations (s,), raised from those given, that agree with the distances (s, k) below them."""
    ordered = np.sort(np.where(np.isfinite(residual), residual, np.inf), axis=1)
    squares = np.cumsum(np.where(np.isfinite(ordered), ordered, 0.0) ** 2, axis=1)
    rows = np.arange(len(noise))
    for _ in range(MOST_ROUNDS):
        n_within = np.maximum(np.count_nonzero(ordered <= CUT * noise[:, None], axis=1), 1)
        raised = np.sqrt(squares[rows, n_within - 1] / n_within) / KEPT_STD
        if (raised <= noise * 1.0005).all():
            break
        noise = np.maximum(noise, raised)
    return noise
