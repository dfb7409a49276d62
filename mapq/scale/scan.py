"""The first pass over the points: where they are, and a sample of whole small blocks for the estimates.

A sample of points drawn one by one would be sparser than the map. Columns of the ground plan are drawn instead, by a
hash of their place, and keep all their points: which ones they are hangs neither on files nor on tiles. The axes of the
map's own (:mod:`mapq.axes`) are known after this pass alone; so columns and cells lie symmetrically about the origin,
and those of a turned map are those of the map, turned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, turn
from mapq.cloud import PointCloud
from mapq.features.provenance import Span, span_of
from mapq.io.options import ReadOptions
from mapq.scale.files import save_arrays
from mapq.scale.source import Range, Source, read_range
from mapq.scale.tiling import cells_of
from mapq.segmentation import FEWEST_POINTS
from mapq.segmentation.parameters import Parameters, choose_parameters
from mapq.segmentation.points import FAR, sort_points
from mapq.segmentation.settings import SegmentSettings
from prf.shell.errors import InputError

SAMPLE = 3_000_000
"""Points of the sample, about; smaller maps are taken whole."""
N_COLUMNS = 64
"""Columns of the sample, about."""
COLUMN_RANGE = (4.0, 32.0)
"""Metres: smallest and largest side of a column."""
N_CELLS = 1000
"""Cells along the longer side of the map, whose points are counted."""
SMALLEST_CELL = 0.25
"""Metres."""
MOST_SPACINGS = 2.0**20
"""Spacings of points along a side of the map up to which the cells of its octree are fine enough: two a spacing."""

Floats = NDArray[np.float64]


class ScanTask(NamedTuple):
    """What a scan of a range is given.

    Attributes
    ----------
    source, options, part
        What is read.
    shift : (3,) float64
    cell : float
        Side in metres of the cells in which points are counted.
    side, share : float
        Side of the columns in metres, and the share of them that are kept.
    sample : str
        File of the sample of this range.
    fields : tuple of str
        That may say where and when points were seen.
    """

    source: Source
    options: ReadOptions
    part: Range
    shift: Floats
    cell: float
    side: float
    share: float
    sample: str
    fields: tuple[str, ...]


class Scan(NamedTuple):
    """What a scan found: cells (k, 2) with their counts (k,), the ground plan, and what fields hold."""

    cells: NDArray[np.int64]
    counts: NDArray[np.int64]
    plan: GroundPlan
    spans: dict[str, Span]


class Estimate(NamedTuple):
    """Parameters of the segmentation, the frame (4,) of its octree: corner and side in metres; box (2, 3) of the map.

    All are in the map's own axes. Points beyond the box are left out, as absurdly far from all others.
    """

    chosen: Parameters
    frame: Floats
    near: Floats


def scan_range(task: ScanTask) -> Scan:
    """Count the points of a range in cells, and keep those of the columns that are drawn."""
    keys, counts, sample = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, 3))]
    plan = GroundPlan()
    spans: dict[str, Span | None] = dict.fromkeys(task.fields, Span())
    for piece in read_range(task.source, task.options, task.part, task.shift, task.fields):
        number = np.flatnonzero(piece.finite())
        xyz = piece.xyz[number]
        if len(xyz) == 0:
            continue
        spans = {name: _join(span, span_of(piece, name, number)) for name, span in spans.items()}
        plan = plan.joined(GroundPlan.of(xyz))
        found = _count(cells_of(xyz, task.cell))
        keys.append(found[0])
        counts.append(found[1])
        sample.append(xyz[is_drawn(cells_of(xyz, task.side), task.share)])
    save_arrays(task.sample, xyz=np.concatenate(sample))
    known = {name: span for name, span in spans.items() if span is not None}
    return Scan(*join_counts(keys, counts), plan, known)


def join_spans(scans: list[Scan]) -> dict[str, Span]:
    """Return what the fields hold over the whole map; those that are no numbers somewhere are left out."""
    joined = dict(scans[0].spans)
    for scan in scans[1:]:
        joined = {name: span.joined(scan.spans[name]) for name, span in joined.items() if name in scan.spans}
    return joined


def _join(one: Span | None, other: Span | None) -> Span | None:
    return None if one is None or other is None else one.joined(other)


def _count(cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct rows of cells (n, 2), and how often each is there."""
    low = cells.min(axis=0)
    size = cells.max(axis=0) - low + 1
    place, n = np.unique((cells[:, 0] - low[0]) * size[1] + cells[:, 1] - low[1], return_counts=True)
    return np.column_stack([place // size[1] + low[0], place % size[1] + low[1]]), n.astype(np.int64)


def join_counts(
    cells: list[NDArray[np.int64]], counts: list[NDArray[np.int64]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct cells of several counts with the sums of these."""
    rows, place = np.unique(np.concatenate(cells), axis=0, return_inverse=True)
    return rows, np.bincount(place.ravel(), np.concatenate(counts), len(rows)).astype(np.int64)


def is_drawn(columns: NDArray[np.int64], share: float) -> NDArray[np.bool_]:
    """Return which columns (n, 2) are drawn: by the finaliser of SplitMix64 (Steele 2014) of their place.

    Of the four places that quarter turns about the origin take to one another, all are drawn or none.
    """
    if share >= 1.0:
        return np.ones(len(columns), bool)
    i, j = np.abs(columns).T
    product = columns[:, 0] * columns[:, 1]
    other_way = (product < 0) | ((product == 0) & (i < j))
    i, j = np.where(other_way, j, i), np.where(other_way, i, j)
    with np.errstate(over="ignore"):
        bits = i.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) + j.astype(np.uint64)
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        bits ^= bits >> np.uint64(31)
    return np.asarray(bits < np.uint64(share * 2.0**64))


def plan_scan(sources: list[Source]) -> tuple[float, float, float]:
    """Return cell, side and share of :class:`ScanTask` for a map, from what the heads of its files promise."""
    low = np.min([each.low * each.unit for each in sources], axis=0)
    extent = np.max([each.high * each.unit for each in sources], axis=0) - low
    n_points = sum(each.n_points for each in sources)
    share = min(1.0, SAMPLE / max(n_points, 1))
    side = float(np.clip(np.sqrt(extent[0] * extent[1] * share / N_COLUMNS), *COLUMN_RANGE))
    return max(float(extent[:2].max()) / N_CELLS, SMALLEST_CELL), side, share


class EstimateTask(NamedTuple):
    """What the estimate is given: the samples, the settings, the ground plan of the map, and its name."""

    samples: tuple[str, ...]
    settings: SegmentSettings
    plan: GroundPlan
    name: str


def estimate(task: EstimateTask) -> Estimate:
    """Return the parameters for the whole map.

    Raises
    ------
    InputError
        If there are too few points.
    """
    parts = []
    for path in task.samples:
        with np.load(path) as arrays:
            parts.append(arrays["xyz"])
    quarter = task.plan.quarter()
    xyz = turn(np.concatenate(parts), quarter)
    points = sort_points(PointCloud(xyz, np.zeros(3), source=task.name))
    if len(points.xyz) < FEWEST_POINTS:
        raise InputError(
            f"{task.name}: {len(points.xyz)} distinct points in the sample of the map; a plane needs {FEWEST_POINTS}."
        )
    chosen = choose_parameters(points, task.settings.turned(quarter))
    frame = points.frame.copy()
    doublings = 0
    low, high = _near(xyz, task.plan.box(quarter), chosen.spacing)
    if (frame[:3] > low).any() or (frame[:3] + frame[3] <= high).any():
        frame[:3] = low
        while (frame[:3] + frame[3] <= high).any():
            frame[3] *= 2.0
            doublings += 1
    return Estimate(chosen._replace(level=chosen.level + doublings), frame, np.array([low, high]))


def _near(xyz: Floats, box: Floats, spacing: float) -> Floats:
    """Return the box of a map, without what lies far from a sample (n, 3) of it where the octree would be too coarse.

    The same rule as :func:`mapq.segmentation.points.sort_points` has for clouds in memory.
    """
    if float((box[1] - box[0]).max()) < MOST_SPACINGS * spacing:
        return box
    low, high = np.quantile(xyz, (0.01, 0.99), axis=0)
    reach = FAR * float((high - low).max())
    return np.clip(box, low - reach, high + reach)
