"""Large maps from files to a result, tile by tile."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, turn, turn_cloud
from mapq.cloud import PointCloud
from mapq.configuration import Configuration
from mapq.crf import classify, explain
from mapq.features.compute import feature_settings
from mapq.features.disagreement import FIELDS, Span, decide, span_of
from mapq.io.models import read_default_model
from mapq.io.results import result_cloud
from mapq.labels import SUSPICIOUS
from mapq.model import Model
from mapq.patches import Patches, PatchesOnDisk
from mapq.results import visits
from mapq.results.result import MIN_COVERAGE, Origin, Result, Seen
from mapq.segmentation import FEWEST_POINTS
from mapq.segmentation.join import warnings_of
from mapq.segmentation.parameters import Parameters, choose_parameters
from mapq.segmentation.points import FAR, sort_points
from mapq.tiled.cut import CutTask, Whole, cut_tile, unite
from mapq.tiled.measure import Measuring
from mapq.tiled.output import Workers, open_workers, plan_output, write_map
from mapq.tiled.source import Map, WorkFolder, is_tiled, open_map
from mapq.tiled.tiling import HALO_IN_GAPS, HALO_IN_SPACING, Counts, Tiling, cells_of, keys_of, make_tiling
from prf.shell.cli.files import work_folder
from prf.shell.cli.progress import Report, progress
from prf.shell.errors import InputError

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
    limits: tuple[float | None, float] = (None, MIN_COVERAGE),
    sources: Mapping[str, str] | None = None,
) -> Result:
    """Classify a map tile by tile, and write the result.

    `path`: A file, or a folder of LAS or LAZ tiles. `target`: A cloud, beside which the JSON is written; or for a
    folder a folder, with tiles named as in the input. `settings`: those
    of tiles, segment and cloud. `model`: None: the model that ships with the package. `force`:
    whether an existing result may be replaced. `origin`: inputs that the JSON names. `limits` (float or None, float):
    of the verdict: fail_over and min_coverage. `sources`: where each setting of the segmentation was given. Raises
    InputError, UsageError, ConfigError, OutputError as reading, segmenting, the workers and writing do.
    """
    tiles = settings.tiles
    files = open_map(path, settings.cloud)
    output = plan_output(target, files, is_tiled(path), force)
    with (
        work_folder(target) as folder,
        open_workers(tiles.workers, tiles.scheduler) as workers,
        progress(len(STAGES), "classifying") as reporter,
    ):
        job = Job(files, settings, workers, folder, reporter)
        job.cut()
        result = job.assess(model or read_default_model(), origin or Origin(path), sources or {})
        head = {**result.head(*limits), "tiles": len(job.tiling.boxes)}
        write_map(folder, output, files, job.pieces(result), (head, result.patch_rows()))
    return result


class _Counted(NamedTuple):
    """What the first pass over the points finds: counts by cells, the ground plan, and what fields hold."""

    counts: Counts
    columns: Counts
    plan: GroundPlan
    spans: dict[str, Span | None]


class _Estimate(NamedTuple):
    """Parameters for the whole map, frame (4,) of its octree, box (2, 3) beyond which points are left out."""

    chosen: Parameters
    frame: Floats
    near: Floats


class Job:
    """One map, the workers and the work folder: :meth:`cut`, then :meth:`assess`, then :meth:`pieces`."""

    patches: PatchesOnDisk  # in the axes of the files
    patch: NDArray[np.int32]  # (n,) patch of each point, on the disk
    tiling: Tiling

    def __init__(
        self, files: Map, settings: Configuration, workers: Workers, folder: str, reporter: Report | None = None
    ) -> None:
        self._files, self._settings, self._workers, self._reporter = files, settings, workers, reporter
        names = tuple(name for name in dict.fromkeys((*FIELDS, *visits.FIELDS)) if name in files.fields)
        self._names, self._folder = names, folder
        self._stays: list[visits.Stays] = []

    def cut(self) -> None:
        """Cut the map into patches."""
        counted = self._count()
        self._plan, spans = counted.plan, {name: span for name, span in counted.spans.items() if span is not None}
        self._known, self._clock = decide(spans), visits.clock_of(spans)
        used = dict.fromkeys((*self._known.fields, *(self._clock.fields if self._clock is not None else ())))
        self._quarter = counted.plan.quarter()
        self._store = WorkFolder(self._folder, tuple(used))
        self.tiling = make_tiling(counted.counts.turned(self._quarter), self._settings.tiles.tile_points)
        guess = self._estimate(self._sort(counted.columns.turned(self._quarter)))
        halo = max(HALO_IN_GAPS * guess.chosen.max_gap, HALO_IN_SPACING * guess.chosen.spacing)
        tasks = [
            CutTask(tile, self._store, self.tiling, halo, guess.chosen, guess.frame, guess.near)
            for tile in range(len(self.tiling.boxes))
        ]
        cuts = list(self._each("segmenting", cut_tile, tasks))
        self._whole = whole = unite(cuts, self._store, self.tiling, halo, guess.chosen)
        n_near, n_distinct, n_looked_at = (
            sum(getattr(cut, name) for cut in cuts) for name in ("n_points", "n_distinct", "n_looked_at")
        )
        n_far = counted.plan.n_points - n_near
        report = {
            "points": self._files.n_points,
            "points_not_finite": self._files.n_points - counted.plan.n_points,
            "points_far_outside": n_far,
            "points_repeated": n_near - n_distinct,
            "points_looked_at": n_looked_at,
            **whole.joined.report,
            "warnings": warnings_of(guess.chosen, n_far, whole.joined.report),
        }
        self._number_points()
        self.patches = self._in_axes_of_files(whole, guess.chosen.described(self._quarter), report)

    def _each(self, stage: str, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
        """Yield what a function returns for each task."""
        return self._reported(stage, self._workers(function, tasks), len(tasks))

    def _reported(self, stage: str, items: Iterable[Any], n_items: int) -> Iterator[Any]:
        for place, item in enumerate(items):
            if self._reporter is not None:
                self._reporter(STAGES.index(stage) + (place + 1) / n_items, stage=stage)
            yield item

    def _count(self) -> _Counted:
        counts, columns, plan = Counts(), Counts(SAMPLE_CELL), GroundPlan()
        spans: dict[str, Span | None] = dict.fromkeys(self._names, Span())
        n_pieces = -(-self._files.n_points // 1_000_000) + len(self._files.sources)
        for _, piece in self._reported("counting", self._files.pieces(self._names), n_pieces):
            number = np.flatnonzero(piece.finite())
            if len(number):
                xyz = piece.xyz[number]
                counts, columns, plan = counts.plus(xyz), columns.plus(xyz), plan.joined(GroundPlan.of(xyz))
                spans = {name: _joined(span, span_of(piece, name, number)) for name, span in spans.items()}
        if plan.n_points == 0:
            raise InputError(f"{self._files.name}: no point is finite. Check how the map was written.")
        return _Counted(counts, columns, plan, spans)

    def _sort(self, columns: Counts) -> Floats:
        """Write the points of each tile to its file; return those of a sample of columns (n, 3)."""
        drawn = columns.drawn(SAMPLE)
        sample, begin = [], 0
        n_pieces = -(-self._files.n_points // 1_000_000) + len(self._files.sources)
        for _, read in self._reported("sorting", self._files.pieces(self._store.fields), n_pieces):
            number = np.flatnonzero(read.finite())
            piece = turn_cloud(read.take(number), self._quarter)
            records = np.empty(len(piece), self._store.record)
            records["xyz"], records["number"] = piece.xyz, number + begin
            for name in self._store.fields:
                records[name] = piece.fields[name]
            begin += len(read)
            if not len(piece):
                continue
            if self._clock is not None:
                self._stays.append(visits.stays_of(piece, self._clock)[0])
            sample.append(piece.xyz[np.isin(keys_of(cells_of(piece.xyz, columns.side)), drawn)])
            tile = self.tiling.of_points(piece.xyz)
            order = np.argsort(tile, kind="stable")
            for rows in np.split(order, np.flatnonzero(np.diff(tile[order])) + 1):
                self._store.append(int(tile[rows[0]]), records[rows])
        return np.concatenate(sample)

    def _estimate(self, sample: Floats) -> _Estimate:
        name = self._files.name
        points = sort_points(PointCloud(sample, np.zeros(3), source=name))
        if len(points.xyz) < FEWEST_POINTS:
            raise InputError(f"{name}: {len(points.xyz)} distinct points; a plane needs {FEWEST_POINTS}.")
        chosen = choose_parameters(points, self._settings.segment, self._quarter)
        low, high = box = self._plan.box(self._quarter)
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
        return _Estimate(chosen._replace(level=chosen.level + doublings), frame, np.array([low, high]))

    def _number_points(self) -> None:
        """Write the patch of each point of the map, in the order of the files."""
        path = os.path.join(self._folder, "patch")
        self.patch = np.memmap(path, np.int32, "w+", shape=(self._files.n_points,))
        self.patch[:] = -1
        for patch in range(len(self._whole)):
            rows = self._whole.slices[self._whole.first[patch] : self._whole.first[patch + 1]]
            for records in self._store.points(rows):
                self.patch[records["number"]] = patch

    def _in_axes_of_files(self, whole: Whole, parameters: dict[str, Any], report: dict[str, Any]) -> PatchesOnDisk:
        files, quarter, joined = self._files, -self._quarter, whole.joined
        nowhere = np.broadcast_to(np.full((1, 3), np.nan), (files.n_points, 3))
        cloud = PointCloud(nowhere, files.shift, source=files.name, unit=files.sources[0].unit)
        normal, centroid = turn(joined.normal, quarter), turn(joined.centroid, quarter)
        plain = Patches.unlabelled(cloud, np.zeros(0, np.int32), normal, centroid, parameters, report)
        low, high = np.sort([turn(whole.low, quarter), turn(whole.high, quarter)], axis=0)
        named = {name: getattr(plain, name) for name in Patches.__dataclass_fields__}
        return PatchesOnDisk(**named, sizes=joined.n_points, low=low, high=high)

    def assess(
        self, model: Model, origin: Origin | None = None, sources: Mapping[str, str] = MappingProxyType({})
    ) -> Result:
        """Return what a model infers about the patches; `sources` of the settings are added to their report.

        Raises InputError if the model needs features that this release does not have.
        """
        settings = feature_settings(model)
        given = np.asarray(settings.up if settings.up is not None else self.patches.parameters["up"], np.float64)
        up = given / np.linalg.norm(given)
        x, y, z = turn(up, self._quarter).tolist()
        measuring = Measuring(
            self._whole,
            self._store,
            self.tiling.boxes,
            settings.replace(up=(x, y, z)),
            self._workers,
            self._settings.tiles.tile_points,
        )
        parts = self._reported("measuring", measuring.features(self._known), len(measuring.groups))
        features = measuring.join(list(parts), up.tolist())
        labelling = classify(features, model)
        seen = Seen(None, {})
        if self._clock is not None and self._stays:
            stays = visits.join_stays(self._stays)
            visited = visits.visits_from(self._clock, stays, np.zeros(0, np.int64), None)
            bad = labelling.label == SUSPICIOUS
            seen = Seen(visited, measuring.causes(features, bad, self._clock, stays, visited))
        terms = explain(features, model, labelling.label)
        patches = replace(self.patches, report={**self.patches.report, "sources": dict(sources)})
        return Result(patches, features, model, labelling, terms, origin or Origin(), seen)

    def pieces(self, result: Result) -> Iterator[tuple[int, PointCloud]]:
        """Yield the points of the map in order, with the fields of a result, and the number of their file."""
        label, probability, cause = result.labelling.label, result.labelling.probability, result.cause_codes()
        begin = 0
        n_pieces = -(-self._files.n_points // 1_000_000) + len(self._files.sources)
        for number, piece in self._reported("writing", self._files.pieces(), n_pieces):
            patch = np.array(self.patch[begin : begin + len(piece)])
            begin += len(piece)
            yield number, result_cloud(piece, patch, label, probability, cause)


def _joined(one: Span | None, other: Span | None) -> Span | None:
    return None if one is None or other is None else one.joined(other)
