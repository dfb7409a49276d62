"""The segmentation of one tile: regions of its points and of those around it, as statistics that can be added up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.features.provenance import TO_SENSOR, Known
from mapq.features.rays import has_ray
from mapq.kernels.planes import MOMENTS
from mapq.kernels.regions import sum_regions
from mapq.scale.moments import translate
from mapq.scale.spool import TilePoints, read_tile_points
from mapq.scale.tile_files import TileFiles
from mapq.segmentation.core import make_core
from mapq.segmentation.finish import CELL_IN_SPACING, region_areas, tilt_of
from mapq.segmentation.parameters import Parameters
from mapq.segmentation.points import Points, sort_in_frame
from mapq.segmentation.regions import Fits, Grown, fit, grow_pieces, spread_out, unions, unite_pieces

FEWEST = 3
"""Distinct points that a tile must have to be looked at."""
CLEARLY_TILTED, CLEARLY_LARGE = 15.0, 200
"""Degrees beyond the limit of tilt, and points, from which on a region is surely dropped: its points are not kept."""

Floats = NDArray[np.float64]


class Decided(NamedTuple):
    """Which of the regions of a tile, as they grew, are one by what is known of them in all tiles.

    Attributes
    ----------
    parent : (r,) int32
        Into which region each goes.
    planes : (r, 6) float64
        Of the united regions, by all of their points; nan where they are not known.
    """

    parent: NDArray[np.int32]
    planes: Floats


class CutTask(NamedTuple):
    """What the segmentation of a tile is given.

    Attributes
    ----------
    tile : int
    parts : tuple of int
        Ranges that have points for it.
    bases : tuple of int
        Number of the first point of each of them among all.
    chosen, frame
        Parameters, and frame of the octree, of the whole map.
    box : (4,) float64
        Corners of the tile, in metres.
    halo : float
    folder : str
        The work folder.
    known : Known
        Which fields say where and when points were seen.
    decided : Decided or None
        None: what is one plane is for the tile to say.
    """

    tile: int
    parts: tuple[int, ...]
    bases: tuple[int, ...]
    chosen: Parameters
    frame: Floats
    box: Floats
    halo: float
    folder: str
    known: Known
    decided: Decided | None = None


class Pieces(NamedTuple):
    """The regions (r) of a tile as they grew, before pieces of one plane are united.

    Attributes
    ----------
    origin, own, seen : (r, 3), (r, 10), (r, 10) float64
        Moments of the tile's own points, and of all that it sees, about an origin.
    pairs : (p, 2) int32
        Regions that meet.
    parent : (r,) int32
        Into which each goes, as far as the tile tells.
    """

    origin: Floats
    own: Floats
    seen: Floats
    pairs: NDArray[np.int32]
    parent: NDArray[np.int32]


class Cut(NamedTuple):
    """The regions (m) of a tile.

    Attributes
    ----------
    tile : int
    origin, own : (m, 3), (m, 10) float64
        Moments of the tile's own distinct points about an origin.
    seen : (m, 10) float64
        Those of all points that the tile sees, halo included, about the same origin.
    n_points, n_rays : (m,) int64
        Own points, repeated ones included, and those of which it is known where the sensor was.
    low, high : (m, 3) float64
        Box of the own points.
    first : (m,) uint64
        Number of the first one on the curve through the whole map.
    area : (m,) float64
        In m².
    start : (m + 2,) int64
        Where the points of each begin in the tile's file of points, those of none, and where these end.
    root : (m,) int32
        Which of the regions that grew each is of, once these were united.
    grown : Pieces
    n_looked_at, n_distinct : int
        Own points that were looked at first, and distinct own points.
    """

    tile: int
    origin: Floats
    own: Floats
    seen: Floats
    n_points: NDArray[np.int64]
    n_rays: NDArray[np.int64]
    low: Floats
    high: Floats
    first: NDArray[np.uint64]
    area: Floats
    start: NDArray[np.int64]
    root: NDArray[np.int32]
    grown: Pieces
    n_looked_at: int
    n_distinct: int


def cut_tile(task: CutTask) -> Cut:
    """Segment one tile with what lies around it, and write what others need of it."""
    parts = [read_tile_points(task.folder, task.tile, part) for part in task.parts]
    xyz = np.concatenate([part.xyz for part in parts])
    is_own = np.concatenate([np.arange(len(part.row)) < part.n_own for part in parts])
    points = sort_in_frame(xyz, task.frame)
    own_place = np.zeros(len(points.xyz), bool)
    own_place[points.number[is_own]] = True
    found = _regions(task, points, own_place)
    of_point = found.region[points.number]
    files = TileFiles(task.folder, task.tile, parts)
    files.save_regions(of_point)
    shared = _seen_by_others(task, xyz, is_own)
    files.save_border(shared, task.bases, {"region": of_point, "grown": found.first[points.number]})
    return _described(task, files, points, found, is_own, own_place)


def _seen_by_others(task: CutTask, xyz: Floats, is_own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points (n,) of a tile other tiles see too: its halo's, and those in the halos of others."""
    near = (xyz[:, :2] < task.box[:2] + task.halo) | (xyz[:, :2] >= task.box[2:] - task.halo)
    return np.asarray(~is_own | near.any(axis=1))


class _Regions(NamedTuple):
    """The regions of the distinct points (u,) of a tile, those that grew first, and what they are made of."""

    region: NDArray[np.int32]
    first: NDArray[np.int32]
    root: NDArray[np.int32]
    grown: Pieces
    n_looked_at: int


def _regions(task: CutTask, points: Points, own_place: NDArray[np.bool_]) -> _Regions:
    """Return the regions of the points of a tile, of which some (u,) are its own."""
    first = np.full(len(points.xyz), -1, np.int32)
    if len(points.xyz) < FEWEST:
        nothing, no_pairs = np.zeros(0, np.int32), np.zeros((0, 2), np.int32)
        none = Pieces(np.zeros((0, 3)), *(np.zeros((0, MOMENTS)),) * 2, no_pairs, nothing)
        return _Regions(first, first, nothing, none, 0)
    core = make_core(points, task.chosen)
    grown = grow_pieces(core, task.chosen)
    parent, planes = task.decided or (unions(grown, task.chosen), None)
    united = unite_pieces(grown, task.chosen, parent, planes)
    first[core.place] = grown.region
    pieces = _pieces_of(grown, parent, own_place[core.place])
    return _Regions(spread_out(points, core, task.chosen, united.piece), first, united.region, pieces, len(core.place))


def _pieces_of(grown: Grown, parent: NDArray[np.int32], is_own: NDArray[np.bool_]) -> Pieces:
    """Return the sums of regions that grew, over core points (c,) of which some are the tile's own."""
    n_regions = len(grown.fits.planes)
    origin, own = np.zeros((n_regions, 3)), np.empty((n_regions, MOMENTS))
    sum_regions(grown.core.xyz, np.where(is_own, grown.region, np.int32(-1)), origin, own)
    some = own[:, 0] > 0.0
    origin[~some] = grown.fits.origin[~some]
    return Pieces(origin, own, translate(grown.fits.sums, grown.fits.origin, origin), grown.pairs, parent)


def _described(
    task: CutTask,
    files: TileFiles,
    points: Points,
    found: _Regions,
    is_own: NDArray[np.bool_],
    own_place: NDArray[np.bool_],
) -> Cut:
    """Write the tile's own points region after region, and return what is said of the regions."""
    region = found.region
    seen = fit(points.xyz, region)
    n_regions = len(seen.planes)
    own_region = np.where(own_place, region, np.int32(-1))
    own = np.empty((n_regions, MOMENTS))
    origin = np.zeros((n_regions, 3))
    sum_regions(points.xyz, own_region, origin, own)
    order = np.flatnonzero(own_region >= 0)
    order = order[np.argsort(own_region[order], kind="stable")]
    sizes = np.bincount(own_region[order], minlength=n_regions)
    begin = np.cumsum(sizes) - sizes
    some = sizes > 0
    low, high, first = np.full((n_regions, 3), np.inf), np.full((n_regions, 3), -np.inf), np.zeros(n_regions, np.uint64)
    if some.any():
        low[some] = np.minimum.reduceat(points.xyz[order], begin[some])
        high[some] = np.maximum.reduceat(points.xyz[order], begin[some])
        first[some] = points.code[order[begin[some]]]
    area = region_areas(points.xyz, own_region, seen, CELL_IN_SPACING * task.chosen.spacing)
    of_point = np.where(is_own, region[points.number], np.int32(-1))
    n_points = np.bincount(of_point[of_point >= 0], minlength=n_regions).astype(np.int64)
    start = files.save_points(of_point, is_own, ~_surely_tilted(seen, task.chosen))
    share = int(own_place.sum()) / max(len(own_place), 1)
    return Cut(
        tile=task.tile,
        origin=origin,
        own=own,
        seen=_about(seen.origin, origin, seen.sums, some),
        n_points=n_points,
        n_rays=_count_rays(task.known, files.parts, of_point, n_regions),
        low=low,
        high=high,
        first=first,
        area=area,
        start=start,
        root=found.root[:n_regions],
        grown=found.grown,
        n_looked_at=round(found.n_looked_at * share),
        n_distinct=int(own_place.sum()),
    )


def _about(origin: Floats, to: Floats, sums: Floats, some: NDArray[np.bool_]) -> Floats:
    """Return moments about other origins; regions without own points have none and keep theirs."""
    moved = translate(sums, origin, to)
    return np.where(some[:, None], moved, sums)


def _surely_tilted(fits: Fits, chosen: Parameters) -> NDArray[np.bool_]:
    """Return which regions (m,) no whole patch can be made of: they lie far too flat."""
    tilted = tilt_of(fits.planes, chosen) > chosen.max_tilt + CLEARLY_TILTED
    return np.asarray(tilted & (fits.sums[:, 0] >= CLEARLY_LARGE))


def _count_rays(
    known: Known, parts: list[TilePoints], of_point: NDArray[np.int32], n_regions: int
) -> NDArray[np.int64]:
    """Return how many points (m,) of each region have a way to the sensor."""
    if not known.has_rays or known.passes is None:
        return np.zeros(n_regions, np.int64)
    ways = [np.concatenate([part.fields[name] for part in parts]) for name in TO_SENSOR]
    some = has_ray(np.column_stack(ways)) & (of_point >= 0)
    return np.bincount(of_point[some], minlength=n_regions).astype(np.int64)
