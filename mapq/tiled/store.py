"""The work folder: points by tile, first as they are read, then region after region."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class Store(NamedTuple):
    """Points in files, a record a point: `xyz`, `number` among all points of the map, and fields as float64."""

    folder: str
    fields: tuple[str, ...]

    @property
    def record(self) -> np.dtype[Any]:
        """The type of a record."""
        return np.dtype([("xyz", "<f8", 3), ("number", "<i8"), *((name, "<f8") for name in self.fields)])

    def path(self, kind: str, tile: int) -> str:
        """Return the file of a tile: ``spool``, ``points`` or ``border``."""
        return os.path.join(self.folder, f"{kind}_{tile:05d}")

    def append(self, tile: int, records: Array) -> None:
        """Add points to the spool of a tile."""
        with open(self.path("spool", tile), "ab") as stream:
            stream.write(records.tobytes())

    def spooled(self, tile: int) -> Array:
        """Return the points of a tile in the order in which they were read."""
        path = self.path("spool", tile)
        if not os.path.exists(path):
            return np.zeros(0, self.record)
        return np.memmap(path, self.record, "r")

    def write_points(self, tile: int, records: Array) -> None:
        """Write the points of a tile, region after region."""
        with open(self.path("points", tile), "wb") as stream:
            stream.write(records.tobytes())

    def points(self, slices: NDArray[np.int64]) -> list[Array]:
        """Return points of tiles by slices (s, 4): tile, begin, end, step."""
        files = {tile: np.memmap(self.path("points", tile), self.record, "r") for tile in set(slices[:, 0].tolist())}
        return [files[tile][begin:end:step] for tile, begin, end, step in slices.tolist()]
