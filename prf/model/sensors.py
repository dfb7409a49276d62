"""Parameters of the sensors' densities, tables of the settings, and their bounds: without numpy, so that help is quick.

Beyond the bounds doubles overflow, or a density has no logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

from prf.shell.cli.settings import SettingError, Table, key

LARGEST_COORDINATE = 1e8
"""Metres. Beyond any projected map (1e7), and small enough that millimetres survive in double precision."""
LARGEST_RANGE = 1e6
"""Metres. Beyond any sensor, and far below what drivers write for no return, such as the largest float."""

MOST_ORIENTATION = 10.0
"""Up to which the laws of lines that prefer directions are computed to eight digits."""

MIN_LENGTH = 1e-9  # metres, far below what any sensor resolves
MAX_FACTOR = 1e6  # of log odds, of their slopes and of noise as a share of the distance
MIN_PROBABILITY = 1e-100
LENGTH: dict[str, Any] = {"ge": MIN_LENGTH, "le": LARGEST_RANGE}
FACTOR: dict[str, Any] = {"ge": -MAX_FACTOR, "le": MAX_FACTOR}
"""Constraints of such fields of a table."""


def window_fault(bounds: Sequence[float]) -> str:
    """Return in words what is wrong with bounds x_min, y_min, x_max, y_max of a window; empty if nothing is."""
    if not all(math.isfinite(bound) for bound in bounds):
        return "every bound must be finite. Give X0 Y0 X1 Y1 in metres"
    if max(map(abs, bounds)) > LARGEST_COORDINATE:
        return f"a bound lies beyond {LARGEST_COORDINATE:g} m. Use a local origin"
    return "" if bounds[0] < bounds[2] and bounds[1] < bounds[3] else "needs X0 < X1 and Y0 < Y1"


CONE = 0.349
"""Radians. Full opening angle of a sonar whose log has none: 20 degrees."""

NOISE_RELATIVE = "the same as a share of the distance; the larger of the two counts"


class LaserModel(Table):
    """Density of a laser reading given the distance to the first obstacle (docs/sensor-models.md)."""

    max_range: float | None = key(
        None,
        "m",
        "range of a laser from which on there is no return",
        flag="METRES",
        unset="0.97 x the largest range",
        **LENGTH,
    )
    noise: float = key(0.03, "m", "standard deviation of a range", flag="METRES", **LENGTH)
    noise_relative: float = key(0.01, "", NOISE_RELATIVE, flag="SHARE", ge=0.0, le=FACTOR["le"])
    outlier_probability: float = key(0.05, "", "share of outliers, above 0", flag="SHARE", ge=MIN_PROBABILITY, lt=1.0)
    miss_probability: float = key(0.02, "", "share of no returns from a wall in range", flag="SHARE", ge=0.0, lt=1.0)

    beam_weight: float | None = key(
        None,
        "",
        "independent readings that a beam counts as, at most 1",
        unset="1; with uncertain poses as few as its neighbours on a wall err together",
        gt=0.0,
        le=1.0,
    )

    def check(self) -> None:
        """Refuse weights that leave nothing for hits."""
        if self.outlier_probability + self.miss_probability >= 1.0:
            names = ("outlier_probability", "miss_probability")
            raise SettingError("outlier and miss probability must sum to less than 1", *names)

    @property
    def limit(self) -> float:
        """The maximum range, metres, which the log has given where the settings do not."""
        assert self.max_range is not None
        return self.max_range

    @property
    def weight(self) -> float:
        """The beam weight, which the readings have given where the settings do not."""
        return 1.0 if self.beam_weight is None else self.beam_weight

    @property
    def hit_probability(self) -> float:
        """Weight of the Gaussian round the distance to the first obstacle."""
        return 1.0 - self.outlier_probability - self.miss_probability

    def deviation_where_hits_are(self, share: float) -> float:
        """Return the standard deviations past which the Gaussian is below `share` of the uniform density."""
        return math.sqrt(2.0 * max(0.0, self.log_peak - math.log(share)))

    @property
    def log_peak(self) -> float:
        """Log of the highest ratio of the Gaussian to the uniform density."""
        highest = 2.0 * self.hit_probability / (self.noise * math.sqrt(2.0 * math.pi))
        return math.log(highest / (self.outlier_probability / self.limit))

    @property
    def is_wide(self) -> bool:
        """Whether much of the noise may lie below 0 or beyond the maximum range, where it is cut off."""
        return self.limit < 20.0 * max(self.noise, self.noise_relative * self.limit)


class SonarModel(Table):
    """Density of a sonar reading given the surfaces and corners in its cone (docs/sensor-models.md)."""

    # The defaults suit the Polaroid ring of a Pioneer indoors.
    max_range: float = key(3.5, "m", "range of a sonar from which on there is no return", flag="METRES", **LENGTH)
    noise: float = key(0.03, "m", "standard deviation of a range", **LENGTH)
    noise_relative: float = key(0.02, "", NOISE_RELATIVE, ge=0.0, le=FACTOR["le"])
    corner_bias: float = key(1.0, "", "log odds that a corner at distance 0 returns the pulse", **FACTOR)
    corner_distance: float = key(0.5, "1/m", "loss of these log odds with distance", **FACTOR)
    surface_bias: float = key(2.4, "", "log odds that a surface at distance 0, face on, returns the pulse", **FACTOR)
    surface_distance: float = key(0.5, "1/m", "loss of these log odds with distance", **FACTOR)
    surface_oblique: float = key(16.0, "1/rad", "loss away from face on", **FACTOR)
    surface_subtended: float = key(6.0, "1/rad", "gain with the angle that the surface fills", **FACTOR)
    uniform_probability: float = key(
        0.2, "", "of readings that no feature returned: share uniform up to the maximum", ge=MIN_PROBABILITY, lt=1.0
    )
    short_probability: float = key(
        0.05, "", "of readings that no feature returned: share of short ones", ge=0.0, lt=1.0
    )
    short_length: float = key(0.5, "m", "mean of the short ones", **LENGTH)
    cone: float = key(
        CONE, "rad", "full field of view of a sonar, where the log has none", flag="RAD", gt=0.0, lt=math.pi
    )

    def check(self) -> None:
        """Refuse shares that leave nothing for no return."""
        if self.short_probability + self.uniform_probability >= 1.0:
            names = ("short_probability", "uniform_probability")
            raise SettingError("short and uniform probability must sum to less than 1", *names)


class PointModel(Table):
    """Density of a value given the colour of the map at its place (docs/sensor-models.md)."""

    kind: Literal["gaussian", "binary"] | None = key(
        None, "", "gaussian, or binary: the colour itself, 1 for black, perhaps flipped"
    )
    mean_black: float = key(1.0, "", "gaussian: mean of the values in black, in their unit")
    mean_white: float = key(0.0, "", "gaussian: mean of the values in white")
    sigma: float | None = key(None, "", "gaussian: standard deviation round the mean", gt=0.0)
    flip_probability: float = key(
        0.1, "", "binary: share of values that report the other colour, below 0.5", gt=0.0, lt=0.5
    )

    def check(self) -> None:
        """Refuse colours that no value can tell apart."""
        if self.mean_black == self.mean_white:
            raise SettingError(
                f"mean_black and mean_white are both {self.mean_black}; they must differ", "mean_black", "mean_white"
            )
