"""The black region of a coloring as polygons, and back; and what makes its graph valid (Paskin & Thrun 1.3.1)."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from prf.model.coloring.graph import Coloring, black_at
from prf.model.sensors import LARGEST_COORDINATE
from prf.model.window import BOTTOM, INTERIOR, LEFT, RIGHT, SIDE_NAMES, SIDES, TOP, Window
from prf.shell.errors import InputError

SNAP = 1e-9  # share of the window's extent within which a vertex that clipping computed is put on the side: GEOS rounds


def occupied_polygons(coloring: Coloring) -> MultiPolygon:
    """Return the black region inside the window.

    The edges and the border split at boundary vertices bound the faces. Two faces that share an edge differ in
    colour, so the black faces make a valid MultiPolygon as they are, holes kept, every vertex of the graph exact.

    `coloring`: valid (:func:`prf.model.coloring.check`).
    """
    lines = np.concatenate([coloring.xy[coloring.edges], _border(coloring)])
    faces = shapely.get_parts(shapely.polygonize(shapely.linestrings(lines)))
    inside = _points_inside(faces)
    return MultiPolygon(list(faces[black_at(coloring, inside)]))


def _points_inside(polygons: NDArray[np.object_]) -> NDArray[np.float64]:
    """Return a point (n, 2) inside each of n polygons."""
    with np.errstate(all="ignore"):  # as in from_polygons
        return np.asarray(shapely.get_coordinates(shapely.point_on_surface(polygons)))


def oriented_polygons(coloring: Coloring) -> MultiPolygon:
    """Return the black region, outer rings counter-clockwise and holes clockwise (RFC 7946, section 3.1.6)."""
    return MultiPolygon([orient(polygon, 1.0) for polygon in occupied_polygons(coloring).geoms])


def refuse_far(region: BaseGeometry) -> None:
    """Raise InputError if a coordinate is not finite, or so large that GEOS computes nothing with it."""
    if not (np.abs(shapely.get_coordinates(region)) <= LARGEST_COORDINATE).all():
        raise InputError(f"a coordinate is not finite, or lies beyond {LARGEST_COORDINATE:g} m")


@np.errstate(all="ignore")  # GEOS divides by zero and overflows internally, of which numpy warns
def from_polygons(occupied: BaseGeometry, window: Window) -> Coloring:
    """Return the coloring of `window` that is black on `occupied`.

    `occupied`: clipped to the window; overlapping parts are united. Parts of rings along the border are not edges.
    """
    refuse_far(occupied)
    box = shapely.box(*window)
    try:
        region = shapely.union_all(shapely.get_parts(occupied))
        if not shapely.covers(box, region):
            region = shapely.intersection(region, box)
    except shapely.errors.GEOSException as error:
        raise InputError(f"polygons that cannot be united ({' '.join(str(error).split())})") from error
    polygons = shapely.get_parts(region)
    polygons = polygons[(shapely.get_dimensions(polygons) == 2) & ~shapely.is_empty(polygons)]
    ends = _snapped(_ring_segments(polygons), window)
    along = np.zeros(len(ends), dtype=np.bool_)
    for side in SIDES:
        along |= (ends[:, :, 1 - side % 2] == window.side_coordinate(side)).all(axis=1)
    coloring, area = from_segments(ends[~along], window), shapely.area(polygons)
    if coloring.n_edges == 0:  # all of the window, or nothing but hairs along its border
        return coloring._replace(anchor_black=bool(area.sum() > 0.5 * window.area))
    inside = _points_inside(polygons[[area.argmax()]])
    coloring = coloring._replace(anchor_black=not black_at(coloring, inside)[0])
    check(coloring)
    return coloring


def from_segments(ends: NDArray[np.float64], window: Window, anchor_black: bool = False) -> Coloring:
    """Return the coloring whose edges are `ends`; equal coordinates are one vertex, those on the border lie on a side.

    `ends` (n_edges, 2, 2): start and end of each edge. Validity is not checked.
    """
    xy, first, index = np.unique(ends.reshape(-1, 2), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    edges = rank[index.reshape(-1, 2)].astype(np.int32)
    xy = np.ascontiguousarray(xy[order])
    return Coloring(window, xy, sides_of(xy, window), edges, anchor_black)


def sides_of(xy: NDArray[np.float64], window: Window) -> NDArray[np.int8]:
    """Return the side on which each of (n, 2) points lies exactly, or INTERIOR; a corner takes the lower number."""
    on = [xy[:, 1 - side % 2] == window.side_coordinate(side) for side in SIDES]
    sides: NDArray[np.int8] = np.select(on, SIDES, INTERIOR).astype(np.int8)
    return sides


def turning_corners(ring: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Return the vertices of a ring at which it turns; of several at one place one stays.

    `ring` (n, 2): the first vertex is not repeated at the end. `tolerance`: metres that a vertex may stick out of the
    line of its neighbours before it counts as a corner. Returns (m, 2): two vertices or fewer where nothing but a line
    is left.
    """
    xy = ring
    while len(xy) > 2:
        before, after = np.roll(xy, 1, axis=0), np.roll(xy, -1, axis=0)
        chord, arm = after - before, xy - before
        off = np.abs(chord[:, 0] * arm[:, 1] - chord[:, 1] * arm[:, 0])
        drop = _every_second(off <= tolerance * np.maximum(np.hypot(*chord.T), tolerance))
        if not drop.any():
            break
        xy = xy[~drop]
    return xy


def _every_second(straight: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the first, third ... of each run in a ring: of neighbours only one may go, the other is judged by it."""
    place = np.arange(len(straight))
    before_run = np.maximum.accumulate(np.where(straight, -1, place))
    drop: NDArray[np.bool_] = straight & ((place - before_run) % 2 == 1)
    drop[-1] &= not drop[0]
    return drop


def _border(coloring: Coloring) -> NDArray[np.float64]:
    """Return the border as (n, 2, 2) segments, split at the boundary vertices."""
    window = coloring.window
    x0, y0, x1, y1 = window
    corners = {BOTTOM: (x1, y0), RIGHT: (x1, y1), TOP: (x0, y1), LEFT: (x0, y0)}
    points = [np.array([corners[LEFT]])]
    for side in SIDES:
        on = coloring.xy[coloring.side == side]
        along = on[:, side % 2] * (1 if side in (BOTTOM, RIGHT) else -1)
        points += [on[np.argsort(along)], np.array([corners[side]])]
    ring = np.concatenate(points)
    pieces = np.stack([ring[:-1], ring[1:]], axis=1)
    proper: NDArray[np.float64] = pieces[(pieces[:, 0] != pieces[:, 1]).any(axis=1)]
    return proper


def _ring_segments(polygons: NDArray[np.object_]) -> NDArray[np.float64]:
    """Return all segments of all rings, (n, 2, 2)."""
    rings = shapely.get_rings(polygons)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[:-1] == ring[1:]
    return np.stack([xy[:-1][same], xy[1:][same]], axis=1)


def _snapped(ends: NDArray[np.float64], window: Window) -> NDArray[np.float64]:
    """Put coordinates within rounding of a side exactly on it; drop segments that this makes points."""
    snapped = ends.copy()
    tolerance = SNAP * max(window.width, window.height)
    for side in SIDES:
        value = window.side_coordinate(side)
        along = snapped[:, :, 1 - side % 2]
        along[np.abs(along - value) <= tolerance] = value
    proper: NDArray[np.float64] = snapped[(snapped[:, 0] != snapped[:, 1]).any(axis=1)]
    return proper


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
