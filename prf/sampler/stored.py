"""Whether stored arrays can be a chain's: kernels check no bounds, and would read and write wherever a slot points."""

from __future__ import annotations

import numpy as np

from prf.kernels import constants as c
from prf.kernels.graph import Graph
from prf.sampler.chain_state import Arrays

_SLOTS = ("vertex_edges", "edge_vertices", "members", "positions", "free_vertices", "free_edges")
_GRAPH = "graph."


def check_stored(own: Arrays, found: Arrays) -> None:
    """Refuse arrays that are not of the kinds of a chain's own, or whose graph points out of itself."""
    for name, mine in own.items():
        theirs = found[name]
        is_alike = theirs.dtype == mine.dtype or theirs.dtype.kind == mine.dtype.kind == "U"
        if not (is_alike and theirs.ndim == mine.ndim and theirs.flags.c_contiguous):
            raise ValueError(f"{name} is {theirs.dtype} {theirs.shape}, not as {mine.dtype} {mine.shape}")
    last = _GRAPH + Graph._fields[-1]
    for prefix in (name.removesuffix(last) for name in own if name.endswith(last)):
        mine_of, theirs_of = (_graph_of(arrays, prefix) for arrays in (own, found))
        _check_shapes(prefix, mine_of, theirs_of)
        _check_graph(prefix, mine_of, theirs_of)


def _graph_of(arrays: Arrays, prefix: str) -> Graph:
    return Graph(*(arrays[f"{prefix}{_GRAPH}{name}"] for name in Graph._fields))


def _check_shapes(prefix: str, own: Graph, found: Graph) -> None:
    """Raise ValueError unless both graphs differ in nothing but their capacity."""
    before, capacity = len(own.edge_length), len(found.edge_length)
    for name, mine, theirs in zip(Graph._fields, own, found, strict=True):
        if theirs.shape != tuple(capacity if n == before else n for n in mine.shape):
            raise ValueError(f"{prefix}{_GRAPH}{name} has shape {theirs.shape}")
    if not np.array_equal(found.window, own.window):
        raise ValueError(f"{prefix}{_GRAPH}window is {found.window.tolist()}")


def _check_graph(prefix: str, own: Graph, found: Graph) -> None:
    """Raise ValueError if a slot is out of range, or a wall out of the window."""
    capacity, counts = len(found.edge_length), found.counts
    for name in _SLOTS:
        slots = getattr(found, name)
        if slots.size and (slots.min() < c.NONE or slots.max() >= capacity):
            raise ValueError(f"{prefix}{_GRAPH}{name} names a slot out of {capacity}")
    n_vertices = counts[c.INTERIOR_VERTICES] + counts[c.BOUNDARY_VERTICES]
    n_slots = (n_vertices + counts[c.FREE_VERTICES], counts[c.EDGES] + counts[c.FREE_EDGES])
    if counts[: c.ANCHOR_BLACK].min() < 0 or n_slots != (capacity, capacity):
        raise ValueError(f"{prefix}{_GRAPH}counts do not add up to {capacity}")
    edges = found.members[c.EDGES, : counts[c.EDGES]]
    ends = found.edge_vertices[edges]
    lower, upper = own.window[:2], own.window[2:]
    # Both comparisons are false for what is not a number.
    is_inside = bool(((found.vertex_xy[ends] >= lower) & (found.vertex_xy[ends] <= upper)).all())
    is_same = np.array_equal(found.vertex_xy[ends].reshape(-1, 4), found.edge_xy[edges])
    if edges.min(initial=0) < 0 or ends.min(initial=0) < 0 or not (is_inside and is_same):
        raise ValueError(f"{prefix}{_GRAPH}edge_xy is not where its vertices are, inside the window")
