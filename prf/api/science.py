"""Arguments of `prf.sample`: the prior, the sensors, and the readings of each."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from prf.configuration import IN_MANIFEST, Configuration, Prior, ReadingOptions
from prf.model.sensors import CONE, LaserModel, PointModel, SonarModel
from prf.readings import Kind, PointTable, Readings, join_logs, read_point_data
from prf.readings import read_readings as read_log
from prf.sampler.prepare import Prepared, given_poses, prepare_whole, read_configured
from prf.shell.cli.settings import Loaded, load
from prf.shell.errors import ArgumentError

Sensor = LaserModel | SonarModel | PointModel
Path = str | os.PathLike[str]
Source = Readings | PointTable | Path
"""Readings of one kind, or a log of them."""
Sources = Mapping["ReadingKind", Sequence[Source]]
"""Those of each kind, several in one frame."""
ReadingKind = Literal["laser", "sonar", "points"]
KINDS: tuple[ReadingKind, ...] = ("laser", "sonar", "points")
Given = Source | Sequence[Source] | Mapping[ReadingKind, Source | Sequence[Source]]

TABLES: Mapping[type, ReadingKind] = MappingProxyType({LaserModel: "laser", SonarModel: "sonar", PointModel: "points"})
"""Kind of a sensor's readings, which is the name of its table too."""


def read_readings(
    path: Path,
    kind: Kind = "laser",
    *,
    topic: str | None = None,
    frame: str | None = None,
    cone: float = CONE,
    poses: Path | None = None,
) -> Readings:
    """Read the readings of a laser or of sonars from a log; the format is recognised from the content.

    Parameters
    ----------
    path : path
        A CARMEN or Player log, a ROS bag, or a CSV table x,y,theta,range; gzipped or not.
    kind : {"laser", "sonar"}
    topic, frame : str, optional
        Whose readings of a bag or a log with several, and in what frame.
    cone : float
        Full opening angle of sonars whose log has none, radians.
    poses : path, optional
        A trajectory for scans that have no poses, or worse ones: TUM, KITTI, g2o, or CSV (docs/readings.md).

    Raises
    ------
    InputError
        If a file is missing, damaged, of another format, or has no readings of this kind.
    ConfigError
        If `topic` or `frame` is needed and missing, or is not in the log.
    """
    files = () if poses is None else (os.fspath(poses),)
    trajectory = next(iter(given_poses(ReadingOptions(poses=files))), None)
    return read_log(os.fspath(path), kind, topic=topic, frame=frame, cone=cone, poses=trajectory)


def requested_by(config: Path | Configuration | Loaded[Configuration] | None) -> Loaded[Configuration]:
    """Return a configuration with its sources; nothing in particular has set the values of one without."""
    if isinstance(config, Configuration):
        return Loaded(config, {})
    return config if isinstance(config, Loaded) else load(Configuration, config, read=IN_MANIFEST)


def settled(
    requested: Loaded[Configuration],
    prior: Prior | None,
    sensors: Sensor | Sequence[Sensor],
    options: Mapping[str, Any],
) -> Loaded[Configuration]:
    """Return the configuration: options, prior and sensors over what is requested, with the sources that still hold."""
    if not isinstance(prior, Prior | None):
        raise ArgumentError(f"prior: a {type(prior).__name__}, must be a Prior.")
    tables: dict[str, Any] = {} if prior is None else {"prior": prior}
    for sensor in _listed(sensors):
        if type(sensor) not in TABLES:
            names = ", ".join(kind.__name__ for kind in TABLES)
            raise ArgumentError(f"sensors: a {type(sensor).__name__}, must be one of {names}.")
        tables[TABLES[type(sensor)]] = sensor
    changes = {name: value for name, value in options.items() if value is not None}
    found = requested.settings.model_copy(update=tables).replace(**changes)
    kept = {
        place: each for place, each in requested.sources.items() if found.get(place) == requested.settings.get(place)
    }
    return Loaded(found, kept)


def by_kind(given: Given, sensors: Sensor | Sequence[Sensor] = ()) -> dict[ReadingKind, list[Source]]:
    """Return the sources of each kind of readings, the laser first.

    Parameters
    ----------
    given : Source, sequence of Source, or mapping of kind to one or several
        Several of a kind are in one frame. Without a kind readings with a cone are sonar's, tables of points are
        points', a path is a laser's log.
    sensors : Sensor or sequence of Sensor
        Models of sensors that must have readings.

    Raises
    ------
    ArgumentError
        If a kind is unknown, or has a model but no readings, or points are given twice.
    """
    if isinstance(given, Mapping):
        pairs = [(kind, each) for kind, sources in given.items() for each in _listed(sources)]
    else:
        pairs = [(_kind(each), each) for each in _listed(given)]
    found: dict[ReadingKind, list[Source]] = {}
    for kind, source in pairs:
        if kind == "points" and kind in found:
            raise ArgumentError("readings: points are given twice. Join them to one table.")
        found.setdefault(kind, []).append(_checked_source(kind, source))
    for sensor in _listed(sensors):
        kind = TABLES.get(type(sensor), "laser")
        if kind not in found:
            raise ArgumentError(f"sensors: there is a {type(sensor).__name__}, but no readings of the {kind}.")
    if not found:
        raise ArgumentError("readings: give at least one: a log, or what prf.laser, prf.sonar or prf.points made.")
    return {kind: found[kind] for kind in KINDS if kind in found}


def paths_of(sources: Iterable[Source]) -> list[str]:
    """Return the logs among sources."""
    return [os.fspath(source) for source in sources if isinstance(source, str | os.PathLike)]


def prepared_for(sources: Sources, config: Configuration) -> Prepared:
    """Read what is a log, thin all, and resolve the configuration for it.

    Raises
    ------
    InputError, ConfigError
        As :func:`prf.sampler.prepare.prepare`.
    """
    laser, sonar, observed = read_sources(sources, config)
    return prepare_whole(config, laser, sonar, observed)


def read_sources(sources: Sources, config: Configuration) -> tuple[Readings | None, Readings | None, PointTable | None]:
    """Read what is a log, and join what is of one kind; readings that are no log come last."""
    kinds: tuple[ReadingKind, ReadingKind] = ("laser", "sonar")
    logs = [paths_of(sources.get(kind, ())) for kind in kinds]
    found = []
    for kind, own in zip(kinds, read_configured(config, *logs), strict=True):
        held = [each for each in sources.get(kind, ()) if isinstance(each, Readings)]
        parts = [*([] if own is None else [own]), *held]
        found.append(join_logs(parts) if parts else None)
    table = next(iter(sources.get("points", ())), None)
    observed = table if isinstance(table, PointTable) or table is None else read_point_data(*paths_of([table]))
    return found[0], found[1], observed


def _kind(source: Source) -> ReadingKind:
    """Return whose readings these are."""
    if isinstance(source, PointTable):
        return "points"
    if not isinstance(source, Readings):
        return "laser"
    is_cone = source.cone > 0.0
    if is_cone.any() and not is_cone.all():
        raise ArgumentError(f"readings: {source.source} has readings with a cone and without. Part laser and sonar.")
    return "sonar" if is_cone.any() else "laser"


def _checked_source(kind: str, source: Source) -> Source:
    wanted: tuple[type, ...] = (PointTable if kind == "points" else Readings, str, os.PathLike)
    if kind not in KINDS:
        raise ArgumentError(f"readings: {kind!r}: must be one of {', '.join(KINDS)}.")
    if not isinstance(source, wanted):
        raise ArgumentError(
            f"readings: {type(source).__name__} is not a log. Give a file, or readings made by prf.{kind} from arrays."
        )
    return source


def _listed(given: Any) -> list[Any]:
    """Return one or several as a list; a table of points is one though it is a tuple."""
    if isinstance(given, Sequence) and not isinstance(given, str | PointTable | np.ndarray):
        return list(given)
    return [given]
