"""What the segmentation of a tile writes into the work folder: regions of its points, and the points by region."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.scale.files import save_array, save_arrays
from mapq.scale.spool import TilePoints


def regions_path(folder: str, tile: int) -> str:
    """Return the file with the region of each point of a tile, range after range, own points before the halo's."""
    return os.path.join(folder, f"regions_{tile:05d}.npy")


def points_path(folder: str, tile: int, name: str) -> str:
    """Return the file with the own points of a tile, region after region, then of none: ``xyz`` or a field."""
    return os.path.join(folder, f"points_{tile:05d}_{name}.npy")


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
        self, region: NDArray[np.int32], is_own: NDArray[np.bool_], wanted: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """Write the own points of the regions that are wanted, then all other own ones: they may lie over a patch.

        Return where each region's begin, where the others do, and where these end (m + 2,).

        Parameters
        ----------
        region : (n,) int32
            Of each own point; -1 for none, and for points of the halo.
        is_own : (n,) bool
        wanted : (m,) bool
        """
        own = np.flatnonzero(is_own)
        place = np.append(np.where(wanted, np.arange(len(wanted)), len(wanted)), len(wanted))[region[own]]
        order = own[np.argsort(place, kind="stable")]
        columns = {name: [part.fields[name] for part in self.parts] for name in self.parts[0].fields}
        for name, several in {"xyz": [part.xyz for part in self.parts], **columns}.items():
            save_array(points_path(self.folder, self.tile, name), np.concatenate(several)[order])
        start = np.zeros(len(wanted) + 2, np.int64)
        np.cumsum(np.bincount(place, minlength=len(wanted) + 1), out=start[1:])
        return start

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
