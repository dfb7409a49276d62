"""What each key of a settings file means, for whoever reads or writes one (docs/configuration.md says the same)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from prf.shell.configuration import Meaning

TABLE_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "prior": "The Arak process over maps",
        "laser": "Density of a laser reading (docs/laser-model.md)",
        "sonar": "Density of a sonar reading (docs/sonar-model.md)",
        "points": "Density of a point observation (docs/point-data.md)",
        "thinning": "Which beams of a dense log are used (docs/thinning.md)",
    }
)
KEY_WORDS: Mapping[str, Meaning] = MappingProxyType(
    {
        "prior.scale": Meaning("1/m", "scale parameter p; the expected length of edges is pi p a square metre"),
        "prior.window": Meaning("m", "x_min, y_min, x_max, y_max"),
        "laser.max_range": Meaning("m", "no return from here on"),
        "laser.noise": Meaning("m", "standard deviation of a range"),
        "laser.noise_relative": Meaning("", "the same as a share of the distance; the larger of the two counts"),
        "laser.outlier_probability": Meaning("", "share of stray readings, above 0"),
        "laser.miss_probability": Meaning("", "share of no returns from a wall in reach"),
        "sonar.max_range": Meaning("m", "no return from here on"),
        "sonar.noise": Meaning("m", "standard deviation of a range"),
        "sonar.noise_relative": Meaning("", "the same as a share of the distance; the larger of the two counts"),
        "sonar.corner_bias": Meaning("", "log odds that a corner at no distance returns the pulse"),
        "sonar.corner_distance": Meaning("1/m", "loss of these log odds with distance"),
        "sonar.surface_bias": Meaning("", "log odds that a surface at no distance, face on, returns the pulse"),
        "sonar.surface_distance": Meaning("1/m", "loss of these log odds with distance"),
        "sonar.surface_oblique": Meaning("1/rad", "loss away from face on"),
        "sonar.surface_subtended": Meaning("1/rad", "gain with the angle that the surface fills"),
        "sonar.uniform_probability": Meaning(
            "", "of readings that no feature returned: share uniform up to the maximum"
        ),
        "sonar.short_probability": Meaning("", "of readings that no feature returned: share of short ones"),
        "sonar.short_length": Meaning("m", "mean of the short ones"),
        "sonar.cone": Meaning("rad", "full field of view, where the log has none"),
        "points.kind": Meaning("", "gaussian, or binary: the colour itself, 1 for black, perhaps flipped"),
        "points.mean_black": Meaning("", "gaussian: mean of the values in black, in their unit"),
        "points.mean_white": Meaning("", "gaussian: mean of the values in white"),
        "points.sigma": Meaning("", "gaussian: standard deviation round the mean"),
        "points.flip_probability": Meaning("", "binary: share of values that tell the other colour, below 0.5"),
        "thinning.beam_density": Meaning(
            "1/m²", "beams of a laser a square metre of seen ground, about; 0: all of them"
        ),
    }
)
