"""The verbs: functions that read, make and write clouds, patches, models and results."""

from __future__ import annotations

import dataclasses
import logging
import os
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapq.cloud import PointCloud
from mapq.configuration import (
    AS_IT_IS,
    FeatureSettings,
    FindSettings,
    MergeSettings,
    ReadOptions,
    SegmentSettings,
    TrainSettings,
)
from mapq.crf.calibration import with_false_alarms
from mapq.features import patch_features as measure
from mapq.features.compute import N_STEPS
from mapq.features.table import PatchFeatures
from mapq.io import clouds as cloud_files
from mapq.io import models as model_files
from mapq.io import patches as patch_files
from mapq.io.maps import read_input
from mapq.io.models import read_default_model, read_model
from mapq.model import Model
from mapq.patches import Patches
from mapq.posed import PosedScans, check_poses, find_scans, merge_scans, read_edges, write_without
from mapq.results.result import Origin, Result, assess
from mapq.segmentation import STAGES
from mapq.segmentation import segment as cut
from prf.shell.cli.console import ProgressCallback, reported
from prf.shell.cli.outputs import refuse_existing
from prf.shell.errors import ArgumentError, UsageError

logger = logging.getLogger(__name__)

Path = str | os.PathLike[str]


def read_cloud(path: Path, options: ReadOptions = AS_IT_IS) -> PointCloud:
    """Read a cloud of points; the format is recognised from the content.

    Parameters
    ----------
    path : path
        Of a file in a format of docs/clouds.md, gzipped or not.
    options : ReadOptions
        What the file does not contain: its unit, the topic and frame of a bag.

    Raises
    ------
    InputError
        If the file is missing, damaged or of another format, or has no finite point.
    """
    return cloud_files.read_cloud(os.fspath(path), options)


def read_scans(
    scans: Path | Sequence[Path],
    poses: Path | None = None,
    *,
    every: int = 1,
    find: FindSettings | None = None,
    merging: MergeSettings | None = None,
    options: ReadOptions = AS_IT_IS,
    progress: bool | ProgressCallback = True,
) -> PointCloud:
    """Merge posed scans to one cloud that knows which scan saw each point, when and from where.

    Parameters
    ----------
    scans : path or sequence of paths
        A folder, or files: all formats of docs/clouds.md.
    poses : path, optional
        File of poses; None: the one beside the scans, or those that scans carry themselves.
    every : int
        Take scans 0, every, 2 every and so on.
    find : FindSettings, optional
        Camera calibration, pattern of names, order of quaternions, frame of the points.
    merging : MergeSettings, optional
        Thinning and ranges.
    options, progress
        As :func:`read_cloud`, of the files of scans, and :func:`segment`.

    Returns
    -------
    PointCloud
        World coordinates in metres, with fields `scan`, `time` (where known), `pass_id` and `to_sensor_x/y/z`.

    Raises
    ------
    InputError
        If scans or poses are missing, cannot be read, or do not fit.
    """
    if every < 1:
        raise ArgumentError(f"every {every}: must be at least 1.")
    posed = _find(scans, poses, find or FindSettings(), options).every(every)
    with reported(progress, len(posed), "merging scans") as reporter:
        return merge_scans(posed, merging, reporter)


def _find(scans: Path | Sequence[Path], poses: Path | None, find: FindSettings, options: ReadOptions) -> PosedScans:
    names = [scans] if isinstance(scans, str | os.PathLike) else scans
    chosen = find if poses is None else find.replace(poses=os.fspath(poses))
    return find_scans([os.fspath(each) for each in names], chosen, options)


def point_cloud(
    xyz: ArrayLike, fields: Mapping[str, ArrayLike] | None = None, *, unit: float = 1.0, source: str = "arrays"
) -> PointCloud:
    """Return the cloud of coordinates, with fields of its points.

    Parameters
    ----------
    xyz : (n, 3) array
        World coordinates; a point that is nan has no place and belongs to no patch.
    fields : mapping of str to (n, ...) array, optional
        Such as `scan`, `time` or `pass_id`: when a point was seen.
    unit : float
        Metres in a unit of the coordinates.
    source : str
        Name for messages.

    Raises
    ------
    ArgumentError
        If shapes do not agree, no point is finite, or the unit is not a length.
    """
    world = _numbers("xyz", xyz)
    if world.ndim != 2 or world.shape[1] != 3:
        raise ArgumentError(f"xyz: has shape {world.shape}, must be (n, 3).")
    if not np.isfinite(world).all(axis=1).any():
        raise ArgumentError("xyz: no point is finite.")
    if not (isinstance(unit, Real) and np.isfinite(float(unit)) and unit > 0.0):
        raise ArgumentError(f"unit {unit}: must be a length above 0, in metres.")
    columns = {name: np.asarray(values) for name, values in (fields or {}).items()}
    for name, values in columns.items():
        if values.shape[:1] != (len(world),):
            raise ArgumentError(f"fields[{name!r}]: has shape {values.shape}, must have {len(world)} rows.")
    return PointCloud.from_world(world, columns, source, unit)


def segment(
    cloud: PointCloud | ArrayLike | Path,
    settings: SegmentSettings | None = None,
    *,
    progress: bool | ProgressCallback = True,
) -> Patches:
    """Cut a cloud into plane patches by region growing.

    Parameters
    ----------
    cloud : PointCloud, (n, 3) array, or path
    settings : SegmentSettings, optional
        What it leaves open is estimated from the cloud.
    progress : bool or callable
        Show a bar. A callable is given the share done in [0, 1], and a mapping of what a bar would show.

    Returns
    -------
    Patches
        Largest first. There may be none: then the report has a warning, which is logged.

    Raises
    ------
    ArgumentError
        If the array is not a cloud.
    InputError
        If the file cannot be read, or the points make no plane.
    """
    if isinstance(cloud, str | os.PathLike):
        cloud = read_cloud(cloud)
    elif not isinstance(cloud, PointCloud):
        cloud = point_cloud(cloud)
    with reported(progress, len(STAGES), "segmenting") as reporter:
        patches = cut(cloud, settings, reporter)
    _warn(patches)
    return patches


def patch_features(
    patches: Patches, settings: FeatureSettings | None = None, *, progress: bool | ProgressCallback = False
) -> PatchFeatures:
    """Return the features of patches and of pairs of neighbours (equations 6-13).

    Parameters
    ----------
    patches : Patches
    settings : FeatureSettings, optional
    progress : bool or callable, as of :func:`segment`
    """
    with reported(progress, N_STEPS, "features") as reporter:
        return measure(patches, settings, reporter)


def classify(
    map: Patches | PointCloud | ArrayLike | Path,
    model: Model | Path | None = None,
    *,
    tolerance: float | None = None,
    max_false_alarms: float | None = None,
    segmentation: SegmentSettings | None = None,
    options: ReadOptions = AS_IT_IS,
    progress: bool | ProgressCallback = True,
) -> Result:
    """Label the patches of a map plausible or suspicious, with reasons.

    Parameters
    ----------
    map : Patches, PointCloud, (n, 3) array, or path
        A cloud is segmented first.
    model : Model or path, optional
        None: the model of the package.
    tolerance : float, optional
        Metres: suspicious is what scans, or copies, put farther apart. None: chosen for the map (docs/crf.md).
    max_false_alarms : float, optional
        Share of the plausible patches that may be called suspicious, such as 0.02.
    segmentation : SegmentSettings, optional
        For a cloud; patches are segmented already.
    options, progress
        For the file of a cloud, and of the segmentation, as :func:`segment`.

    Raises
    ------
    ArgumentError
        If the array is not a cloud, `segmentation` is given for patches, or another value cannot be used.
    UsageError
        If the model has no operating points.
    InputError
        If a file cannot be read, the points make no plane, or the model does not fit this release.
    """
    used, origin = _model(model, max_false_alarms)
    found: Any = map
    if isinstance(map, str | os.PathLike):
        found = read_input(os.fspath(map), options)
        origin = origin._replace(name=os.fspath(map), files=(os.fspath(map), *origin.files))
    if not isinstance(found, Patches):
        found = segment(found, segmentation, progress=progress)
    elif segmentation is not None:
        raise ArgumentError(f"segmentation: {origin.name} is segmented already; settings of it are for clouds.")
    else:
        _warn(found)
    if not isinstance(map, str | os.PathLike):
        origin = origin._replace(name=found.cloud.source or "the map")
    with reported(progress, N_STEPS, "measuring") as reporter:
        return assess(found, used, reporter, origin, tolerance)


def classify_scans(
    scans: Path | Sequence[Path],
    poses: Path | None = None,
    model: Model | Path | None = None,
    *,
    every: int = 1,
    find: FindSettings | None = None,
    merging: MergeSettings | None = None,
    options: ReadOptions = AS_IT_IS,
    segmentation: SegmentSettings | None = None,
    tolerance: float | None = None,
    max_false_alarms: float | None = None,
    graph_out: Path | None = None,
    force: bool = False,
    progress: bool | ProgressCallback = True,
) -> Result:
    """Label the map of posed scans, and find which scans and which edges of their graph are wrong (`Result.poses`).

    Parameters
    ----------
    scans, poses, model, every, find, merging, options, segmentation, tolerance, max_false_alarms, progress
        As :func:`read_scans` and :func:`classify`, which also say what is raised.
    graph_out : path, optional
        The g2o file of the poses is written here without the edges that are probably wrong. `force`: over a file.

    Raises
    ------
    InputError, UsageError, OutputError
        If an edge cannot be read, there is none to write, or the graph cannot be written.
    """
    chosen = find or FindSettings()
    whole = _find(scans, poses, chosen, options)
    some, edges = whole.every(every), read_edges(whole, every, chosen.calibration)
    if graph_out is not None:
        if not edges:
            raise UsageError(f"{whole.poses_from or whole.source}: has no edges of g2o. Leave out --graph-out.")
        refuse_existing(graph_out, force)
    with reported(progress, len(some), "merging scans") as reporter:
        cloud = merge_scans(some, merging, reporter)
    given: dict[str, Any] = {"tolerance": tolerance, "max_false_alarms": max_false_alarms, "segmentation": segmentation}
    result = classify(cloud, model, progress=progress, **given)
    with reported(progress, 1.0, "comparing scans") as reporter:
        checked = check_poses(cloud, some, edges, reporter)
    if graph_out is not None:
        write_without(whole.poses_from, os.fspath(graph_out), checked.wrong_rows)
    return dataclasses.replace(result, poses=checked)


def train(
    maps: Patches | Path | Sequence[Patches | Path],
    settings: TrainSettings | None = None,
    features: FeatureSettings | None = None,
    *,
    conservative: bool = False,
    progress: bool | ProgressCallback = True,
) -> Model:
    """Return the model fitted to labelled patches (:meth:`Patches.labelled`).

    Without a regularisation in the settings its strength is chosen by cross-validation over regions of the maps, which
    also calibrates the probabilities; ``model.training["held_out"]`` has the scores on regions kept out.

    Parameters
    ----------
    maps : Patches, path of a PATCHES file, or a sequence of these
    settings : TrainSettings, optional
        With `max_false_alarms` the model has that operating point.
    features : FeatureSettings, optional
        Stored in the model, which measures other maps in the same way.
    conservative : bool
        Patches without a label count as suspicious.
    progress : bool or callable, as of :func:`segment`

    Raises
    ------
    ArgumentError
        If there are no maps.
    InputError
        If a file is not a PATCHES file, or there are not labels of both kinds.
    ConfigError
        If the settings ask for an edge feature that there is not.
    """
    from mapq.training import train_maps  # noqa: PLC0415 - the other functions do not need it

    given = [maps] if isinstance(maps, Patches | str | os.PathLike) else list(maps)
    if not given:
        raise ArgumentError("maps: give at least one.")
    with reported(progress, len(given), "maps") as reporter:
        model = train_maps(given, settings, features, reporter, conservative)
    share = settings.max_false_alarms if settings is not None else None
    return model if share is None else with_false_alarms(model, share, "the model")


def write_patches(path: Path, patches: Patches, *, force: bool = False) -> None:
    """Write a PATCHES file, as mapq segment does.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced (`force`), or cannot be written.
    """
    refuse_existing(path, force)
    patch_files.write_patches(path, patches)


def write_model(path: Path, model: Model, *, force: bool = False) -> None:
    """Write a model as readable JSON, to the last bit.

    Raises
    ------
    OutputError
        If the file exists and may not be replaced (`force`), or cannot be written.
    """
    refuse_existing(path, force)
    model_files.write_model(path, model)


def _model(model: Model | Path | None, max_false_alarms: float | None) -> tuple[Model, Origin]:
    """Return a model at its operating point, and its name and file."""
    if isinstance(model, Model):
        used, origin, name = model, Origin(model="given"), "the model"
    elif model is None:
        used, origin, name = read_default_model(), Origin(), "the model of the package"
    else:
        name = os.fspath(model)
        used, origin = read_model(model), Origin(model=name, files=(name,))
    if max_false_alarms is None:
        return used, origin
    if not (isinstance(max_false_alarms, Real) and 0.0 <= max_false_alarms <= 1.0):
        raise ArgumentError(f"max_false_alarms {max_false_alarms}: must be a share between 0 and 1, such as 0.05.")
    return with_false_alarms(used, max_false_alarms, name), origin


def _warn(patches: Patches) -> None:
    for warning in patches.report.get("warnings") or (() if len(patches) else ("no plane patch was found",)):
        logger.warning("%s: %s", patches.cloud.source or "the map", warning)


def _numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    try:
        array = np.asarray(values)
        return array if array.dtype == np.float32 else array.astype(np.float64)
    except (TypeError, ValueError):
        raise ArgumentError(f"{name}: must be an array of numbers.") from None
