"""Large maps from files to a result, tile by tile."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from operator import call
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, keys_of, turn, turn_cloud
from mapq.cloud import PointCloud
from mapq.configuration import Configuration, SegmentSettings
from mapq.crf import classify, explain
from mapq.features.compute import feature_settings
from mapq.features.disagreement import FIELDS, Known, Span, decide, span_of
from mapq.io.models import read_default_model
from mapq.io.results import result_cloud
from mapq.io.tiles import MapFiles, is_tiled, open_map
from mapq.labels import SUSPICIOUS
from mapq.model import Model
from mapq.patches import Patches, PatchesOnDisk
from mapq.results import visits
from mapq.results.result import Origin, Result, Seen
from mapq.results.verdict import tolerance_of
from mapq.segmentation import FEWEST_POINTS, warnings_of
from mapq.segmentation.parameters import Parameters, choose_parameters, refuse_other_unit
from mapq.segmentation.points import FAR, sort_points
from mapq.tiled.cut import Whole, cut_tile, unite
from mapq.tiled.measure import Measuring
from mapq.tiled.output import open_workers, plan_output, write_map
from mapq.tiled.tiling import HALO_IN_GAPS, HALO_IN_SPACING, Counts, Tiling, WorkFolder, cells_of, make_tiling
from prf.shell.cli.console import Report, progress, report_nothing
from prf.shell.cli.files import work_folder
from prf.shell.errors import InputError
from prf.shell.scheduler import Workers

SAMPLE = 3_000_000
"""Points of which parameters are estimated, about; smaller maps are used whole."""
SAMPLE_CELL = 16.0
"""Metres: side of the columns of the ground plan that are drawn for the sample, with all their points."""
MOST_SPACINGS = 2.0**20
"""Spacings of points along a side of the map up to which the cells of its octree are fine enough: two a spacing."""
STAGES = ("counting", "sorting", "segmenting", "measuring", "finding causes", "writing")

Floats = NDArray[np.float64]


def classify_map(
    path: str,
    target: str,
    model: Model | None,
    settings: Configuration,
    force: bool,
    origin: Origin | None = None,
    limits: Mapping[str, Any] | None = None,
    sources: Mapping[str, str] | None = None,
) -> Result:
    """Classify a map tile by tile, and write the result.

    `path`: A file, or a folder of LAS or LAZ tiles. `target`: A cloud, beside which the JSON is written; or for a
    folder a folder, with tiles named as in the input. `settings`: those
    of tiles, segment and cloud. `model`: None: the model that ships with the package. `force`:
    whether an existing result may be replaced. `origin`: inputs that the JSON names. `limits`: of the verdict, as
    :meth:`mapq.Result.verdict` takes them. `sources`: where each setting of the segmentation was given. Raises
    InputError, UsageError, ConfigError, OutputError as reading, segmenting, the workers and writing do.
    """
    tiles = settings.tiles
    files = open_map(path, settings.cloud)
    output = plan_output(target, files, is_tiled(path), force)
    with (
        work_folder(target) as folder,
        open_workers(tiles.workers, tiles.scheduler) as workers,
        progress(len(STAGES), "classifying") as report,
    ):
        cut = cut_map(files, settings, workers, folder, report)
        result = assess_map(cut, settings, model or read_default_model(), workers, origin or Origin(path), report)
        result = replace(result, patches=_with_sources(result.patches, sources or {}))
        head = {**result.head(**(limits or {})), "tiles": len(cut.tiling.boxes)}
        write_map(folder, output, files, result_pieces(cut, result, report), (head, result.patch_rows()))
    return result


class _Counted(NamedTuple):
    """What the first pass over the points finds: counts by cells, the ground plan, and what fields hold."""

    counts: Counts
    columns: Counts
    plan: GroundPlan
    spans: dict[str, Span | None]


class TiledPatches(NamedTuple):
    """A map that was cut into patches tile by tile, with all that measuring and writing need of it."""

    files: MapFiles
    store: WorkFolder
    tiling: Tiling
    quarter: int  # by which the map's own axes are turned
    known: Known
    clock: visits.Clock | None
    stays: list[visits.Stays]  # of the pieces of the map; none without a clock
    whole: Whole  # in the map's own axes
    patches: PatchesOnDisk  # in the axes of the files
    patch: NDArray[np.int32]  # (n,) patch of each point, on the disk


def cut_map(
    files: MapFiles, settings: Configuration, workers: Workers, folder: str, report: Report = report_nothing
) -> TiledPatches:
    """Cut a map into patches; its points are kept in the work folder."""
    counted = _count(files, report)
    spans = {name: span for name, span in counted.spans.items() if span is not None}
    known, clock = decide(spans), visits.clock_of(spans)
    used = dict.fromkeys((*known.fields, *(clock.fields if clock is not None else ())))
    quarter, store = counted.plan.quarter(), WorkFolder(folder, tuple(used))
    tiling = make_tiling(counted.counts.turned(quarter), settings.tiles.tile_points)
    sample, stays = _sort(files, store, tiling, quarter, clock, counted.columns.turned(quarter), report)
    chosen, frame, near = _estimate(files.path, sample, settings.segment, counted.plan, quarter)
    halo = max(HALO_IN_GAPS * chosen.max_gap, HALO_IN_SPACING * chosen.spacing)
    tasks = [partial(cut_tile, tile, store, tiling, halo, chosen, frame, near) for tile in range(len(tiling.boxes))]
    cuts = list(_reported(report, "segmenting", workers(call, tasks), len(tasks)))
    whole = unite(cuts, store, tiling, halo, chosen)
    n_near, n_distinct, n_looked_at = (
        sum(getattr(cut, name) for cut in cuts) for name in ("n_points", "n_distinct", "n_looked_at")
    )
    n_far = counted.plan.n_points - n_near
    found = {
        "points": files.n_points,
        "points_not_finite": files.n_points - counted.plan.n_points,
        "points_far_outside": n_far,
        "points_repeated": n_near - n_distinct,
        "points_looked_at": n_looked_at,
        **whole.joined.report,
    }
    found["warnings"] = warnings_of(chosen, found)
    patches = _in_axes_of_files(files, whole, quarter, chosen.described(quarter), found)
    patch = _numbered(files.n_points, store, whole)
    return TiledPatches(files, store, tiling, quarter, known, clock, stays, whole, patches, patch)


def _reported(report: Report, stage: str, items: Iterable[Any], n_items: int) -> Iterator[Any]:
    """Yield items of a stage, and report each."""
    for place, item in enumerate(items):
        report(STAGES.index(stage) + (place + 1) / n_items, stage=stage)
        yield item


def _pieces(files: MapFiles, report: Report, stage: str, names: tuple[str, ...] | None = None) -> Iterator[Any]:
    """Yield the points of a map in pieces, with the number of their file, and report each."""
    n_pieces = -(-files.n_points // 1_000_000) + len(files.heads)
    return _reported(report, stage, files.pieces(names), n_pieces)


def _count(files: MapFiles, report: Report) -> _Counted:
    names = tuple(name for name in dict.fromkeys((*FIELDS, *visits.FIELDS)) if name in files.fields)
    counts, columns, plan = Counts(), Counts(SAMPLE_CELL), GroundPlan()
    spans: dict[str, Span | None] = dict.fromkeys(names, Span())
    for _, piece in _pieces(files, report, "counting", names):
        number = np.flatnonzero(piece.finite())
        if len(number):
            xyz = piece.xyz[number]
            counts, columns, plan = counts.plus(xyz), columns.plus(xyz), plan.joined(GroundPlan.of(xyz))
            spans = {name: _joined(span, span_of(piece, name, number)) for name, span in spans.items()}
    if plan.n_points == 0:
        raise InputError(f"{files.path}: no point is finite. Check how the map was written.")
    return _Counted(counts, columns, plan, spans)


def _sort(
    files: MapFiles,
    store: WorkFolder,
    tiling: Tiling,
    quarter: int,
    clock: visits.Clock | None,
    columns: Counts,
    report: Report,
) -> tuple[Floats, list[visits.Stays]]:
    """Write the points of each tile to its file; return a sample (n, 3) of them, and where the sensor was."""
    drawn = columns.drawn(SAMPLE)
    sample, stays, begin = [], [], 0
    for _, read in _pieces(files, report, "sorting", store.fields):
        number = np.flatnonzero(read.finite())
        piece = turn_cloud(read.take(number), quarter)
        records = np.empty(len(piece), store.record)
        records["xyz"], records["number"] = piece.xyz, number + begin
        for name in store.fields:
            records[name] = piece.fields[name]
        begin += len(read)
        if not len(piece):
            continue
        if clock is not None:
            stays.append(visits.stays_of(piece, clock)[0])
        sample.append(piece.xyz[np.isin(keys_of(cells_of(piece.xyz, columns.side)), drawn)])
        tile = tiling.of_points(piece.xyz)
        order = np.argsort(tile, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(tile[order])) + 1):
            store.append(int(tile[rows[0]]), records[rows])
    return np.concatenate(sample), stays


def _estimate(
    name: str, sample: Floats, settings: SegmentSettings, plan: GroundPlan, quarter: int
) -> tuple[Parameters, Floats, Floats]:
    """Return parameters of the map, frame (4,) of its octree, and box (2, 3) beyond which points are left out."""
    points = sort_points(PointCloud(sample, np.zeros(3), source=name))
    if len(points.xyz) < FEWEST_POINTS:
        raise InputError(f"{name}: {len(points.xyz)} distinct points; a plane needs {FEWEST_POINTS}.")
    chosen = choose_parameters(points, settings, quarter)
    refuse_other_unit(chosen.spacing, name)
    low, high = box = plan.box(quarter)
    if float((high - low).max()) >= MOST_SPACINGS * chosen.spacing:
        middle = np.quantile(sample, (0.01, 0.99), axis=0)
        reach = FAR * float(np.ptp(middle, axis=0).max())
        low, high = np.clip(box, middle[0] - reach, middle[1] + reach)
    frame, doublings = points.frame.copy(), 0
    if (frame[:3] > low).any() or (frame[:3] + frame[3] <= high).any():
        frame[:3] = low
        while (frame[:3] + frame[3] <= high).any():
            frame[3] *= 2.0
            doublings += 1
    return chosen._replace(level=chosen.level + doublings), frame, np.array([low, high])


def _numbered(n_points: int, store: WorkFolder, whole: Whole) -> NDArray[np.int32]:
    """Write the patch (n,) of each point of the map, in the order of the files."""
    found = np.memmap(os.path.join(store.folder, "patch"), np.int32, "w+", shape=(n_points,))
    found[:] = -1
    for patch in range(len(whole)):
        for records in store.points(whole.slices[whole.first[patch] : whole.first[patch + 1]]):
            found[records["number"]] = patch
    return found


def _in_axes_of_files(
    files: MapFiles, whole: Whole, quarter: int, parameters: dict[str, Any], report: dict[str, Any]
) -> PatchesOnDisk:
    joined = whole.joined
    nowhere = np.broadcast_to(np.full((1, 3), np.nan), (files.n_points, 3))
    cloud = PointCloud(nowhere, files.shift, source=files.path, unit=files.heads[0].unit)
    normal, centroid, bend = (turn(each, -quarter) for each in (joined.normal, joined.centroid, joined.bend))
    plain = Patches.unlabelled(cloud, np.zeros(0, np.int32), normal, centroid, parameters, report, bend)
    low, high = np.sort([turn(whole.low, -quarter), turn(whole.high, -quarter)], axis=0)
    return PatchesOnDisk(**vars(plain), sizes=joined.n_points, low=low, high=high)


def assess_map(
    cut: TiledPatches,
    settings: Configuration,
    model: Model,
    workers: Workers,
    origin: Origin | None = None,
    report: Report = report_nothing,
) -> Result:
    """Return what a model infers about the patches of a map.

    Raises InputError if the model needs features that this release does not have.
    """
    features_by = feature_settings(model)
    given = np.asarray(features_by.up if features_by.up is not None else cut.patches.parameters["up"], np.float64)
    up = given / np.linalg.norm(given)
    x, y, z = turn(up, cut.quarter).tolist()
    features_by, most = features_by.replace(up=(x, y, z)), settings.tiles.tile_points
    measuring = Measuring(cut.whole, cut.store, cut.tiling.boxes, features_by, workers, most)
    parts = _reported(report, "measuring", measuring.features(cut.known), len(measuring.groups))
    features = measuring.join(list(parts), up.tolist())
    tolerance = tolerance_of(features, model, settings.crf.tolerance)
    labelling = classify(features, model, tolerance)
    seen = Seen(None, {})
    if cut.clock is not None and cut.stays:
        stays = visits.join_stays(cut.stays)
        visited = visits.visits_from(cut.clock, stays, np.zeros(0, np.int64), None)
        bad = labelling.label == SUSPICIOUS
        seen = Seen(visited, measuring.causes(features, bad, cut.clock, stays, visited))
    terms = explain(features, model, labelling.label, tolerance)
    return Result(cut.patches, features, model, labelling, terms, tolerance, origin or Origin(), seen)


def _with_sources(patches: Patches, sources: Mapping[str, str]) -> Patches:
    return replace(patches, report={**patches.report, "sources": dict(sources)})


def result_pieces(
    cut: TiledPatches, result: Result, report: Report = report_nothing
) -> Iterator[tuple[int, PointCloud]]:
    """Yield the points of the map in order, with the fields of a result, and the number of their file."""
    label, probability, cause = result.labelling.label, result.labelling.probability, result.cause_codes()
    begin = 0
    for number, piece in _pieces(cut.files, report, "writing"):
        patch = np.array(cut.patch[begin : begin + len(piece)])
        begin += len(piece)
        yield number, result_cloud(piece, patch, label, probability, cause)


def _joined(one: Span | None, other: Span | None) -> Span | None:
    return None if one is None or other is None else one.joined(other)
