"""What each key of a settings file means, for whoever reads or writes one (docs/configuration.md says the same)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class Words(NamedTuple):
    """Unit (empty for a plain number) and meaning of a key."""

    unit: str
    meaning: str

    def __str__(self) -> str:
        """Return both as they stand in a comment."""
        return f"[{self.unit}] {self.meaning}" if self.unit else self.meaning


TABLE_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "prior": "The Arak process over maps",
        "laser": "Density of a laser reading (docs/laser-model.md)",
        "sonar": "Density of a sonar reading (docs/sonar-model.md)",
        "points": "Density of a point observation (docs/point-data.md)",
        "thinning": "Which beams of a dense log are used (docs/thinning.md)",
    }
)
KEY_WORDS: Mapping[str, Words] = MappingProxyType(
    {
        "prior.scale": Words("1/m", "scale parameter p; the expected length of edges is pi p a square metre"),
        "prior.window": Words("m", "x_min, y_min, x_max, y_max"),
        "laser.max_range": Words("m", "no return from here on"),
        "laser.noise": Words("m", "standard deviation of a range"),
        "laser.noise_relative": Words("", "the same as a share of the distance; the larger of the two counts"),
        "laser.outlier_probability": Words("", "share of stray readings, above 0"),
        "laser.miss_probability": Words("", "share of no returns from a wall in reach"),
        "sonar.max_range": Words("m", "no return from here on"),
        "sonar.noise": Words("m", "standard deviation of a range"),
        "sonar.noise_relative": Words("", "the same as a share of the distance; the larger of the two counts"),
        "sonar.corner_bias": Words("", "log odds that a corner at no distance returns the pulse"),
        "sonar.corner_distance": Words("1/m", "loss of these log odds with distance"),
        "sonar.surface_bias": Words("", "log odds that a surface at no distance, face on, returns the pulse"),
        "sonar.surface_distance": Words("1/m", "loss of these log odds with distance"),
        "sonar.surface_oblique": Words("1/rad", "loss away from face on"),
        "sonar.surface_subtended": Words("1/rad", "gain with the angle that the surface fills"),
        "sonar.uniform_probability": Words("", "of readings that no feature returned: share uniform up to the maximum"),
        "sonar.short_probability": Words("", "of readings that no feature returned: share of short ones"),
        "sonar.short_length": Words("m", "mean of the short ones"),
        "sonar.cone": Words("rad", "full field of view, where the log has none"),
        "points.kind": Words("", "gaussian, or binary: the colour itself, 1 for black, perhaps flipped"),
        "points.mean_black": Words("", "gaussian: mean of the values in black, in their unit"),
        "points.mean_white": Words("", "gaussian: mean of the values in white"),
        "points.sigma": Words("", "gaussian: standard deviation round the mean"),
        "points.flip_probability": Words("", "binary: share of values that tell the other colour, below 0.5"),
        "thinning.beam_density": Words("1/m²", "beams of a laser a square metre of seen ground, about; 0: all of them"),
    }
)
