"""The part of a map and of the readings that a chain in one tile needs (``prf.sampler.tiles``)."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.geometry import ray_hit
from prf.kernels.graph import (
    Graph,
    classify_vertex,
    distance,
    insert_edge,
    insert_vertex,
    is_drawn,
    set_remove,
    vertex_sine_now,
)
from prf.kernels.grid import ABS_TOL, REL_TOL, Grid, exit_distance, walk
from prf.kernels.guards import Guards, meets_triangle
from prf.kernels.image import Image, count_edge


@core
def tile_at(tiles: Array, x: float, y: float) -> int:
    """Number of the tile (rows of `tiles` (n, 4)) that holds a point, NONE if no one does."""
    for k in range(tiles.shape[0]):
        if tiles[k, 0] <= x < tiles[k, 2] and tiles[k, 1] <= y < tiles[k, 3]:
            return k
    return c.NONE


@core_entry
def tiles_at(tiles: Array, xy: Array, number: Array) -> None:
    """Write the number of the tile that holds each of the points (n, 2)."""
    for k in range(xy.shape[0]):
        number[k] = tile_at(tiles, xy[k, 0], xy[k, 1])


@core
def clip_axis(origin: float, direction: float, low: float, high: float) -> tuple[float, float]:
    """Between which distances a ray lies between two bounds of one axis."""
    if direction == 0.0:
        return (-math.inf, math.inf) if low < origin < high else (math.inf, -math.inf)
    first = (low - origin) / direction
    last = (high - origin) / direction
    return min(first, last), max(first, last)


@core_entry
def clip_beams(ray: Array, influence: Array, tile: Array, span: Array) -> None:
    """Write between which distances each beam passes the tile (4,) within its influence; (inf, -inf) if it does not."""
    for beam in range(ray.shape[0]):
        x0, x1 = clip_axis(ray[beam, c.ORIGIN_X], ray[beam, c.DIRECTION_X], tile[0], tile[2])
        y0, y1 = clip_axis(ray[beam, c.ORIGIN_Y], ray[beam, c.DIRECTION_Y], tile[1], tile[3])
        first = max(x0, y0, 0.0)
        last = min(x1, y1, influence[beam])
        span[beam, 0] = first if first < last else math.inf
        span[beam, 1] = last if first < last else -math.inf


@core_entry
def first_outside(
    grid: Grid,
    start: Array,
    entries: Array,
    path: Array,
    edge_xy: Array,
    edge_tile: Array,
    ray: Array,
    owner: Array,
    limit: Array,
    found: Array,
    distance: Array,
) -> None:
    """First edge on each beam before its limit that does not lie inside the tile `owner` of the beam.

    Writes the edge, NONE if there is none, and its distance, else the limit.
    """
    for beam in range(ray.shape[0]):
        ox = ray[beam, c.ORIGIN_X]
        oy = ray[beam, c.ORIGIN_Y]
        ux = ray[beam, c.DIRECTION_X]
        uy = ray[beam, c.DIRECTION_Y]
        best = limit[beam]
        found[beam] = c.NONE
        for i in range(walk(grid, ox, oy, ox + best * ux, oy + best * uy, path)):
            for at in range(start[path[i]], start[path[i] + 1]):
                edge = entries[at]
                if owner[beam] != c.NONE and edge_tile[edge] == owner[beam]:
                    continue
                t = ray_hit(ray[beam], edge_xy[edge])
                if t < best:
                    best = t
                    found[beam] = edge
            if best <= exit_distance(grid, path[i], ox, oy, ux, uy) * (1.0 - REL_TOL) - ABS_TOL:
                break
        distance[beam] = best


@core_entry
def mark_met(triangles: Array, segments: Array, is_met: Array) -> None:
    """Mark the segments (n, 4) that meet one of the triangles (m, 6)."""
    for k in range(segments.shape[0]):
        for i in range(triangles.shape[0]):
            if is_met[k] == 0 and meets_triangle(segments[k], triangles[i]):
                is_met[k] = 1


@core
def is_movable(graph: Graph, v: int) -> bool:
    """Whether no edge of v is frozen, or missing here."""
    first = graph.vertex_edges[v, 0]
    if first == c.NONE or not is_drawn(graph, first):
        return False
    last = graph.vertex_edges[v, 1]
    return graph.vertex_side[v] != c.INTERIOR or (last != c.NONE and is_drawn(graph, last))


@core_entry
def fill_part(graph: Graph, n_vertices: int, edges: Array, is_live: Array) -> None:
    """Bring the first `n_vertices` slots and the edges (n, 2) to life, of which only live ones can be drawn.

    A vertex can be drawn if all its edges can; a vertex beyond the part may lack an edge.
    """
    for v in range(n_vertices):
        insert_vertex(graph, v)
    for k in range(edges.shape[0]):
        a = edges[k, 0]
        b = edges[k, 1]
        edge = insert_edge(graph, a, b, distance(graph, a, b))
        if is_live[k] == 0:
            set_remove(graph, c.EDGES, edge)
            set_remove(graph, c.CORNER_CUTS, edge)
    for v in range(n_vertices):
        if graph.vertex_side[v] != c.INTERIOR or graph.vertex_edges[v, 1] != c.NONE:
            graph.vertex_sine[v] = vertex_sine_now(graph, v)
        if not is_movable(graph, v):
            set_remove(graph, c.INTERIOR_VERTICES, v)
            set_remove(graph, c.BOUNDARY_VERTICES, v)
    for i in range(graph.counts[c.INTERIOR_VERTICES]):
        classify_vertex(graph, graph.members[c.INTERIOR_VERTICES, i])


@core_entry
def count_part_edges(graph: Graph, guards: Guards, image: Image) -> None:
    """Count all edges of a part, drawn and frozen, in every pixel; times must be settled up to the graph's step."""
    image.n_edges[:] = 0
    for i in range(graph.counts[c.EDGES]):
        count_edge(image, graph.edge_xy[graph.members[c.EDGES, i]], 1, graph.counts[c.STEP])
    for k in range(1, 1 + guards.lists[0]):
        count_edge(image, graph.edge_xy[guards.lists[k]], 1, graph.counts[c.STEP])
