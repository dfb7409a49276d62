"""The parameters of a segmentation, estimated from the scale of the cloud unless they are given."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import turn
from mapq.configuration import SegmentSettings
from mapq.segmentation.points import Points
from mapq.segmentation.scale import Scale, cell_side, find_scale

DISTANCE_IN_NOISE = 3.0
DISTANCE_IN_SPACING = 0.1
"""Where there is no noise: surfaces are not flat to within less than a tenth of what the points resolve."""
GAP_IN_SPACING = 4.0
"""Of 16 neighbours at random on a surface the last is 2.3 spacings away; a gap of 4 is a gap in 1 of 10 000 places."""
ANGLE_BASE, ANGLE_PER_ERROR = 8.0, 4.0
ANGLE_RANGE = (10.0, 30.0)
MAX_VARIATION = 0.1
EXTENT_IN_SPACING = 5.0


class Parameters(NamedTuple):
    """What a segmentation uses: metres and degrees; see :class:`SegmentSettings` and :class:`Scale` for the words."""

    level: int
    resolution: float
    spacing: float
    noise: float
    flat_share: float
    narrow_share: float
    neighbours: int
    max_angle: float
    max_distance: float
    max_gap: float
    max_variation: float
    min_points: int
    min_extent: float
    max_tilt: float
    up: NDArray[np.float64]

    def described(self, quarter: int) -> dict[str, Any]:
        """Return them as :class:`mapq.patches.Patches` keeps them, in the axes before these quarter turns."""
        values = {**self._asdict(), "up": turn(self.up, -quarter).tolist()}
        del values["level"]
        return values


def choose_parameters(points: Points, settings: SegmentSettings, quarter: int) -> Parameters:
    """Return all parameters: those given, the others from spacing and noise of points turned by so many quarters."""
    x, y, z = turn(np.array(settings.up, np.float64), quarter).tolist()
    settings = settings.replace(up=(x, y, z))
    scale = find_scale(points, settings)
    noise = _given(settings.noise, scale.noise)
    max_distance = max(DISTANCE_IN_NOISE * noise, DISTANCE_IN_SPACING * scale.spacing)
    return Parameters(
        level=scale.level,
        resolution=cell_side(points, scale.level),
        spacing=scale.spacing,
        noise=noise,
        flat_share=scale.flat_share,
        narrow_share=scale.narrow_share,
        neighbours=settings.neighbours,
        max_angle=_given(settings.max_angle, _angle(scale, noise, settings.neighbours)),
        max_distance=_given(settings.max_distance, max_distance),
        max_gap=_given(settings.max_gap, GAP_IN_SPACING * scale.wide_spacing),
        max_variation=_given(settings.max_variation, MAX_VARIATION),
        min_points=settings.min_points,
        min_extent=_given(settings.min_extent, EXTENT_IN_SPACING * scale.spacing),
        max_tilt=settings.max_tilt,
        up=np.asarray(settings.up, np.float64) / float(np.linalg.norm(settings.up)),
    )


def _given(value: float | None, estimate: float) -> float:
    return float(estimate if value is None else value)


def _angle(scale: Scale, noise: float, n_neighbours: int) -> float:
    """Return an angle that the noise of normals does not reach.

    A plane through n points within r is good to noise / (r / 2 * sqrt(n)).
    """
    radius = scale.spacing * np.sqrt(n_neighbours / np.pi)
    error = np.degrees(noise / max(0.5 * radius * np.sqrt(n_neighbours + 1), np.finfo(float).tiny))
    return float(np.clip(ANGLE_BASE + ANGLE_PER_ERROR * error, *ANGLE_RANGE))
