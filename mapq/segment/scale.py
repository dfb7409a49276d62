"""The scale of a cloud: how far apart its points lie, how noisy they are, and how finely they show a plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.cells import LEVELS, pick_one_a_cell
from mapq.kernels.neighbours import find_neighbours
from mapq.kernels.normals import estimate_normals
from mapq.kernels.robust import trimmed_residuals
from mapq.segment.points import Points

SAMPLE = 3000
"""Points that estimates look at, every so many along the curve: their standard error is about 2 %."""
WIDEST = 48
"""Neighbours of the sample: so many tell a plane with others beside it from a ball."""
WIDE = 28
"""Neighbours when half of them may belong to another surface."""
TURNS = 32
"""Candidate planes of a robust fit."""
THIN = 0.03
"""A neighbourhood shows a plane if the nearest half of it has at most this thickness; half a ball has 0.1 or more."""
WIDTH_IN_NOISE, WIDTH_IN_LENGTH = 2.0, 0.22
"""And if its short side is wider than the noise and not too short for its length, else it may be one scan line. Both
are standard deviations; a half disc, at the edge of a wall, has a width of 0.5 of its length."""
ENOUGH_FLAT, FEW_LINES, NEARLY_BEST = 0.5, 0.05, 0.9
"""Shares of neighbourhoods: with so many that show a plane and so few that are too narrow no coarser level is looked
at; else the finest level nearly as good as the best one is taken."""
FEWEST = 200
"""Representatives below which a level is too coarse to try."""
CUT, KEPT_STD = 2.0, 0.8796
"""Residuals up to `CUT` standard deviations, and the standard deviation of a normal law cut there (as a share)."""


class Scale(NamedTuple):
    """What the estimates found.

    Attributes
    ----------
    level : int
        Of the octree: one point of each cell is looked at first. LEVELS + 1: every point.
    spacing, wide_spacing : float
        Metres between points, median and 90th percentile over the sample; as if they lay on a square grid.
    noise : float
        Standard deviation in metres across surfaces.
    flat_share, narrow_share : float
        Shares of the sample whose neighbourhoods show a plane; and that are too narrow to show one.
    """

    level: int
    spacing: float
    wide_spacing: float
    noise: float
    flat_share: float
    narrow_share: float


def find_scale(points: Points, n_neighbours: int, resolution: float | None) -> Scale:
    """Return the scale at which a cloud shows its planes: the finest one where most neighbourhoods do.

    Points on scan lines far apart, or denser than their noise, show planes only when they are thinned out.
    """
    if resolution is not None:
        return measure(points, level_of(points, resolution), n_neighbours)
    found = [measure(points, LEVELS + 1, n_neighbours)]
    per_level = np.cumsum(np.bincount(points.first_level, minlength=LEVELS + 2))
    for level in range(LEVELS, 0, -1):
        if found[-1].flat_share >= ENOUGH_FLAT and found[-1].narrow_share <= FEW_LINES:
            return found[-1]
        if FEWEST <= per_level[level] < 0.8 * per_level[found[-1].level]:
            found.append(measure(points, level, n_neighbours))
    best = max(scale.flat_share for scale in found)
    return next(scale for scale in found if scale.flat_share >= NEARLY_BEST * best)


def level_of(points: Points, resolution: float) -> int:
    """Return the coarsest level whose cells are no wider than `resolution`; 0 asks for every point."""
    if resolution <= 0.0:
        return LEVELS + 1
    return int(np.clip(np.ceil(np.log2(points.frame[3] / resolution)), 1, LEVELS + 1))


def cell_side(points: Points, level: int) -> float:
    """Return the side in metres of the cells of a level, 0 where every point counts."""
    return 0.0 if level > LEVELS else float(points.frame[3] / 2.0**level)


def representatives(points: Points, level: int) -> NDArray[np.int64]:
    """Return one point of each cell of a level, in order; all points above the finest level."""
    if level > LEVELS:
        return np.arange(len(points.xyz))
    return pick_one_a_cell(points.code, points.first_level, level)


def neighbours_of(
    xyz: NDArray[np.float64],
    code: NDArray[np.uint64],
    frame: NDArray[np.float64],
    wanted: NDArray[np.bool_],
    n_neighbours: int,
    max_gap: float = np.inf,
) -> NDArray[np.int32]:
    """Return the nearest neighbours (w, k) of the points wanted, none beyond `max_gap`; -1 fills up."""
    before = np.zeros(len(xyz) + 1, np.int32)
    np.cumsum(wanted, out=before[1:])
    neighbours = np.empty((int(before[-1]), n_neighbours), np.int32)
    find_neighbours(xyz, code, frame, before, max_gap, neighbours)
    return neighbours


def measure(points: Points, level: int, n_neighbours: int) -> Scale:
    """Return the scale of the representatives of one level, from a sample of them."""
    kept = representatives(points, level)
    xyz, code = (points.xyz, points.code) if level > LEVELS else (points.xyz[kept], points.code[kept])
    sample = np.unique(np.linspace(0, len(xyz) - 1, SAMPLE).astype(np.int64))
    wanted = np.zeros(len(xyz), bool)
    wanted[sample] = True
    n_wide = min(max(WIDEST, n_neighbours), len(xyz) - 1)
    neighbours = neighbours_of(xyz, code, points.frame, wanted, n_wide)
    normal, spread = np.empty((len(sample), 3), np.float32), np.empty((len(sample), 3), np.float32)
    estimate_normals(xyz, sample, neighbours[:, :n_neighbours].copy(), normal, spread)
    scale, thickness = np.empty(len(sample)), np.empty(len(sample))
    residual = np.empty((len(sample), n_wide + 1))
    trimmed_residuals(xyz, sample, neighbours, TURNS, scale, thickness, residual)
    noise = raise_noise(scale, residual)
    width, length = np.sqrt(spread[:, 1]), np.sqrt(spread[:, 2])
    narrow = ~((width > WIDTH_IN_NOISE * noise) & (width > WIDTH_IN_LENGTH * length))
    flat = ~narrow & (thickness <= THIN)
    n_last = min(n_neighbours, n_wide)
    reach = np.linalg.norm(xyz[neighbours[:, n_last - 1]] - xyz[sample], axis=1)[flat if flat.any() else slice(None)]
    spacing, wide = np.quantile(reach * np.sqrt(np.pi / n_last), (0.5, 0.9))
    return Scale(level, float(spacing), float(wide), noise, float(np.mean(flat)), float(np.mean(narrow)))


def raise_noise(scale: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Return the standard deviation of points about the planes through their neighbourhoods.

    Parameters
    ----------
    scale : (s,) float64
        Scale of each neighbourhood's residuals, nan where there is no plane.
    residual : (s, k) float64
        Distances of the neighbourhood's points to its plane.

    Notes
    -----
    Half of a neighbourhood may be another copy of the surface, so planes come from robust fits. The standard deviation
    is raised from below until it agrees with the residuals within two of it; between two copies 5 standard deviations
    apart or more there is a gap at which that stops.
    """
    known = np.isfinite(scale)
    if not known.any():
        return 0.0
    low, usual = np.quantile(scale[known], (0.1, 0.25))
    pooled = residual[known][scale[known] <= 3.0 * usual].ravel()
    pooled = np.sort(pooled[np.isfinite(pooled)])
    squares = np.cumsum(pooled**2)
    noise = float(low)
    for _ in range(200):
        n_within = int(np.searchsorted(pooled, CUT * noise, side="right"))
        raised = float(np.sqrt(squares[n_within - 1] / n_within)) / KEPT_STD if n_within else 0.0
        if raised <= noise * 1.0005:
            break
        noise = raised
    return noise
