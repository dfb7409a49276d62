"""What a user may ask of an occupancy grid."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Configuration, flat_name
from prf.logs import CONE
from prf.sensors.sonar import SonarModel
from prf.shell.errors import ConfigError
from prf.shell.settings import Loaded


@dataclasses.dataclass(frozen=True)
class GridConfig:
    """What a user may ask of a grid; None is resolved from the logs. Units: metres, radians."""

    # whether cells count hits and misses (Beta(0.5, 0.5) before the first), or add clamped log odds
    method: Literal["count", "log-odds"] = "count"
    resolution: float = 0.1  # side of a cell
    window: tuple[float, float, float, float] | None = None  # x_min, y_min, x_max, y_max; rounded up to whole cells
    # laser readings at or above it are no returns; default 0.97 of the log's largest range
    max_range: float | None = None
    # whether a laser beam without return says that all cells up to the maximum range are free, or nothing, since
    # scanners answer glass and black walls in the same way. A sonar cone always says free
    no_return: Literal["free", "ignore"] = "ignore"
    # hit_probability, miss_probability: probability that a cell is occupied given one hit, or one miss (log-odds)
    hit_probability: float = 0.7
    miss_probability: float = 0.4
    clamp: float = 3.5  # log odds stay within plus and minus this (log-odds)
    # sonar_max_range, sonar_cone: as `max_range`; full opening angle of readings that have none of their own
    sonar_max_range: float = SonarModel.max_range
    sonar_cone: float = CONE
    sonar_thickness: float = 0.2  # depth of the arc in which a sonar reading puts its obstacle
    # topic, sonar_topic, frame: whose readings to take of each log, and in what frame (:func:`prf.logs.read_readings`)
    topic: str | None = None
    sonar_topic: str | None = None
    frame: str | None = None
    every_scan: int = 1
    every_beam: int = 1
    # scans, skip_scans: as in :func:`prf.logs.thin`, for each log
    scans: str | None = None
    skip_scans: str | None = None

    def __post_init__(self) -> None:
        """Refuse values out of their range, naming the option."""
        lengths = ("resolution", "clamp", "sonar_max_range", "sonar_cone", "sonar_thickness")
        positive = [*lengths, *(["max_range"] if self.max_range is not None else [])]
        for name in positive:
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{_flag(name)} {getattr(self, name)}: must be a positive number.")
        if not 0.5 < self.hit_probability < 1.0:
            raise ConfigError(f"--hit-probability {self.hit_probability}: must lie between 0.5 and 1.")
        if not 0.0 < self.miss_probability < 0.5:
            raise ConfigError(f"--miss-probability {self.miss_probability}: must lie between 0 and 0.5.")
        if self.sonar_cone > math.pi:
            raise ConfigError(f"--sonar-cone {self.sonar_cone}: at most pi (radians).")

    def steps(self) -> NDArray[np.float64]:
        """Return the changes of log odds as the kernels take them, (4,)."""
        return np.array([_log_odds(self.hit_probability), _log_odds(self.miss_probability), -self.clamp, self.clamp])


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


USED = ("prior.window", "laser.max_range", "sonar.max_range", "sonar.cone", "readings.", "grid.")
"""What a grid takes of a configuration: its inverse models share no other parameter with the sensors' densities."""


def grid_sources(loaded: Loaded[Configuration]) -> dict[str, str]:
    """Return what has set which value of a grid's settings."""
    return {flat_name(place): source for place, source in loaded.sources.items() if place.startswith(USED)}


def grid_config(configuration: Configuration) -> GridConfig:
    """Return what a configuration asks of a grid."""
    flat = {**configuration.flat(), **configuration.grid.model_dump()}
    return GridConfig(**{field.name: flat[field.name] for field in dataclasses.fields(GridConfig)})
