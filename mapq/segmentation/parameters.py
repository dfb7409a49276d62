"""The parameters of a segmentation, estimated from the scale of the cloud unless they are given."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import turn
from mapq.configuration import SegmentSettings
from mapq.kernels.cells import LEVELS, pick_one_a_cell
from mapq.patches import STEEP
from mapq.segmentation.points import LARGE_SAMPLE, SAMPLE, Points, Sample, look_at, usual_noise
from prf.shell.errors import InputError

ENOUGH_FLAT, FEW_LINES, NEARLY_BEST = 0.5, 0.05, 0.9
"""Shares of neighbourhoods: with so many that show a plane and so few that are too narrow no coarser level is looked
at; else the finest level nearly as good as the best one is taken."""
FEWEST = 200
"""Representatives below which a level is too coarse to try."""
COARSEST = 8.0
"""Times the spacing of all points: coarser levels are not tried, as anything looks flat from far enough away. Lines of
a scanner may be the square of this times as far apart as the points along them."""
MARGIN = 15.0
"""Degrees by which a neighbourhood may be farther from vertical than upright planes, to count as theirs."""
FARTHEST_APART = 5.0
"""Metres between points from which on a cloud is in another unit: nobody judges surfaces by points so far apart."""
ENOUGH = 100
"""Flat neighbourhoods of the sample from which on they alone determine spacing and noise."""


class Scale(NamedTuple):
    """What the estimates found."""

    level: int  # of the octree: one point of each cell is looked at first. LEVELS + 1: every point.
    spacing: float  # metres between points as if on a square grid, median over the sample
    wide_spacing: float  # its 90th percentile
    noise: float  # standard deviation in metres across surfaces
    flat_share: float  # share of the sample whose neighbourhoods show a plane
    narrow_share: float  # and that are too narrow to show one


def find_scale(points: Points, settings: SegmentSettings) -> Scale:
    """Return the scale at which a cloud shows its planes: the finest one where most neighbourhoods do.

    Points on scan lines far apart, or denser than their noise, show planes only when they are thinned out.
    """
    if settings.resolution is not None:
        return measure(points, level_of(points, settings.resolution), settings, LARGE_SAMPLE)
    finest = measure(points, LEVELS + 1, settings, LARGE_SAMPLE)
    if shows_planes(finest):
        return finest
    return measure(points, find_level(points, settings, finest), settings, LARGE_SAMPLE)


def shows_planes(scale: Scale) -> bool:
    """Return whether a level shows planes well enough to look at no coarser one."""
    return scale.flat_share >= ENOUGH_FLAT and scale.narrow_share <= FEW_LINES


def find_level(points: Points, settings: SegmentSettings, finest: Scale) -> int:
    """Return the level of that scale, by small samples of the levels coarser than the finest."""
    found = [finest]
    per_level = np.cumsum(np.bincount(points.first_level, minlength=LEVELS + 2))
    for level in range(LEVELS, 0, -1):
        if len(found) > 1 and shows_planes(found[-1]):
            return found[-1].level
        if FEWEST <= per_level[level] < 0.8 * per_level[found[-1].level]:
            coarser = measure(points, level, settings, SAMPLE)
            if coarser.spacing > COARSEST * found[0].spacing:
                break
            found.append(coarser)
    best = max(scale.flat_share for scale in found)
    return next(scale.level for scale in found if scale.flat_share >= NEARLY_BEST * best)


def measure(points: Points, level: int, settings: SegmentSettings, n_sample: int) -> Scale:
    """Return the scale of the representatives of one level, from a sample of about this size.

    What is measured are neighbourhoods as the patches that will be kept: upright ones under a limit of tilt.
    """
    _, xyz, code = representatives(points, level)
    sample = look_at(xyz, code, points.frame, settings.neighbours, n_sample)
    ours = sample.narrow | is_wanted(sample, settings)
    flat = ours & sample.flat
    if np.count_nonzero(flat) < ENOUGH:
        ours, flat = np.ones(len(ours), bool), sample.flat
    used = flat if flat.any() else ours
    spacing, wide = np.quantile(sample.spacing[used], (0.5, 0.9))
    noise = usual_noise(sample.scale[used], sample.residual[used])
    return Scale(
        level, float(spacing), float(wide), noise, float(np.mean(flat[ours])), float(np.mean(sample.narrow[ours]))
    )


def is_wanted(sample: Sample, settings: SegmentSettings) -> NDArray[np.bool_]:
    """Return by which neighbourhoods (s,) spacing and noise are measured: upright ones, where such planes are judged.

    A rough wall is then not measured by a smooth road. If all kinds are judged, or upright ones not, all count.
    """
    if "upright" not in settings.surfaces or set(settings.surfaces) >= {"upright", "tilted"}:
        return np.ones(len(sample.normal), bool)
    up = np.asarray(settings.up) / np.linalg.norm(settings.up)
    return np.asarray(np.abs(sample.normal @ up) <= np.sin(np.arcsin(STEEP) + np.radians(MARGIN)))


def level_of(points: Points, resolution: float) -> int:
    """Return the coarsest level whose cells are no wider than `resolution`; 0 means every point."""
    if resolution <= 0.0:
        return LEVELS + 1
    return int(np.clip(np.ceil(np.log2(points.frame[3] / resolution)), 1, LEVELS + 1))


def cell_side(points: Points, level: int) -> float:
    """Return the side in metres of the cells of a level, 0 where every point counts."""
    return 0.0 if level > LEVELS else float(points.frame[3] / 2.0**level)


def representatives(points: Points, level: int) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.uint64]]:
    """Return one point of each cell of a level, in order, with coordinates and numbers; all above the finest level."""
    if level > LEVELS:
        return np.arange(len(points.xyz)), points.xyz, points.code
    place = pick_one_a_cell(points.code, points.first_level, level)
    return place, points.xyz[place], points.code[place]


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
    surfaces: tuple[str, ...]
    up: NDArray[np.float64]

    def described(self, quarter: int) -> dict[str, Any]:
        """Return them as :class:`mapq.patches.Patches` keeps them, in the axes before these quarter turns."""
        values = {**self._asdict(), "up": turn(self.up, -quarter).tolist(), "surfaces": list(self.surfaces)}
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
        surfaces=settings.surfaces,
        up=np.asarray(settings.up, np.float64) / float(np.linalg.norm(settings.up)),
    )


def refuse_other_unit(spacing: float, name: str) -> None:
    """Raise InputError if points of a map of this name are so many metres apart that they are in another unit."""
    if spacing > FARTHEST_APART:
        raise InputError(
            f"{name}: its points are {spacing:.3g} m apart, too far to judge surfaces. If they are in another unit, "
            "give it to the command that reads the cloud: --unit mm, cm or ft."
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
