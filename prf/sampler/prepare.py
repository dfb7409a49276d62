"""From logs and a configuration to what chains are built with: readings thinned and cut to the window, all resolved."""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Configuration, ReadingOptions
from prf.model.points import resolved as resolved_points
from prf.model.points import window_round
from prf.model.window import Window
from prf.poses.given import pose_noise, warn_of_errors
from prf.poses.model import PoseModel, pose_model
from prf.poses.start import find_start
from prf.readings import (
    GivenPoses,
    Kind,
    PointTable,
    Readings,
    read_logs,
    read_point_data,
    read_poses,
    thin,
    warn_of_spoiling,
)
from prf.readings.counts import BeamCounts, beam_counts
from prf.readings.describe import default_max_range
from prf.readings.ground import chosen_window, seen_cells, thin_beams
from prf.readings.readings import fields_of_view
from prf.readings.way import driven_way
from prf.sampler.continued import Earlier
from prf.sampler.schedules import AUTO_TEMPERATURES, LadderPlan
from prf.sampler.target import Execution, LaserData, PointData, SonarData, Target
from prf.sampler.walls import orientation_of, refuse_with_walls, wall_prior
from prf.shell.errors import ConfigError, InputError

BEAM_DENSITY = 16.0
"""Beams of a dense log a square metre of seen ground."""
MOST_POSED_BEAMS = 100_000
"""Beams up to which all locate uncertain poses, and none is left out."""
DRIVEN_RADIUS = 0.1
"""Metres. Of the disc that was free all along the way where poses are certain; with uncertain ones nothing is taken."""
PIXELS_ACROSS = 500
"""The default resolution is the next of 1, 2, 5, 10 ... that needs no more pixels along the longer side."""
MOST_PIXELS = 4_000_000
"""Each takes some 50 bytes a chain, in memory and in checkpoints."""

LEAST_TILED_SIDE = 60.0
"""Metres: windows that are not longer have no tiles unless a number is given."""
LEAST_TILED_READINGS = 10_000
"""Likewise with fewer readings: chains side by side use the threads as well, and better."""
TILE_SIDE = 40.0
"""Metres: about the side of a tile, if the readings lay evenly."""
MOST_TILES = 32

logger = logging.getLogger(__name__)


class Prepared(NamedTuple):
    """Readings made ready for the sampler."""

    target: Target
    config: Configuration  # resolved: window, resolution and, with a laser, max_range are numbers
    n_outside: int  # readings dropped because their sensor is not inside the window
    n_points_outside: int  # point observations dropped because they do not lie inside the window
    n_beams_thinned: int = 0  # beams inside the window that thinning left out
    counts: BeamCounts | None = None  # of these beams and the others; None without a laser, and of uncertain poses
    earlier: tuple[Earlier, ...] = ()  # of each chain; empty: they start afresh
    before: Mapping[str, Any] = MappingProxyType({})  # what the manifest says of the run that they go on from

    def announce(self) -> None:
        """Warn of readings and points outside the window, and log why not all beams of a dense log are used."""
        if self.n_outside:
            logger.warning(f"{self.n_outside} readings dropped: their sensors are outside the window")
        if self.n_points_outside:
            logger.warning(f"{self.n_points_outside} points dropped: they lie outside the window or on its border")
        if self.n_beams_thinned:
            logger.info(
                f"thinned to about {self.config.thinning.beam_density:.3g} beams a square metre of seen ground, since "
                "more repeat these and slow every step; --set thinning.beam_density=0 keeps all (docs/large-jobs.md)"
            )


def describe_readings(target: Target, n_beams_thinned: int) -> str:
    """Return how many readings of each sensor are used, and the size of the window."""
    laser, sonar, points, window = target.laser, target.sonar, target.points, target.window
    parts = []
    if laser is not None:
        n = laser.readings.n_beams
        parts.append(f"{n:,} of {n + n_beams_thinned:,} beams (thinned)" if n_beams_thinned else f"{n} beams")
    if sonar is not None:
        parts.append(f"{sonar.readings.n_beams} sonar readings")
    if points is not None:
        parts.append(f"{len(points.readings.value)} points")
    return f"{' and '.join(parts)}, window {window.width:.1f} x {window.height:.1f} m"


def read_prepared(
    laser_logs: Sequence[str], config: Configuration, sonar_logs: Sequence[str] = (), point_data: str | None = None
) -> Prepared:
    """Read the logs of a laser and a sonar, thin them, read point observations, and resolve `config` for all these."""
    laser, sonar = read_configured(config, laser_logs, sonar_logs)
    observed = None if point_data is None else read_point_data(point_data)
    return prepare_whole(config, laser, sonar, observed)


def read_configured(
    config: Configuration, laser_logs: Sequence[str], sonar_logs: Sequence[str] = ()
) -> tuple[Readings | None, Readings | None]:
    """Read the logs of a laser and a sonar, of the topics, frame and poses of a configuration; None without a log."""
    return read_logs(
        laser_logs,
        sonar_logs,
        topic=config.readings.topic,
        frame=config.readings.frame,
        sonar_topic=config.readings.sonar_topic,
        cone=config.sonar.cone,
        poses=given_poses(config.readings, config.trajectory.file),
        odometry=config.trajectory.step_noise is not None,
        beam_angles=config.readings.beam_angles,
    )


def given_poses(options: ReadingOptions, odometry: str | None = None) -> list[GivenPoses]:
    """Read the poses of files with how they belong to scans: of one for all logs, of one for each, or none.

    `odometry`: a file of raw odometry. Alone it gives the poses, else their steps.
    """
    how = (options.pose_gap, options.pose_mount, options.pose_offset, options.pose_quaternion)
    poses = [read_poses(file, *how) for file in options.poses]
    if odometry is None:
        return poses
    driven = read_poses(odometry, *how, is_odometry=True)
    return [dataclasses.replace(each, odometry=driven) for each in poses] or [driven]


def with_poses(logs: Sequence[str], config: Configuration) -> list[str]:
    """Return the files that readings are from: the logs, and those of their poses."""
    return [*logs, *config.readings.poses, *filter(None, (config.trajectory.file,))]


def prepare_whole(
    config: Configuration,
    laser: Readings | None,
    sonar: Readings | None,
    observed: PointTable | None,
    least: Window | None = None,
) -> Prepared:
    """Take the chosen scans and beams of whole logs, warn of what would spoil a map, and resolve `config` for them.

    `least` is part of the window.
    """
    kept_laser = _chosen(config, laser, "laser", config.laser.max_range)
    kept_sonar = _chosen(config, sonar, "sonar", config.sonar.max_range)
    if laser is not None and config.laser.max_range is None and math.isfinite(default_max_range(laser)):
        # Of the whole log: what is left after thinning may hold no "no return" at all.
        config = config.replace(max_range=default_max_range(laser))
    driven = [log for log in (laser, sonar) if log is not None] if config.driven.poses == "all" else None
    return prepare(config, kept_laser, kept_sonar, observed, driven, least)


def _chosen(config: Configuration, readings: Readings | None, kind: Kind, max_range: float | None) -> Readings | None:
    if readings is None:
        return None
    kept = thin(readings, **config.readings.selection())
    warn_of_spoiling(readings, kept, kind, max_range)
    return kept


def prepare(
    config: Configuration,
    laser: Readings | None,
    sonar: Readings | None = None,
    observed: PointTable | None = None,
    driven: Sequence[Readings] | None = None,
    least: Window | None = None,
) -> Prepared:
    """Resolve a configuration for the chosen readings of a laser and a sonar, and for points; one at least.

    The way driven is that of the poses of `driven`, or else of these readings. `least` is part of the window.

    Raises
    ------
    InputError
        If no reading is left, or no point.
    ConfigError
        If a parameter is out of its range.
    """
    beams = None if laser is None else _beams(config, laser)
    cones = None if sonar is None else _cones(config, sonar)
    whole = None
    if config.trajectory.is_uncertain and (beams is not None or cones is not None):
        # Refused before scans are aligned, which needs as much memory.
        _window(config, [part for part in (beams, cones) if part is not None], observed, least)
        whole, config = _started(config, beams, cones)
        beams, cones = whole.placed(beams, cones, whole.start)
        driven = [part for part in (beams, cones) if part is not None]
    elif beams is not None:
        warn_of_errors(beams, config.laser.noise)
    sensors = [part for part in (beams, cones) if part is not None]
    window = _window(config, sensors, observed, least)
    n_outside = sum(int((~window.contains(part.origin, strictly=True)).sum()) for part in sensors)
    rows, cone_rows = _rows_inside(beams, window), _rows_inside(cones, window)
    inside, kept_cones = _chosen_rows(beams, rows), _chosen_rows(cones, cone_rows)
    share = None
    if inside is not None:
        kept, share, config = _thinned(config, inside, window)
        rows = rows[kept]
    kept_beams = _chosen_rows(beams, rows)
    if kept_beams is not None and share is not None:
        kept_beams = dataclasses.replace(kept_beams, share=share)
    if sensors and kept_beams is None and kept_cones is None:
        source = " and ".join(log.source for log in (laser, sonar) if log is not None)
        raise InputError(f"{source}: no sensor stands inside the window. Check --window.")
    points = None if observed is None else _points(config, observed, window)
    resolved = _resolved(config, window, kept_beams, kept_cones, points)
    if driven is None:
        driven = [log for log in (laser, sonar) if log is not None]
    target = make_target(resolved, kept_beams, kept_cones, points)
    assert target.execution.resolution is not None
    target = dataclasses.replace(
        target,
        way=driven_way(resolved.driven.radius or 0.0, driven, sensors, window),
        seen=seen_cells(window, target.execution.resolution, inside, kept_cones, points),
        poses=None if whole is None else whole.used(rows, cone_rows),
    )
    n_points_outside = 0 if observed is None or points is None else len(observed.value) - len(points.value)
    n_thinned = 0 if inside is None or kept_beams is None else len(inside.range) - len(kept_beams.range)
    counts = None if inside is None or whole is not None else beam_counts(window, inside)
    return Prepared(target, resolved, n_outside, n_points_outside, n_thinned, counts)


def _resolved(
    config: Configuration, window: Window, beams: Readings | None, cones: Readings | None, points: PointTable | None
) -> Configuration:
    """Return the configuration with all that is chosen by the readings."""
    n_readings = sum(len(part.range) for part in (beams, cones) if part is not None)
    changes: dict[str, Any] = {
        "window": window,
        "resolution": config.sampler.resolution or chosen_resolution(window),
        "start": config.sampler.start or ("empty" if beams is None else "grid"),
    }
    if config.driven.radius is None:
        changes["driven_radius"] = 0.0 if config.trajectory.is_uncertain else DRIVEN_RADIUS
    if config.prior.is_walls:
        refuse_with_walls(config)
        changes["tiles"] = 0
    elif config.sampler.tiles is None:
        is_whole = config.sampler.is_tempered or config.trajectory.is_uncertain
        changes["tiles"] = 0 if is_whole else chosen_tiles(window, n_readings)
    if beams is not None:
        changes["max_range"] = beams.max_range
    if points is not None:
        model = resolved_points(config.points, points.value)
        changes |= {"points_kind": model.kind, "points_sigma": model.sigma}
    if changes["start"] == "grid" and beams is None:
        raise ConfigError("sampler.start grid: needs the readings of a laser. Choose another start.")
    return config.replace(**changes)


def _window(
    config: Configuration, sensors: Sequence[Readings], observed: PointTable | None, least: Window | None
) -> Window:
    """Return the window requested, or one round sensors, returns and `least`, or round points without sensors."""
    if config.prior.window is None and observed is not None and not sensors:
        return window_round(observed.xy).joined(least)
    return chosen_window(config.prior.window, sensors, config.prior.scale).joined(least)


def _beams(config: Configuration, readings: Readings) -> Readings:
    """Return the laser readings, inf where there was no return below the maximum range."""
    max_range = config.laser.max_range or default_max_range(readings)
    if not math.isfinite(max_range):
        raise InputError(f"{readings.source}: no reading has a finite range. Give --max-range.")
    return readings.within(max_range)


def _cones(config: Configuration, readings: Readings) -> Readings:
    """Return the sonar readings, inf where there was no return below the maximum range."""
    view = fields_of_view(readings, config.sonar.cone)
    return dataclasses.replace(readings, cone=view).within(config.sonar.max_range)


def _points(config: Configuration, observed: PointTable, window: Window) -> PointTable:
    """Return the point observations inside the window."""
    if config.points.kind == "binary":
        observed.refuse_other_than_colours()
    inside = observed.inside(window)
    if len(inside.value) == 0:
        raise InputError(f"{observed.source}: no point lies inside the window. Check --window.")
    return inside


def _rows_inside(readings: Readings | None, window: Window) -> NDArray[np.int64]:
    """Return which readings have their sensor inside the window."""
    return np.flatnonzero([] if readings is None else window.contains(readings.origin, strictly=True))


def _chosen_rows(readings: Readings | None, rows: NDArray[np.int64]) -> Readings | None:
    """Return these readings; None if there are none."""
    if readings is None or len(rows) == 0:
        return None
    return readings if len(rows) == len(readings.range) else readings.select(rows)


def _thinned(
    config: Configuration, beams: Readings, window: Window
) -> tuple[NDArray[np.int64], NDArray[np.float64], Configuration]:
    """Return which beams thinning keeps, what share of such as each, and the configuration with its density."""
    if config.thinning.beam_density is None:
        is_few = config.trajectory.is_uncertain and beams.n_beams <= MOST_POSED_BEAMS
        config = config.replace(beam_density=0.0 if is_few else BEAM_DENSITY)
    density = config.thinning.beam_density or 0.0
    return *thin_beams(window, beams.origin, beams.angle, beams.range, beams.max_range, density), config


def _started(config: Configuration, beams: Readings | None, cones: Readings | None) -> tuple[PoseModel, Configuration]:
    """Return the uncertain poses of all readings, with where they start, and the configuration that says how they err.

    It has the weight of a beam too, as the scans show it where poses start.
    """
    if config.sampler.is_tempered or config.sampler.tiles:
        raise ConfigError("uncertain poses: their chains have neither tiles nor temperatures. Leave these out.")
    n_logs = [len(part.names) for part in (beams, cones) if part is not None]
    if config.trajectory.step_noise is not None and max(n_logs) > 1:
        raise ConfigError(
            "odometry: nothing says how the odometry of one log lies to that of another. Give poses in one frame."
        )
    noise = pose_noise(config.trajectory.pose_noise, beams, config.laser.noise)
    found = pose_model(beams, cones, noise, config.trajectory.step_noise)
    if beams is None:
        draw = None if len(found.prior.motion) else lambda rng, sign, way, report: found.prior.draw(rng, sign)
        model, weight = dataclasses.replace(found, draw_start=draw), 1.0
    else:
        start = find_start(found, beams, config.laser.noise)
        model, weight = start.model, min(1.0, start.independence)
    return model, config.replace(
        beam_weight=config.laser.beam_weight or weight,
        pose_noise=None if noise is None else model.prior.noise[0].tolist(),
        odometry_noise=model.odometry,
    )


def ladder_plan(config: Configuration) -> LadderPlan:
    """Return the temperature ladder requested."""
    temperatures, lowest = config.sampler.temperatures, config.sampler.lowest_inverse_temperature
    if lowest == 0.0 and config.prior.free_space > 0.0:
        raise ConfigError(
            "sampler.lowest_inverse_temperature = 0: the hottest chain would need exact draws of the prior, which "
            "prior.free_space does not have. Give a power above 0."
        )
    if isinstance(temperatures, str):
        return LadderPlan(AUTO_TEMPERATURES, lowest, waits=True)
    return LadderPlan(temperatures, lowest)


def make_target(
    config: Configuration, beams: Readings | None, cones: Readings | None = None, points: PointTable | None = None
) -> Target:
    """Return the target of a resolved configuration and its readings and points."""
    assert config.prior.window is not None
    assert config.sampler.resolution is not None
    window, resolution = Window.checked(*config.prior.window), config.sampler.resolution
    if window.area / resolution**2 > MOST_PIXELS:
        raise ConfigError(f"--resolution {resolution}: more than {MOST_PIXELS} pixels. Give a larger one.")
    return Target(
        window,
        config.prior.scale,
        laser=None if beams is None else LaserData(beams, config.laser),
        sonar=None if cones is None else SonarData(cones, config.sonar),
        points=None if points is None else PointData(points, config.points),
        driven_radius=config.driven.radius or 0.0,
        orientation=orientation_of(config.prior),
        free_space=config.prior.free_space,
        walls=wall_prior(config.prior),
        execution=Execution(resolution=resolution, tiles=config.sampler.tiles or 0),
    )


def chosen_resolution(window: Window) -> float:
    """Return a round resolution that fits the window, metres."""
    least = max(window.width, window.height) / PIXELS_ACROSS
    decade = 10.0 ** math.floor(math.log10(least))
    return float(next(round(step * decade, 12) for step in (1, 2, 5, 10) if step * decade >= least))


def chosen_tiles(window: Window, n_readings: int) -> int:
    """Return the number of tiles that is used unless one is given; 0: none."""
    if max(window.width, window.height) <= LEAST_TILED_SIDE or n_readings < LEAST_TILED_READINGS:
        return 0
    return min(MOST_TILES, max(4, round(window.area / TILE_SIDE**2)))
