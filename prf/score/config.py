"""What a user may ask of a score."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

from prf.configuration import Configuration
from prf.logs import CONE
from prf.sensors.sonar import SonarModel
from prf.shell.errors import ConfigError
from prf.window import LARGEST_RANGE

SQUARE = 0.2
"""Side in metres of the squares that every kind of map is asked for: a point on a wall has no colour."""


@dataclasses.dataclass(frozen=True)
class ScoreConfig:
    """How to score. Units: metres, radians."""

    # laser readings at or above it are no returns and are not scored; default 0.97 of the log's largest range
    max_range: float | None = None
    # noise, noise_relative, outlier_probability, miss_probability: see :class:`prf.sensors.laser.LaserModel`
    noise: float = 0.05
    noise_relative: float = 0.0
    outlier_probability: float = 0.05
    miss_probability: float = 0.0
    # sonar readings at or above its maximum range are no returns; they are scored
    sonar: SonarModel = dataclasses.field(default_factory=SonarModel)
    sonar_cone: float = CONE  # full field of view of sonars whose log has none
    # side of the square round a held-out point that a map is asked for; 0: the point itself, of a GRID its cell
    square: float = SQUARE
    every_scan: int = 1
    every_beam: int = 1
    # scans, skip_scans: as in :func:`prf.logs.thin`, of both logs
    scans: str | None = None
    skip_scans: str | None = None

    def __post_init__(self) -> None:
        """Refuse squares that have no side."""
        if not 0.0 <= self.square <= LARGEST_RANGE:
            raise ConfigError(f"square {self.square}: must be a number of metres from 0 to {LARGEST_RANGE:g}")


SCORE_DEFAULTS: Mapping[str, float] = MappingProxyType(
    {"laser.noise": 0.05, "laser.noise_relative": 0.0, "laser.miss_probability": 0.0}
)
"""Of a configuration by which maps are scored, where they differ from those of a sampler."""


def score_config(configuration: Configuration, square: float = SQUARE) -> ScoreConfig:
    """Return what a configuration asks of a score."""
    chosen = configuration.readings
    return ScoreConfig(
        **configuration.laser.model_dump(),
        sonar=configuration.sonar.model(),
        sonar_cone=configuration.sonar.cone,
        square=square,
        every_scan=chosen.every_scan,
        every_beam=chosen.every_beam,
        scans=chosen.scans,
        skip_scans=chosen.skip_scans,
    )
