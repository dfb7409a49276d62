"""What a user may ask of a run, and what it comes to for a given log."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.arak import checked_scale
from prf.logs import Readings
from prf.logs.describe import default_max_range
from prf.posterior import LaserData, Settings
from prf.run import Beams
from prf.sensors.laser import LaserModel
from prf.shell.errors import ConfigError, InputError
from prf.window import Window

KEPT_RETURNS = 0.995
"""Share of the returns that the default window holds at least."""
MARGIN = 1.0
"""Metres between them and the border of the default window."""
PIXELS_ACROSS = 500
"""The default resolution is the next of 1, 2, 5, 10 ... that needs no more pixels along the longer side."""
MOST_PIXELS = 4_000_000
"""Each takes some 50 bytes a chain, in memory and in checkpoints."""


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
    every_scan, every_beam : int
    scans, skip_scans : str or None
        START:STOP:STEP.
    chains : int
    resolution : float or None
        Side of the squares of the occupancy image.
    """

    scale: float = 0.1
    window: tuple[float, float, float, float] | None = None
    max_range: float | None = None
    noise: float = 0.03
    noise_relative: float = 0.01
    outlier_probability: float = 0.05
    miss_probability: float = 0.02
    every_scan: int = 1
    every_beam: int = 1
    scans: str | None = None
    skip_scans: str | None = None
    chains: int = 4
    resolution: float | None = None

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> SampleConfig:
        """Return the configuration that a manifest holds."""
        window = values.get("window")
        return cls(**{**values, "window": tuple(window) if window is not None else None})


class Prepared(NamedTuple):
    """A log made ready for the sampler.

    Attributes
    ----------
    settings : Settings
    beams : Beams
        The readings that are used.
    config : SampleConfig
        Resolved: window, max_range and resolution are numbers.
    n_outside : int
        Readings dropped because their sensor does not stand inside the window.
    """

    settings: Settings
    beams: Beams
    config: SampleConfig
    n_outside: int


def prepare(config: SampleConfig, readings: Readings) -> Prepared:
    """Resolve a configuration for the readings (thinned already) of a log.

    Raises
    ------
    InputError
        If no reading is left.
    ConfigError
        If a parameter is out of its range.
    """
    max_range = config.max_range if config.max_range is not None else default_max_range(readings)
    if config.max_range is None and not math.isfinite(max_range):
        raise InputError(f"{readings.source}: no reading has a finite range. Give --max-range.")
    model = LaserModel(
        max_range, config.noise, config.noise_relative, config.outlier_probability, config.miss_probability
    )
    ranges = np.where(readings.range < max_range, readings.range, np.inf)
    window = chosen_window(config, readings.origin, readings.angle, ranges)
    inside = window.contains(readings.origin, strictly=True)
    if not inside.any():
        raise InputError(f"{readings.source}: no sensor stands inside the window. Check --window.")
    origin, angle = readings.origin[inside], readings.angle[inside]
    beams = Beams(origin, angle, ranges[inside], readings.scan[inside], max_range)
    resolution = config.resolution if config.resolution is not None else chosen_resolution(window)
    resolved = dataclasses.replace(config, window=(*window,), max_range=max_range, resolution=resolution)
    return Prepared(make_settings(resolved, beams, model), beams, resolved, int((~inside).sum()))


def make_settings(config: SampleConfig, beams: Beams, model: LaserModel | None = None) -> Settings:
    """Return the settings of a resolved configuration and its beams.

    Raises
    ------
    ConfigError
        If the resolution is no positive number or asks for too many pixels.
    """
    assert config.window is not None
    assert config.max_range is not None
    assert config.resolution is not None
    if model is None:
        model = LaserModel(
            config.max_range,
            config.noise,
            config.noise_relative,
            config.outlier_probability,
            config.miss_probability,
        )
    window = Window.checked(*config.window)
    if not (math.isfinite(config.resolution) and config.resolution > 0.0):
        raise ConfigError(f"--resolution {config.resolution}: must be a positive number of metres")
    if window.area / config.resolution**2 > MOST_PIXELS:
        raise ConfigError(f"--resolution {config.resolution}: more than {MOST_PIXELS} pixels. Give a larger one.")
    laser = LaserData(beams.origin, beams.angle, beams.range, model)
    return Settings(window, checked_scale(config.scale), laser, resolution=config.resolution)


def chosen_window(
    config: SampleConfig, origin: NDArray[np.float64], angle: NDArray[np.float64], ranges: NDArray[np.float64]
) -> Window:
    """Return the window asked for, or one round all sensors and 99.5 % of the returns."""
    if config.window is not None:
        return Window.checked(*config.window)
    hit = np.isfinite(ranges)
    ends = origin[hit] + ranges[hit, None] * np.stack([np.cos(angle[hit]), np.sin(angle[hit])], axis=1)
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
