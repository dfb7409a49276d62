"""What makes a discontinuity graph valid (Paskin & Thrun 1.3.1), with every broken rule named."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.model.coloring.graph import Coloring
from prf.model.window import INTERIOR, SIDE_NAMES, SIDES
from prf.shell.errors import InputError


def violations(coloring: Coloring) -> list[str]:
    """Return one line for each rule that the graph breaks; an empty list means that it is valid.

    The rules: arrays of the right shape; interior vertices strictly inside and on two edges; boundary vertices
    exactly on their side and on one edge, even in number; no edge of length 0, repeated or along a side; no two edges
    that cross, touch or overlap, other than at a shared vertex. The predicates are GEOS's, exact in double precision.
    """
    broken = _shape_violations(coloring)
    if broken:
        return broken
    return [*_vertex_violations(coloring), *_edge_violations(coloring), *_crossing_violations(coloring)]


def check(coloring: Coloring) -> None:
    """Raise InputError with the first few broken rules, if any."""
    broken = violations(coloring)
    if broken:
        more = f" (and {len(broken) - 3} more)" if len(broken) > 3 else ""
        raise InputError(f"invalid coloring: {'; '.join(broken[:3])}{more}")


def _shape_violations(coloring: Coloring) -> list[str]:
    """Check what every later look relies on: shapes, finite coordinates, indices in range."""
    xy, side, edges = coloring.xy, coloring.side, coloring.edges
    if xy.ndim != 2 or xy.shape[1] != 2:
        return [f"xy must have shape (n_vertices, 2), not {xy.shape}"]
    if edges.ndim != 2 or edges.shape[1] != 2:
        return [f"edges must have shape (n_edges, 2), not {edges.shape}"]
    if side.shape != (len(xy),):
        return [f"side must have shape ({len(xy)},), not {side.shape}"]
    if not np.isfinite(xy).all():
        return [f"vertex {int(np.argmin(np.isfinite(xy).all(axis=1)))} is not finite"]
    if edges.size and (edges.min() < 0 or edges.max() >= len(xy)):
        return [f"edges name vertices outside 0 ... {len(xy) - 1}"]
    if not np.isin(side, (INTERIOR, *SIDES)).all():
        return ["side must be -1 ... 3"]
    return []


def _vertex_violations(coloring: Coloring) -> list[str]:
    """Check degrees, places and the even number of boundary vertices."""
    xy, side, window = coloring.xy, coloring.side, coloring.window
    degree = np.bincount(coloring.edges.ravel(), minlength=len(xy))
    wanted = np.where(side == INTERIOR, 2, 1)
    broken = [
        f"vertex {v} ({'interior' if side[v] == INTERIOR else 'boundary'}) is on {degree[v]} edges, not {wanted[v]}"
        for v in np.flatnonzero(degree != wanted)
    ]
    lower, upper = np.array(window[:2]), np.array(window[2:])
    strictly = ((xy > lower) & (xy < upper)).all(axis=1)
    broken += [
        f"vertex {v} is called interior but lies at {xy[v].tolist()}"
        for v in np.flatnonzero((side == INTERIOR) & ~strictly)
    ]
    for s in SIDES:
        off = (xy[:, 1 - s % 2] != window.side_coordinate(s)) | ~window.contains(xy)
        broken += [
            f"vertex {v} at {xy[v].tolist()} is not exactly on the {SIDE_NAMES[s]} side"
            for v in np.flatnonzero((side == s) & off)
        ]
    n_boundary = np.count_nonzero(side != INTERIOR)
    return [*broken, f"{n_boundary} boundary vertices: must be even"] if n_boundary % 2 else broken


def _edge_violations(coloring: Coloring) -> list[str]:
    """Check for repeated edges, edges of length 0 and edges along a side."""
    edges, window = coloring.edges, coloring.window
    if not len(edges):
        return []
    ends = coloring.xy[edges]
    broken = [f"edge {e} has length 0" for e in np.flatnonzero((ends[:, 0] == ends[:, 1]).all(axis=1))]
    for s in SIDES:
        along = (ends[:, :, 1 - s % 2] == window.side_coordinate(s)).all(axis=1)
        broken += [f"edge {e} lies along the {SIDE_NAMES[s]} side" for e in np.flatnonzero(along)]
    _, first, counts = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return [*broken, *(f"edge {e} is there {n} times" for e, n in zip(first, counts, strict=True) if n > 1)]


def _crossing_violations(coloring: Coloring) -> list[str]:
    """Check that edges meet at shared vertices only."""
    lines = shapely.linestrings(coloring.xy[coloring.edges])
    pairs = shapely.STRtree(lines).query(lines, predicate="intersects")
    e, f = pairs[:, pairs[0] < pairs[1]]
    shared = (coloring.edges[e][:, :, None] == coloring.edges[f][:, None, :]).any(axis=(1, 2))
    apart = ~shared
    apart[shared] = _overlap(coloring, e[shared], f[shared])
    return [f"edges {i} and {j} cross or touch" for i, j in zip(e[apart], f[apart], strict=True)]


def _overlap(coloring: Coloring, e: NDArray[np.int64], f: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which pairs of edges with one shared vertex meet in more than that vertex."""
    lines = [shapely.linestrings(coloring.xy[coloring.edges[k]]) for k in (e, f)]
    overlap = np.zeros(len(e), dtype=np.bool_)
    for one, other, line in ((e, f, lines[1]), (f, e, lines[0])):
        for end in (0, 1):
            vertex = coloring.edges[one, end]
            free = (coloring.edges[other] != vertex[:, None]).all(axis=1)
            overlap |= free & shapely.intersects(shapely.points(coloring.xy[vertex]), line)
    return overlap
