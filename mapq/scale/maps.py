"""The two jobs that large maps are for: a map cut into patches, and a map classified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mapq.assess import MIN_COVERAGE, Origin
from mapq.io.clouds import read_cloud
from mapq.io.models import read_default_model
from mapq.model import Model
from mapq.patches import Patches
from mapq.scale.label import patch_of_range
from mapq.scale.output import made_in, plan_output, publish
from mapq.scale.result import TiledResult
from mapq.scale.run import FEWEST_TILE_POINTS, Job, ScaleSettings
from mapq.scale.source import find_sources, is_tiled
from mapq.scale.stages import CUTTING, total_cost
from mapq.scale.workers import open_workers
from prf.shell.errors import UsageError
from prf.shell.progress import progress
from prf.shell.work import work_folder

MOST_WORKERS = 1024


class Where(NamedTuple):
    """Who does the work: processes on this machine, or the workers of a Dask scheduler at an address."""

    n_workers: int = 1
    scheduler: str | None = None

    def check(self) -> None:
        """Raise UsageError for what cannot be."""
        if not 1 <= self.n_workers <= MOST_WORKERS:
            raise UsageError(f"--workers {self.n_workers} is not from 1 to {MOST_WORKERS}.")
        if self.scheduler is not None and self.n_workers != 1:
            raise UsageError("--workers and --scheduler exclude one another: Dask has workers of its own.")


def check(settings: ScaleSettings, where: Where) -> None:
    """Raise UsageError for settings outside their domains."""
    where.check()
    settings.segment.check()
    if settings.tile_points < FEWEST_TILE_POINTS:
        raise UsageError(f"--tile-points {settings.tile_points} is less than {FEWEST_TILE_POINTS}.")


def classify_map(
    path: str,
    target: str,
    model: Model | None,
    settings: ScaleSettings,
    where: Where,
    force: bool,
    origin: Origin | None = None,
    limits: tuple[float | None, float] = (None, MIN_COVERAGE),
    sources: Mapping[str, str] | None = None,
) -> TiledResult:
    """Classify a map tile by tile, and write the result.

    Parameters
    ----------
    path : str
        A file, or a folder of LAS or LAZ tiles.
    target : str
        A cloud, beside which the JSON goes; or for a folder a folder, in which tiles have the names of the input's.
    model : Model or None
        None: the model that ships with the package.
    settings : ScaleSettings
    where : Where
    force : bool
        Whether a result that stands may be replaced.
    origin : Origin
        Inputs that the JSON names.
    limits : (float or None, float)
        Of the verdict: fail_over and min_coverage.
    sources : mapping of str to str
        Where each setting of the segmentation was given.

    Raises
    ------
    InputError, UsageError, ConfigError, OutputError
        As reading, segmenting, the workers and writing do.
    """
    check(settings, where)
    files = find_sources(path, settings.options)
    output = plan_output(target, files, is_tiled(path), force)
    n_points = sum(file.n_points for file in files)
    with (
        work_folder(target) as folder,
        open_workers(where.n_workers, where.scheduler) as workers,
        progress(total_cost(n_points), "classifying") as reporter,
    ):
        job = Job(path, files, settings, workers, folder, reporter)
        cutting = job.cut()
        cutting.report["sources"] = dict(sources or {})
        result = replace(job.assess(cutting, model or read_default_model()), origin=origin or Origin(path))
        job.write(cutting, result, made_in(folder, output))
        rows = job.stages.telling(result.patch_rows(), len(result.patches))
        publish(folder, output, result.head(*limits), rows)
    return result


def segment_map(path: str, beside: str, settings: ScaleSettings, where: Where) -> Patches:
    """Cut a map into patches tile by tile, and return it whole, in memory.

    Parameters
    ----------
    path : str
        A file.
    beside : str
        A file beside which the work folder stands.
    settings : ScaleSettings
    where : Where

    Raises
    ------
    InputError, UsageError, ConfigError
        As reading, segmenting and the workers do.
    """
    check(settings, where)
    sources = find_sources(path, settings.options)
    with (
        work_folder(beside) as folder,
        open_workers(where.n_workers, where.scheduler) as workers,
        progress(total_cost(sources[0].n_points, CUTTING), "segmenting") as reporter,
    ):
        job = Job(path, sources, settings, workers, folder, reporter)
        cutting = job.cut()
        parts = [
            patch_of_range(folder, part, spooled, cutting.starts)
            for part, spooled in zip(job.ranges, cutting.spooled, strict=True)
        ]
    cloud = read_cloud(path, settings.options)
    whole = cutting.whole.turned(-cutting.quarter)
    centroid = whole.centroid + (job.shift - cloud.shift) * cloud.unit
    return Patches.unlabelled(cloud, np.concatenate(parts), whole.normal, centroid, cutting.parameters, cutting.report)
