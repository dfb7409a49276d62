"""What the segmentation of a tile writes into the work folder: regions of its points, and the points by region."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.scale.files import save_array, save_arrays
from mapq.scale.spool import TilePoints


def regions_path(folder: str, tile: int) -> str:
    """Return the file with the region of each point of a tile, range after range, own points before the halo's."""
    return os.path.join(folder, f"regions_{tile:05d}.npy")


def points_path(folder: str, tile: int, name: str) -> str:
    """Return the file with the own points of a tile, region after region: ``xyz`` or one of the fields."""
    return os.path.join(folder, f"points_{tile:05d}_{name}.npy")


def loose_path(folder: str, tile: int, name: str) -> str:
    """Return the file with the own points of a tile that are in none of these regions; only of moments' maps."""
    return os.path.join(folder, f"loose_{tile:05d}_{name}.npy")


def border_path(folder: str, tile: int) -> str:
    """Return the file with the points of a tile that others see too."""
    return os.path.join(folder, f"border_{tile:05d}.npz")


class TileFiles(NamedTuple):
    """The files of one tile.

    Attributes
    ----------
    folder : str
        The work folder.
    tile : int
    parts : list of TilePoints
        Its points (n) by range.
    """

    folder: str
    tile: int
    parts: list[TilePoints]

    def save_regions(self, region: NDArray[np.int32]) -> None:
        """Write the region (n,) of each point."""
        save_array(regions_path(self.folder, self.tile), region)

    def save_points(
        self,
        region: NDArray[np.int32],
        is_own: NDArray[np.bool_],
        wanted: NDArray[np.bool_],
        moment: str | None,
    ) -> NDArray[np.int64]:
        """Write the own points of the regions that are wanted, and return where each region's begin (m + 1,).

        Parameters
        ----------
        region : (n,) int32
            Of each own point; -1 for none, and for points of the halo.
        is_own : (n,) bool
        wanted : (m,) bool
        moment : str or None
            Field of moments. Where it is known the other own points are written too: they may lie over a patch.
        """
        kept = np.flatnonzero(region >= 0)
        kept = kept[wanted[region[kept]]]
        order = kept[np.argsort(region[kept], kind="stable")]
        self._save_columns(points_path, order, tuple(self.parts[0].fields))
        if moment is not None:
            loose = is_own.copy()
            loose[kept] = False
            self._save_columns(loose_path, np.flatnonzero(loose), (moment,))
        start = np.zeros(len(wanted) + 1, np.int64)
        np.cumsum(np.bincount(region[order], minlength=len(wanted)), out=start[1:])
        return start

    def _save_columns(
        self, path: Callable[[str, int, str], str], rows: NDArray[np.int64], names: tuple[str, ...]
    ) -> None:
        """Write coordinates and some fields of some points."""
        save_array(path(self.folder, self.tile, "xyz"), np.concatenate([part.xyz for part in self.parts])[rows])
        for name in names:
            column: NDArray[Any] = np.concatenate([part.fields[name] for part in self.parts])[rows]
            save_array(path(self.folder, self.tile, name), column)

    def save_border(
        self, shared: NDArray[np.bool_], bases: tuple[int, ...], columns: dict[str, NDArray[np.int32]]
    ) -> None:
        """Write of the points (a mask) that other tiles see too the number among all points, ascending, and columns.

        `bases` are the numbers of the first points of the ranges.
        """
        number = np.concatenate([part.row + base for part, base in zip(self.parts, bases, strict=True)])[shared]
        order = np.argsort(number)
        ordered = {name: values[shared][order] for name, values in columns.items()}
        save_arrays(border_path(self.folder, self.tile), number=number[order], **ordered)
