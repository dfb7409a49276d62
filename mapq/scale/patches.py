"""The patches of the whole map: regions of all tiles united, judged by their sums, and numbered."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import turn
from mapq.scale.borders import Shared, unite_regions
from mapq.scale.cut import Cut
from mapq.scale.files import save_arrays
from mapq.scale.unions import add_up
from mapq.segmentation.finish import is_large, is_upright, number_regions, report_of
from mapq.segmentation.parameters import Parameters
from mapq.segmentation.regions import MERGE_RMS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Whole(NamedTuple):
    """The patches (m) of a map in tiles, and where their points are.

    Attributes
    ----------
    normal, centroid : (m, 3) float64
    mse : (m,) float64
        Mean squared distance from the plane, in m².
    n_points, n_rays : (m,) int64
        Repeated ones included; those of which it is known where the sensor was.
    low, high : (m, 3) float64
        Box of the points.
    first_piece : (m + 1,) int64
        Pieces of patch i are ``piece[first_piece[i]:first_piece[i + 1]]``.
    piece : (p, 3) int64
        Tile, and where the points begin and end in its file of points.
    rest : (q, 3) int64
        As `piece`, of what is in the files of points and in no patch.
    number : (r,) int32
        Patch of each region of all tiles, -1 for none.
    first_region : (t + 1,) int64
        Regions of tile t are numbered from ``first_region[t]``.
    """

    normal: Floats
    centroid: Floats
    mse: Floats
    n_points: Ints
    n_rays: Ints
    low: Floats
    high: Floats
    first_piece: Ints
    piece: Ints
    rest: Ints
    number: NDArray[np.int32]
    first_region: Ints

    @property
    def box(self) -> Floats:
        """Corners (2, 3) of the box around all patches."""
        return np.array([self.low.min(axis=0, initial=np.inf), self.high.max(axis=0, initial=-np.inf)])

    @property
    def corner(self) -> Floats:
        """Lowest corner (3,) of that box, from which patches are measured; 0 where there are none."""
        return self.box[0] if len(self.low) else np.zeros(3)

    def turned(self, quarter: int) -> Whole:
        """Return the patches turned by quarters; the files of their points are not."""
        corners = np.sort([turn(self.low, quarter), turn(self.high, quarter)], axis=0)
        normal, centroid = turn(self.normal, quarter), turn(self.centroid, quarter)
        return self._replace(normal=normal, centroid=centroid, low=corners[0], high=corners[1])

    def save(self, folder: str) -> None:
        """Write them into the work folder, for the tasks."""
        save_arrays(_path(folder), **self._asdict())


def load_whole(folder: str) -> Whole:
    """Return the patches in a work folder."""
    with np.load(_path(folder)) as arrays:
        return Whole(**{name: arrays[name] for name in Whole._fields})


def _path(folder: str) -> str:
    return os.path.join(folder, "patches.npz")


def join_regions(
    cuts: list[Cut], shared: Shared, label: list[Ints], chosen: Parameters
) -> tuple[Whole, dict[str, Any]]:
    """Return the patches of all tiles, largest first (ties: by their first point), and the report's part on them.

    Parameters
    ----------
    cuts : list of Cut
        By tile.
    shared : Shared
        Pairs of their regions that share points.
    label : list of (r,) int64
        By tile, which of the regions that grew there are one plane, as :class:`mapq.scale.unions.Unions` has it.
    chosen : Parameters
    """
    first_region = np.concatenate([[0], np.cumsum([len(cut.n_points) for cut in cuts])]).astype(np.int64)
    pairs = np.column_stack([first_region[side[:, 0]] + side[:, 1] for side in (shared.one, shared.other)])
    origin, own, seen = (_all(cuts, name) for name in ("origin", "own", "seen"))
    of_root = np.concatenate([labels[cut.root] for labels, cut in zip(label, cuts, strict=True)])
    max_rms = MERGE_RMS * chosen.max_distance
    parent = unite_regions(origin, seen, own[:, 0] > 0.0, pairs, shared, max_rms, of_root)
    fits, group = add_up(parent, origin, own)
    n_groups = len(fits.planes)
    n_points = np.bincount(group, _all(cuts, "n_points"), n_groups).astype(np.int64)
    area = np.bincount(group, _all(cuts, "area"), n_groups).astype(np.float64)
    first = np.full(n_groups, np.iinfo(np.uint64).max, np.uint64)
    has_points = own[:, 0] > 0.0
    np.minimum.at(first, group[has_points], _all(cuts, "first")[has_points])
    order = number_regions(is_large(fits, chosen) & is_upright(fits.planes, chosen), n_points, first)
    number = np.full(n_groups + 1, -1, np.int32)
    number[order] = np.arange(len(order))
    low, high = np.full((n_groups, 3), np.inf), np.full((n_groups, 3), -np.inf)
    np.minimum.at(low, group, _all(cuts, "low"))
    np.maximum.at(high, group, _all(cuts, "high"))
    of_region = number[group]
    first_piece, piece, rest = _pieces(cuts, of_region, len(order))
    whole = Whole(
        normal=fits.planes[order, :3].copy(),
        centroid=fits.planes[order, 3:].copy(),
        mse=np.maximum(fits.spread[order, 0], 0.0),
        n_points=n_points[order],
        n_rays=np.bincount(group, _all(cuts, "n_rays"), n_groups).astype(np.int64)[order],
        low=low[order],
        high=high[order],
        first_piece=first_piece,
        piece=piece,
        rest=rest,
        number=of_region,
        first_region=first_region,
    )
    return whole, report_of(fits, chosen, n_points, area)


def _all(cuts: list[Cut], name: str) -> NDArray[Any]:
    return np.concatenate([getattr(cut, name) for cut in cuts])


def _pieces(cuts: list[Cut], of_region: NDArray[np.int32], n_patches: int) -> tuple[Ints, Ints, Ints]:
    """Return `first_piece`, `piece` and `rest` of :class:`Whole`."""
    rows = np.concatenate(
        [np.column_stack([np.full(len(cut.n_points), cut.tile), cut.start[:-2], cut.start[1:-1]]) for cut in cuts]
    )
    loose = np.array([[cut.tile, *cut.start[-2:]] for cut in cuts], np.int64).reshape(-1, 3)
    is_there = rows[:, 2] > rows[:, 1]
    some = np.flatnonzero((of_region >= 0) & is_there)
    some = some[np.argsort(of_region[some], kind="stable")]
    first = np.zeros(n_patches + 1, np.int64)
    np.cumsum(np.bincount(of_region[some], minlength=n_patches), out=first[1:])
    return first, rows[some], np.concatenate([rows[(of_region < 0) & is_there], loose])
