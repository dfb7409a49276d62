"""The peer that most robots run: OctoMap, by its Python binding, as one layer of cells (the extra `bench`)."""

from __future__ import annotations

import dataclasses
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from prf.readings import read_readings, thin
from prf.results.occupancy import OccupancyGrid, write_grid

INSTALLED = importlib.util.find_spec("pyoctomap") is not None


def write_octomap(
    like: OccupancyGrid, log: Path, target: Path, *, every_scan: int = 1, skip_scans: str | None = None
) -> None:
    """Write the cells of `like` with the probabilities that OctoMap gives them, by its default sensor model.

    Scans are inserted one by one from their sensor's pose. Beams without a return are left out: with them, as rays that
    clear the space up to the maximum range, OctoMap scores worse here in all but distances from few scans.
    """
    from pyoctomap import OcTree

    tree = OcTree(like.resolution)
    kept = thin(read_readings(str(log)), every_scan, 1, None, skip_scans)
    height = 0.5 * like.resolution
    for scan in np.split(np.arange(len(kept.range)), np.flatnonzero(np.diff(kept.scan)) + 1):
        # OctoMap's cells begin at multiples of their side; those of `like` do in its own frame.
        sensor = kept.origin[scan[0]] - like.origin
        scan = scan[kept.range[scan] < like.settings["max_range"]]
        ends = np.full((len(scan), 3), height)
        ends[:, :2] = sensor + kept.range[scan, None] * np.column_stack(
            [np.cos(kept.angle[scan]), np.sin(kept.angle[scan])]
        )
        tree.insertPointCloud(ends, np.array([*sensor, height]))
    write_grid(target, dataclasses.replace(like, occupancy=_probabilities(tree, like)))


def _probabilities(tree: Any, like: OccupancyGrid) -> np.ndarray:
    n_rows, n_columns = like.occupancy.shape
    found = np.full((n_rows, n_columns), 0.5, np.float32)
    xs, ys = (like.resolution * (np.arange(n) + 0.5) for n in (n_columns, n_rows))
    for row, y in enumerate(ys):
        for column, x in enumerate(xs):
            node = tree.search([x, y, 0.5 * like.resolution])
            if node is not None:
                found[row, column] = node.getOccupancy()
    return found
