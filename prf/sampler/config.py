"""What a user may ask of a run, and what it comes to for a given log."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from prf.arak import checked_scale
from prf.logs import CONE, PointTable, Readings
from prf.logs.describe import default_max_range
from prf.logs.rings import fields_of_view
from prf.posterior import LaserData, PointData, Settings, SonarData
from prf.run import Beams, Cones, Points
from prf.sampler.ground import driven_way, seen_cells
from prf.sampler.starts import STARTS, Start
from prf.sampler.tempering_ladder import AUTO_RUNGS, LadderPlan
from prf.sampler.tiles.schedule import chosen_tiles
from prf.sensors.domain import check_length
from prf.sensors.laser import LaserModel, unit_vectors
from prf.sensors.points import PointModel, window_round
from prf.sensors.sonar import SonarModel
from prf.shell.errors import ConfigError, InputError
from prf.thinning import BEAM_DENSITY, checked_density, thin_beams
from prf.window import LARGEST_RANGE, Window

KEPT_RETURNS = 0.995
"""Share of the returns that the default window holds at least."""
MARGIN = 1.0
"""Metres between them and the border of the default window."""
PIXELS_ACROSS = 500
"""The default resolution is the next of 1, 2, 5, 10 ... that needs no more pixels along the longer side."""
MOST_CHAINS, MOST_RUNGS = 10_000, 1_000
MOST_PIXELS = 4_000_000
"""Each takes some 50 bytes a chain, in memory and in checkpoints."""


DrivenPoses = Literal["used", "all"]
DRIVEN_POSES: tuple[DrivenPoses, ...] = ("used", "all")


@dataclasses.dataclass(frozen=True)
class SampleConfig:
    """The science of a run; None is resolved from the log. Units: metres.

    Attributes
    ----------
    scale : float
        Scale parameter p of the Arak process, 1/m.
    window : tuple of 4 floats or None
        x_min, y_min, x_max, y_max.
    max_range : float or None
        Readings at or above it are no returns; default 0.97 of the log's largest range.
    noise, noise_relative, outlier_probability, miss_probability : float
        See :class:`prf.sensors.laser.LaserModel`.
    sonar_max_range, sonar_noise, sonar_noise_relative, sonar_corner_bias, ...
        See :class:`prf.sensors.sonar.SonarModel`, whose fields these are behind ``sonar_``.
    sonar_cone : float
        Full field of view of sonars whose log has none, radians.
    points_kind, points_mean_black, points_mean_white, points_sigma, points_flip_probability
        See :class:`prf.sensors.points.PointModel`, whose fields these are behind ``points_``.
    topic, sonar_topic, frame : str or None
        Whose readings to take of each log, and in what frame (:func:`prf.logs.read_readings`).
    beam_density : float
        Beams of the laser a square metre of seen ground at which a log is thinned (:mod:`prf.thinning`); 0 keeps all.
    every_scan, every_beam : int
        Of the laser and of the sonar.
    scans, skip_scans : str or None
        START:STOP:STEP.
    driven_radius : float
        Of the disc that was free all along the way driven, metres; 0: nothing is taken from the way.
    driven_poses : {"used", "all"}
        Whose poses are the way: of the scans in use, or of all scans of the log.
    chains : int
    resolution : float or None
        Side of the squares of the occupancy image.
    tiles : int or None
        Tiles in which a chain is updated at once (docs/tiles.md), 0: none.
    start : {"empty", "grid", "prior"} or None
        Where chains start (:mod:`prf.sampler.starts`); default "grid" with a laser, else "empty".
    rungs : int or "auto"
        Rungs of parallel tempering a chain, the cold one among them (:mod:`prf.sampler.tempering`); 1: none; "auto":
        none until chains stay apart (:mod:`prf.sampler.apart`).
    hottest : float or None
        Lowest power of the likelihood on them; None: found in burn-in.
    """

    scale: float = 0.1
    window: tuple[float, float, float, float] | None = None
    max_range: float | None = None
    noise: float = LaserModel.noise
    noise_relative: float = LaserModel.noise_relative
    outlier_probability: float = LaserModel.outlier_probability
    miss_probability: float = LaserModel.miss_probability
    sonar_max_range: float = SonarModel.max_range
    sonar_noise: float = SonarModel.noise
    sonar_noise_relative: float = SonarModel.noise_relative
    sonar_corner_bias: float = SonarModel.corner_bias
    sonar_corner_distance: float = SonarModel.corner_distance
    sonar_surface_bias: float = SonarModel.surface_bias
    sonar_surface_distance: float = SonarModel.surface_distance
    sonar_surface_oblique: float = SonarModel.surface_oblique
    sonar_surface_subtended: float = SonarModel.surface_subtended
    sonar_uniform_probability: float = SonarModel.uniform_probability
    sonar_short_probability: float = SonarModel.short_probability
    sonar_short_length: float = SonarModel.short_length
    sonar_cone: float = CONE
    points_kind: str | None = PointModel.kind
    points_mean_black: float = PointModel.mean_black
    points_mean_white: float = PointModel.mean_white
    points_sigma: float | None = PointModel.sigma
    points_flip_probability: float = PointModel.flip_probability
    beam_density: float = BEAM_DENSITY
    topic: str | None = None
    sonar_topic: str | None = None
    frame: str | None = None
    every_scan: int = 1
    every_beam: int = 1
    scans: str | None = None
    skip_scans: str | None = None
    driven_radius: float = 0.1
    driven_poses: DrivenPoses = "used"
    chains: int = 4
    resolution: float | None = None
    tiles: int | None = None
    start: Start | None = None
    rungs: int | Literal["auto"] = 1
    hottest: float | None = None

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> SampleConfig:
        """Return the configuration that a manifest holds."""
        window = values.get("window")
        return cls(**{"start": "empty", **values, "window": tuple(window) if window is not None else None})

    def __post_init__(self) -> None:
        """Refuse what the way cannot be, and more chains or rungs than there can be states (ConfigError)."""
        if not 0.0 <= self.driven_radius <= LARGEST_RANGE:
            raise ConfigError(f"--driven-radius {self.driven_radius}: must be a number of metres, or 0")
        if self.driven_poses not in DRIVEN_POSES:
            raise ConfigError(f"--driven-poses {self.driven_poses}: is none of {', '.join(DRIVEN_POSES)}")
        for name, most in (("chains", MOST_CHAINS), ("rungs", MOST_RUNGS)):
            value = getattr(self, name)
            if not isinstance(value, str) and not 1 <= value <= most:
                raise ConfigError(f"--{name} {value}: must be from 1 to {most}")

    def plan(self) -> LadderPlan:
        """Return the ladder that is asked for.

        Raises
        ------
        ConfigError
            If it is none, or if there are tiles, which hot rungs know nothing of.
        """
        if self.is_tempered and self.tiles:
            raise ConfigError(f"--tiles {self.tiles}: hot rungs have none. Leave out --rungs or --tiles.")
        if isinstance(self.rungs, str):
            return LadderPlan(AUTO_RUNGS, self.hottest, waits=True)
        return LadderPlan(self.rungs, self.hottest)

    @property
    def is_tempered(self) -> bool:
        """Whether chains have hot rungs, or may come to have some."""
        return isinstance(self.rungs, str) or self.rungs > 1

    def starts_from(self) -> Start:
        """Return where chains start, of a resolved configuration.

        Raises
        ------
        ConfigError
            If the word is unknown.
        """
        if self.start not in STARTS:
            raise ConfigError(f"--start {self.start}: is none of {', '.join(STARTS)}")
        return self.start


class Prepared(NamedTuple):
    """Logs made ready for the sampler.

    Attributes
    ----------
    settings : Settings
    beams : Beams or None
        The laser readings that are used.
    cones : Cones or None
        The sonar readings that are used.
    points : Points or None
        The point observations that are used.
    config : SampleConfig
        Resolved: window, resolution and, with a laser, max_range are numbers; with points, what their kind needs.
    n_outside : int
        Readings dropped because their sensor does not stand inside the window.
    n_points_outside : int
        Point observations dropped because they do not lie inside the window.
    n_beams_thinned : int
        Beams inside the window that thinning left out.
    """

    settings: Settings
    beams: Beams | None
    cones: Cones | None
    points: Points | None
    config: SampleConfig
    n_outside: int
    n_points_outside: int
    n_beams_thinned: int = 0


def prepare(
    config: SampleConfig,
    laser: Readings | None,
    sonar: Readings | None = None,
    observed: PointTable | None = None,
    driven: Sequence[Readings] | None = None,
) -> Prepared:
    """Resolve a configuration for the readings (thinned already) of a laser and a sonar, and for points; one at least.

    The way driven is that of the poses of `driven`, or else of these readings.

    Raises
    ------
    InputError
        If no reading is left, or no point.
    ConfigError
        If a parameter is out of its range.
    """
    beams = None if laser is None else _beams(config, laser)
    cones = None if sonar is None else _cones(config, sonar)
    sensors = [part for part in (beams, cones) if part is not None]
    window = _window(config, sensors, observed)
    n_outside = sum(int((~window.contains(part.origin, strictly=True)).sum()) for part in sensors)
    inside, kept_cones = _inside(beams, window), _inside(cones, window)
    kept_beams = None if inside is None else _thinned(config, inside, window)
    if sensors and kept_beams is None and kept_cones is None:
        source = " and ".join(log.source for log in (laser, sonar) if log is not None)
        raise InputError(f"{source}: no sensor stands inside the window. Check --window.")
    points = None if observed is None else _points(config, observed, window)
    n_points_outside = 0 if observed is None or points is None else len(observed.value) - len(points.value)
    resolution = config.resolution if config.resolution is not None else chosen_resolution(window)
    max_range = config.max_range if beams is None else beams.max_range
    n_readings = sum(len(part.range) for part in (kept_beams, kept_cones) if part is not None)
    tiles = config.tiles if config.tiles is not None else 0 if config.is_tempered else chosen_tiles(window, n_readings)
    resolved = dataclasses.replace(config, window=(*window,), max_range=max_range, resolution=resolution, tiles=tiles)
    if points is not None:
        model = point_model(config).resolved(points.value)
        resolved = dataclasses.replace(resolved, points_kind=model.kind, points_sigma=model.sigma)
    if resolved.start is None:
        resolved = dataclasses.replace(resolved, start="empty" if kept_beams is None else "grid")
    resolved.plan()
    if resolved.starts_from() == "grid" and kept_beams is None:
        raise ConfigError("--start grid: needs the readings of a laser. Choose another start.")
    settings = make_settings(resolved, kept_beams, kept_cones, points)
    if driven is None:
        driven = [log for log in (laser, sonar) if log is not None]
    way = driven_way(resolved.driven_radius, driven, sensors, window)
    settings = dataclasses.replace(settings, way=way, seen=seen_cells(window, resolution, inside, kept_cones, points))
    n_thinned = 0 if inside is None or kept_beams is None else len(inside.range) - len(kept_beams.range)
    return Prepared(settings, kept_beams, kept_cones, points, resolved, n_outside, n_points_outside, n_thinned)


def _window(config: SampleConfig, sensors: Sequence[Beams | Cones], observed: PointTable | None) -> Window:
    """Return the window asked for, or one round sensors and returns, or round points where there are no sensors."""
    if config.window is None and observed is not None and not sensors:
        return window_round(observed.xy)
    origin, angle, ranges = (
        np.concatenate([np.empty(shape), *(getattr(part, name) for part in sensors)])
        for name, shape in (("origin", (0, 2)), ("angle", 0), ("range", 0))
    )
    return chosen_window(config, origin, angle, ranges)


def _beams(config: SampleConfig, readings: Readings) -> Beams:
    """Return the laser readings, inf where there was no return below the maximum range."""
    max_range = config.max_range if config.max_range is not None else default_max_range(readings)
    if config.max_range is None and not math.isfinite(max_range):
        raise InputError(f"{readings.source}: no reading has a finite range. Give --max-range.")
    laser_model(dataclasses.replace(config, max_range=max_range))
    ranges = np.where(readings.range < max_range, readings.range, np.inf)
    return Beams(readings.origin, readings.angle, ranges, readings.scan, max_range)


def _cones(config: SampleConfig, readings: Readings) -> Cones:
    """Return the sonar readings, inf where there was no return below the maximum range."""
    view = fields_of_view(readings, config.sonar_cone)
    max_range = sonar_model(config).max_range
    ranges = np.where(readings.range < max_range, readings.range, np.inf)
    return Cones(readings.origin, readings.angle, view, ranges, readings.scan, max_range)


def _points(config: SampleConfig, observed: PointTable, window: Window) -> Points:
    """Return the point observations inside the window."""
    if config.points_kind == "binary":
        observed.refuse_other_than_colours()
    inside = window.contains(observed.xy, strictly=True)
    if not inside.any():
        raise InputError(f"{observed.source}: no point lies inside the window. Check --window.")
    return Points(observed.xy[inside], observed.value[inside])


Kept = TypeVar("Kept", Beams, Cones)


def _inside(readings: Kept | None, window: Window) -> Kept | None:
    """Return the readings whose sensor stands inside the window; None if there are none."""
    if readings is None:
        return None
    inside = window.contains(readings.origin, strictly=True)
    return readings.select(inside) if inside.any() else None


def _thinned(config: SampleConfig, beams: Beams, window: Window) -> Beams:
    """Return the beams that thinning keeps."""
    density = checked_density(config.beam_density)
    kept = thin_beams(window, beams.origin, beams.angle, beams.range, beams.max_range, density)
    return beams if len(kept) == len(beams.range) else beams.select(kept)


def laser_model(config: SampleConfig) -> LaserModel:
    """Return the laser's parameters of a configuration whose max_range is a number."""
    assert config.max_range is not None
    return LaserModel(
        config.max_range, config.noise, config.noise_relative, config.outlier_probability, config.miss_probability
    )


def sonar_model(config: SampleConfig) -> SonarModel:
    """Return the sonar's parameters of a configuration."""
    names = [field.name for field in dataclasses.fields(SonarModel)]
    return SonarModel(**{name: getattr(config, f"sonar_{name}") for name in names})


def point_model(config: SampleConfig) -> PointModel:
    """Return the parameters of point observations of a configuration."""
    names = [field.name for field in dataclasses.fields(PointModel)]
    return PointModel(**{name: getattr(config, f"points_{name}") for name in names})


def make_settings(
    config: SampleConfig, beams: Beams | None, cones: Cones | None = None, points: Points | None = None
) -> Settings:
    """Return the settings of a resolved configuration and its readings and points.

    Raises
    ------
    ConfigError
        If the resolution is no positive number or asks for too many pixels.
    """
    assert config.window is not None
    assert config.resolution is not None
    window = Window.checked(*config.window)
    check_length("--resolution", config.resolution)
    if window.area / config.resolution**2 > MOST_PIXELS:
        raise ConfigError(f"--resolution {config.resolution}: more than {MOST_PIXELS} pixels. Give a larger one.")
    laser = None if beams is None else LaserData(beams.origin, beams.angle, beams.range, laser_model(config))
    sonar = (
        None if cones is None else SonarData(cones.origin, cones.angle, cones.cone, cones.range, sonar_model(config))
    )
    observed = None if points is None else PointData(points.xy, points.value, point_model(config))
    return Settings(
        window,
        checked_scale(config.scale),
        laser,
        resolution=config.resolution,
        sonar=sonar,
        points=observed,
        tiles=config.tiles or 0,
        driven_radius=config.driven_radius,
    )


def chosen_window(
    config: SampleConfig, origin: NDArray[np.float64], angle: NDArray[np.float64], ranges: NDArray[np.float64]
) -> Window:
    """Return the window asked for, or one round all sensors and 99.5 % of the returns."""
    if config.window is not None:
        return Window.checked(*config.window)
    hit = np.isfinite(ranges)
    ends = origin[hit] + ranges[hit, None] * unit_vectors(angle[hit])
    low, high = origin.min(axis=0), origin.max(axis=0)
    if len(ends) > 0:
        # A quarter of what may be left out on each of the four sides.
        tail = (1.0 - KEPT_RETURNS) / 4.0
        low = np.minimum(low, np.quantile(ends, tail, axis=0, method="lower"))
        high = np.maximum(high, np.quantile(ends, 1.0 - tail, axis=0, method="higher"))
    return Window.checked(*(low - MARGIN).tolist(), *(high + MARGIN).tolist())


def chosen_resolution(window: Window) -> float:
    """Return a round resolution that fits the window, metres."""
    least = max(window.width, window.height) / PIXELS_ACROSS
    decade = 10.0 ** math.floor(math.log10(least))
    return float(next(round(step * decade, 12) for step in (1, 2, 5, 10) if step * decade >= least))
