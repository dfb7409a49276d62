"""A map from files to a result, tile by tile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.assess import visits
from mapq.assess.inputs import feature_settings
from mapq.axes import GroundPlan, turn
from mapq.cloud import PointCloud
from mapq.crf import classify, explain
from mapq.features.provenance import FIELDS, decide
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.model import Model
from mapq.patches import SUSPICIOUS
from mapq.scale.borders import BorderTask, Shared, compare_borders, join_shared
from mapq.scale.cut import Cut, CutTask, cut_tile
from mapq.scale.label import LabelTask, save_labels, write_labels
from mapq.scale.measure import with_noise
from mapq.scale.measuring import Cutting, Measuring, Seen
from mapq.scale.patches import join_regions
from mapq.scale.result import TiledResult, tiled_patches
from mapq.scale.scan import (
    SMALLEST_CELL,
    Estimate,
    EstimateTask,
    Scan,
    ScanTask,
    estimate,
    join_counts,
    join_spans,
    plan_scan,
    scan_range,
)
from mapq.scale.source import Range, Source, common_shift, cut_ranges
from mapq.scale.spool import Spooled, SpoolTask, spool_range
from mapq.scale.stages import Stages
from mapq.scale.tiling import Tiling, halo_width, is_too_coarse, make_tiling
from mapq.scale.unions import decide_unions
from mapq.scale.workers import Workers
from mapq.segmentation.regions import MERGE_RMS
from mapq.segmentation.settings import SegmentSettings
from mapq.segmentation.warnings import warnings_of
from prf.shell.errors import InputError
from prf.shell.progress import Reporter

TILE_POINTS = 2_500_000
"""Points of a tile at most, about: a worker takes half a gigabyte for them, and as much again at most."""
FEWEST_TILE_POINTS = 10_000

FINER = 32.0
"""Times that cells are made finer at once."""


@dataclass(frozen=True)
class ScaleSettings:
    """How a map is cut into tiles.

    Attributes
    ----------
    tile_points : int
        Points of a tile at most, about.
    segment : SegmentSettings
    options : ReadOptions
    """

    tile_points: int = TILE_POINTS
    segment: SegmentSettings = field(default_factory=SegmentSettings)
    options: ReadOptions = AS_IT_IS


class Job:
    """One map, the workers and the work folder; stages are called in their order.

    Parameters
    ----------
    name : str
        Of the map, for messages.
    sources : list of Source
    settings : ScaleSettings
    workers : Workers
    folder : str
        The work folder.
    progress : Reporter or None
        Told the seconds of work that are done, of those that :func:`mapq.scale.stages.total_cost` foresees.
    """

    def __init__(
        self,
        name: str,
        sources: list[Source],
        settings: ScaleSettings,
        workers: Workers,
        folder: str,
        progress: Reporter | None = None,
    ) -> None:
        self.name, self.sources, self.settings = name, sources, settings
        self.workers, self.folder = workers, folder
        self.ranges = cut_ranges(sources)
        self.n_points = sum(source.n_points for source in sources)
        self.shift = common_shift(sources)
        names = dict.fromkeys((*FIELDS, *visits.FIELDS))
        self.fields = tuple(name for name in names if all(name in each.fields for each in sources))
        self.stages = Stages(workers, self.n_points, progress)

    def cut(self) -> Cutting:
        """Cut the map into patches.

        Raises
        ------
        InputError
            If a file cannot be read, or there are too few points.
        """
        tiling, guess, plan, seen = self._plan()
        quarter, n_finite = plan.quarter(), plan.n_points
        spooled: list[Spooled] = self.stages.each(
            "sorting",
            spool_range,
            [self._spool_task(part, quarter, tiling, guess, seen) for part in self.ranges],
        )
        parts = _parts_of_tiles(spooled, len(tiling.boxes))
        tasks = [self._cut_task(*each, guess, tiling) for each in enumerate(parts)]
        cuts, label = self._regions(tasks, tiling)
        whole, found = join_regions(cuts, self._shared("joining", tiling, "region"), label, guess.chosen)
        whole.save(self.folder)
        n_distinct = sum(cut.n_distinct for cut in cuts)
        n_near = sum(sum(each.n_own) for each in spooled)
        report = {
            "points": self.n_points,
            "points_not_finite": self.n_points - n_finite,
            "points_far_outside": n_finite - n_near,
            "points_repeated": n_near - n_distinct,
            "points_looked_at": sum(cut.n_looked_at for cut in cuts),
            **found,
            "warnings": warnings_of(guess.chosen, n_finite - n_near, found),
        }
        described, starts = guess.chosen.described(quarter), _starts(parts, spooled)
        return Cutting(whole, quarter, described, report, tiling, seen, spooled, starts)

    def _regions(self, tasks: list[CutTask], tiling: Tiling) -> tuple[list[Cut], list[NDArray[np.int64]]]:
        """Return the regions of all tiles, and by tile which of those that grew there are one plane."""
        cuts: list[Cut] = self.stages.each("segmenting", cut_tile, tasks)
        shared = self._shared("comparing", tiling, "grown")
        unions = decide_unions(cuts, shared, MERGE_RMS * tasks[0].chosen.max_distance)
        again = [task._replace(decided=each) for task, each in zip(tasks, unions.decided, strict=True) if each]
        for task, cut in zip(again, self.stages.each("cutting again", cut_tile, again), strict=True):
            cuts[task.tile] = cut
        return cuts, unions.label

    def _source(self, part: Range) -> Source:
        return self.sources[part.file]

    def _plan(self) -> tuple[Tiling, Estimate, GroundPlan, Seen]:
        """Return the tiles, the parameters, the ground plan, and which fields count."""
        samples = tuple(f"{self.folder}/sample_{part.number:05d}.npz" for part in self.ranges)
        scans, cells, counts, cell = self._scan(samples)
        plan = reduce(GroundPlan.joined, [scan.plan for scan in scans], GroundPlan())
        if plan.n_points == 0:
            raise InputError(f"{self.name}: no point is finite. Check how the map was written.")
        task = EstimateTask(samples, self.settings.segment, plan, self.name)
        guess: Estimate = self.workers.each(estimate, [task], lambda _: None)[0]
        halo = halo_width(guess.chosen.spacing, guess.chosen.max_gap)
        tiling = make_tiling(turn(cells, plan.quarter()), counts, cell, self.settings.tile_points, halo)
        spans = join_spans(scans)
        return tiling, guess, plan, Seen(decide(spans), visits.clock_of(spans))

    def _scan(self, samples: tuple[str, ...]) -> tuple[list[Scan], NDArray[np.int64], NDArray[np.int64], float]:
        """Count the points in cells, again in finer ones where a few points far off have made them too coarse."""
        cell, side, share = plan_scan(self.sources)
        while True:
            tasks = [
                ScanTask(
                    self._source(part), self.settings.options, part, self.shift, cell, side, share, sample, self.fields
                )
                for part, sample in zip(self.ranges, samples, strict=True)
            ]
            scans = self.stages.each("counting", scan_range, tasks)
            cells, counts = join_counts([scan.cells for scan in scans], [scan.counts for scan in scans])
            if cell <= SMALLEST_CELL or len(counts) == 0 or not is_too_coarse(counts, self.settings.tile_points):
                return scans, cells, counts, cell
            cell = max(cell / FINER, SMALLEST_CELL)

    def _spool_task(self, part: Range, quarter: int, tiling: Tiling, guess: Estimate, seen: Seen) -> SpoolTask:
        read = self._source(part), self.settings.options, part, self.shift
        return SpoolTask(*read, quarter, tiling, guess.near, seen.fields, seen.clock, self.folder)

    def _cut_task(self, tile: int, parts: list[int], guess: Estimate, tiling: Tiling) -> CutTask:
        bases = tuple(self.ranges[part].base for part in parts)
        box, halo = tiling.boxes[tile], tiling.halo
        return CutTask(tile, tuple(parts), bases, guess.chosen, guess.frame, box, halo, self.folder)

    def _shared(self, stage: str, tiling: Tiling, column: str) -> Shared:
        """Return which regions of neighbouring tiles share points."""
        tasks = []
        for tile in range(len(tiling.boxes)):
            others = tuple(other for other in tiling.neighbours(tile).tolist() if other > tile)
            tasks.append(BorderTask(tile, others, self.folder, column))
        return join_shared(self.stages.each(stage, compare_borders, tasks))

    def assess(self, cutting: Cutting, model: Model) -> TiledResult:
        """Return what a model says of the patches.

        Raises
        ------
        InputError
            If the model reads the features literally, or asks for some that this release does not have.
        """
        settings = feature_settings(model)
        if settings.reading != "safe":
            raise InputError(f"the model reads features as '{settings.reading}', which tiles have not. Train another.")
        up = _up(settings, cutting.parameters)
        settings = with_noise(settings, cutting.whole)
        measuring = Measuring(cutting, settings, up, self.stages, self.settings.tile_points, self.folder)
        whole = cutting.whole.turned(-cutting.quarter)
        features = measuring.features()
        labelling = classify(features, model)
        frame = PointCloud(np.zeros((0, 3)), self.shift, source=self.name, unit=self.sources[0].unit)
        patches = tiled_patches(whole, frame, self.n_points, cutting.parameters, cutting.report)
        terms = explain(features, model, labelling.label)
        found = measuring.causes(features, labelling.label == SUSPICIOUS)
        return TiledResult(
            patches, features, model, labelling, terms, whole=whole, n_tiles=len(cutting.tiling.boxes), found=found
        )

    def write(self, cutting: Cutting, result: TiledResult, targets: Mapping[str, list[int]]) -> None:
        """Write the labels of the points into files, each of which takes those of some source files.

        Parameters
        ----------
        cutting : Cutting
        result : TiledResult
        targets : mapping of str to list of int
            Files, and the places of those whose points they take.
        """
        save_labels(self.folder, result.labelling.label, result.labelling.probability, result.cause_codes())
        tasks = []
        for target, files in targets.items():
            parts = tuple(tuple(part for part in self.ranges if part.file == file) for file in files)
            numbers = {part.number for several in parts for part in several}
            tasks.append(
                LabelTask(
                    target,
                    tuple(self.sources[file] for file in files),
                    parts,
                    {number: cutting.spooled[number] for number in numbers},
                    {key: begin for key, begin in cutting.starts.items() if key[1] in numbers},
                    self.settings.options,
                    self.shift,
                    self.folder,
                )
            )
        self.stages.each("writing", write_labels, tasks)


def _parts_of_tiles(spooled: list[Spooled], n_tiles: int) -> list[list[int]]:
    """Return for each tile the ranges that have points for it."""
    parts: list[list[int]] = [[] for _ in range(n_tiles)]
    for each in spooled:
        for tile in each.tiles:
            parts[tile].append(each.part)
    return parts


def _starts(parts: list[list[int]], spooled: list[Spooled]) -> dict[tuple[int, int], int]:
    """Return by tile and range where the points of the range begin in the tile's file of regions."""
    sizes = {
        (tile, each.part): n_own + n_halo
        for each in spooled
        for tile, n_own, n_halo in zip(each.tiles, each.n_own, each.n_halo, strict=True)
    }
    found = {}
    for tile, several in enumerate(parts):
        begin = 0
        for part in several:
            found[tile, part] = begin
            begin += sizes[tile, part]
    return found


def _up(settings: Any, parameters: Mapping[str, Any]) -> list[float]:
    """Return the unit vector that points up: of the settings, else of the segmentation."""
    up = np.asarray(settings.up if settings.up is not None else parameters["up"], np.float64)
    return [float(value) for value in up / np.linalg.norm(up)]
