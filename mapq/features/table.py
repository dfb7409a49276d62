"""Features as tables: a row a patch, or a pair."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.features.copies import COLUMNS
from mapq.graph import PatchFeatures

UNITS = {
    "safe": {
        "patch": "number",
        "n_points": "count",
        "rms_m": "m",
        "thickness_m": "m",
        "area_m2": "m2",
        "width_m": "m",
        "height_m": "m",
        "tilt_deg": "degrees",
        "fit": "1",
        "tilt": "1",
        "thickness": "1",
        "i": "number",
        "j": "number",
        "separation": "m",
        "weight": "1",
        "overlap": "1",
        "crossing": "1",
        "angle_deg": "degrees",
        "offset": "m",
        "overlap_area": "m2",
        "plausibility": "1",
        "disagreement": "m",
        "disagreement_low": "m",
        "disagreement_high": "m",
        "n_scans": "count",
        "seen_by_several": "1",
        **dict.fromkeys(COLUMNS, "1"),
        "shift_length": "m",
        "partly_covered": "1",
        "unlike_height": "1",
        "facing_away": "1",
    }
}
UNITS["literal"] = {**UNITS["safe"], "inverse_mse": "1/m2", "inverse_up_cosine": "1", "volume_per_area": "m"}
SHARES = (0.05, 0.5, 0.95)
"""Quantiles that sum up a column for a person."""


class Table(NamedTuple):
    """Rows of numbers."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: list[NDArray[Any]]  # (n,) patch numbers and counts are integers, all else float64

    def rows(self) -> Iterator[tuple[int | float, ...]]:
        """Yield the rows as Python numbers."""
        return zip(*(column.tolist() for column in self.columns), strict=True)

    def array(self) -> NDArray[np.void]:
        """Return the rows as an array with named columns."""
        kinds = [(name, column.dtype) for name, column in zip(self.names, self.columns, strict=True)]
        found: NDArray[np.void] = np.zeros(len(self.columns[0]), dtype=kinds)
        for name, column in zip(self.names, self.columns, strict=True):
            found[name] = column
        return found


def node_table(features: PatchFeatures) -> Table:
    """Return a row a patch: its number, what people need, its node features."""
    count = features.shape[:, 0].astype(np.int64)
    numbers = np.arange(len(features.node))
    names = ("patch", *features.shape_names, *features.node_names)
    return _table(features, names, [numbers, count, *features.shape[:, 1:].T, *features.node.T])


def edge_table(features: PatchFeatures) -> Table:
    """Return a row a pair: both numbers, its edge features, its plausibility."""
    names = ("i", "j", *features.edge_names, "plausibility")
    return _table(features, names, [*features.pairs.T, *features.edge.T, features.plausibility])


def _table(features: PatchFeatures, names: tuple[str, ...], columns: list[NDArray[Any]]) -> Table:
    units = UNITS[features.reading]
    return Table(names, tuple(units[name] for name in names), columns)


def csv_lines(table: Table) -> Iterator[str]:
    """Yield the header and the rows as CSV, numbers to their last bit."""
    yield ",".join(table.names)
    for row in table.rows():
        yield ",".join(map(repr, row))


def records(table: Table) -> list[dict[str, int | float]]:
    """Return the rows as mappings from name to value."""
    return [dict(zip(table.names, row, strict=True)) for row in table.rows()]


def summed_up(table: Table) -> list[tuple[str, str, list[float]]]:
    """Return name, unit and the quantiles `SHARES` of each column of measures; nothing for an empty table."""
    found = []
    for name, unit, column in zip(*table, strict=True):
        if unit != "number" and len(column):
            found.append((name, unit, [float(value) for value in np.quantile(column, SHARES)]))
    return found
