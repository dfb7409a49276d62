"""`PatchFeatures`: what the random field sees of a map; and as tables, a row a patch, or a pair."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.features.copies import COLUMNS

UNITS = {
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
    "shift_along": "m",
    "shift_length": "m",
    "partly_covered": "1",
    "unlike_height": "1",
    "facing_away": "1",
}
SHARES = (0.05, 0.5, 0.95)
"""Quantiles that sum up a column for a person."""


class PatchFeatures(NamedTuple):
    """What the random field sees of a map.

    Attributes
    ----------
    node : (n_patches, n_node) float64
        Node features, named by `node_names`.
    pairs : (n_pairs, 2) int32
        As in :class:`PatchGraph`.
    edge : (n_pairs, n_edge) float64
        Edge features, named by `edge_names`.
    plausibility : (n_pairs,) float64
        x_ij of equation 13: high is plausible.
    node_names, edge_names : tuple of str
    shape : (n_patches, n_shape) float64
        Measures of a patch for people, named by `shape_names`: counts, metres, m², degrees. The random field has none.
    shape_names : tuple of str
    context_names : tuple of str
        Those of `edge_names` that are context, beyond the paper.
    parameters : mapping
        What the features were computed with, estimates included: numbers in metres, the up direction.
    """

    node: NDArray[np.float64]
    pairs: NDArray[np.int32]
    edge: NDArray[np.float64]
    plausibility: NDArray[np.float64]
    node_names: tuple[str, ...]
    edge_names: tuple[str, ...]
    shape: NDArray[np.float64] = np.zeros((0, 0))
    shape_names: tuple[str, ...] = ()
    context_names: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = MappingProxyType({})

    @property
    def nodes(self) -> NDArray[np.void]:
        """A row a patch (m,), columns by name: ``nodes["thickness_m"]``."""
        return node_table(self).array()

    @property
    def edges(self) -> NDArray[np.void]:
        """A row a pair of neighbours ``i``, ``j``: ``edges["plausibility"]`` is x_ij, low where walls are doubled."""
        return edge_table(self).array()

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of each column of `nodes` and `edges`."""
        return UNITS

    @property
    def disagreement(self) -> NDArray[np.float64]:
        """Lower bound, value and upper bound (m, 3) of what scans disagree by on each patch, metres; nan unknown."""
        names = ("disagreement_low", "disagreement", "disagreement_high")
        if not set(names) <= set(self.node_names):
            return np.full((len(self.node), 3), np.nan)
        return self.node[:, [self.node_names.index(name) for name in names]]


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
    return _table(names, [numbers, count, *features.shape[:, 1:].T, *features.node.T])


def edge_table(features: PatchFeatures) -> Table:
    """Return a row a pair: both numbers, its edge features, its plausibility."""
    names = ("i", "j", *features.edge_names, "plausibility")
    return _table(names, [*features.pairs.T, *features.edge.T, features.plausibility])


def _table(names: tuple[str, ...], columns: list[NDArray[Any]]) -> Table:
    return Table(names, tuple(UNITS[name] for name in names), columns)


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
