"""The chain of one tile: what lies inside it can be drawn, what crosses its border stays.

Every beam belongs to the tile that holds its end; this depends on the reading alone. Let f be the distance of the first
obstacle on the beam that does not lie inside the tile to which it belongs. The other tiles leave f as it is: no new
edge may cut it short, and the edge at f stays. Then the impact, the nearer of f and of what the own tile
puts on the beam, is decided by one tile, and the likelihood is a product over tiles. A round is a step of the chain on
the maps that have this f for every beam, and these classes part the space of all maps.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings.beams import Beams, find_aims
from prf.kernels.readings.points import Points
from prf.kernels.state.build import fill_graph, recompute_sums, trace_all
from prf.kernels.state.cell_lists import first_segments
from prf.kernels.state.chain import Chain
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import ABS_TOL, REL_TOL, Grid, make_grid, most_cells
from prf.kernels.state.guards import GUARD_RAY, GUARD_TRIANGLE, N_SHAPE, Guards, mark_met
from prf.kernels.state.image import Image, count_edges
from prf.kernels.state.targets import Targets
from prf.model.coloring import Coloring, black_at
from prf.model.layout import bare_graph, make_guards, make_index, make_proposal, make_sites, white_image
from prf.model.ranges import MARGIN, aims_of, make_beams, make_cones
from prf.model.window import Window
from prf.readings.way import ways_near
from prf.sampler.target import FIRST_CAPACITY, FIRST_CELL_ROOM, PointData, painted_points
from prf.sampler.tiles.rounds import Round, TileData, tiles_at

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Part(NamedTuple):
    """The chain of one tile at its start."""

    chain: Chain
    beams: Ints  # (n,): the beams that it holds
    drawn: Ints  # (k,): edges of the round's map that it can draw
    vertices: Ints  # (m,): vertex of the round's map in each of its first slots
    pinned: Ints  # (p,): slots of vertices that keep an edge whatever happens
    pixels: Ints  # (q,): pixels of the image that belong to it


class Shared(NamedTuple):
    """Beams in a tile."""

    own: Ints  # (n,): beams that belong to the tile and that something inside it could stop
    # (n, 2): where these enter the tile, and where they leave it or are stopped by what stays outside, metres
    span: Floats
    beyond: Floats  # (n,): distance at which that stops them if nothing inside does; inf: nothing
    guards: Floats  # (m, N_SHAPE): beams of other tiles up to the first obstacle that does not lie inside their own
    stops: Ints  # (k,): edges that are such obstacles


def make_part(data: TileData, begun: Round, number: int) -> Part:
    """Build the chain of the tile `number` of a round."""
    tile = begun.tiles[number]
    beams = share_beams(data, begun, number)
    own_cones, triangles = share_cones(data, tile)
    segments = begun.coloring.segments()
    is_drawn = begun.edge_tile == number
    is_drawn[beams.stops] = False
    is_met = np.zeros(int(is_drawn.sum()), np.uint8)
    mark_met(triangles, segments[is_drawn], is_met)
    is_drawn[np.flatnonzero(is_drawn)[is_met != 0]] = False
    grid = make_grid(*Window(*tile.tolist()), data.target.cell_size())
    coloring, vertices, edges = cut_out(begun.coloring, _passes(segments, tile), tile)
    # A cost of black asks for colours, which moves know from that of the centre.
    coloring = coloring._replace(anchor_black=bool(black_at(begun.coloring, [0.5 * (tile[:2] + tile[2:])])[0]))
    drawn = is_drawn[edges]
    graph = bare_graph(coloring, max(FIRST_CAPACITY, 2 * (len(vertices) + c.MOST_CHANGES)))
    fill_graph(graph, len(vertices), coloring.edges, drawn)
    frozen = np.flatnonzero(_passes(segments[edges], tile) & ~drawn)
    ways = data.ways[ways_near(data.ways, tile)]
    guards = make_guards(grid, frozen, np.concatenate([beams.guards, _triangle_guards(triangles), ways]))
    image, pixels = cut_image(data, begun, tile)
    chain = _assemble(data, begun, tile, graph, frozen, guards, image, beams, own_cones)
    return Part(
        chain,
        beams.own,
        np.flatnonzero(is_drawn),
        vertices,
        np.unique(coloring.edges[~drawn]).astype(np.int64),
        pixels,
    )


def share_beams(data: TileData, begun: Round, number: int) -> Shared:
    """Find which beams the tile answers for, which it guards, and what stops both."""
    span = clip_beams(data.ray, data.influence, begun.tiles[number])
    passing = np.flatnonzero(span[:, 0] < np.inf)
    owner = tiles_at(begun.tiles, data.end[passing])
    is_own = owner == number
    limit = np.where(is_own, data.influence[passing], span[passing, 1])
    ray = data.ray[passing]
    stop, distance = np.zeros(len(passing), np.int32), np.zeros(len(passing))
    path = np.zeros(most_cells(begun.edges.grid), np.int32)
    first_segments(begun.edges, begun.edge_tile, ray, owner, limit, path, stop, distance)
    counts = distance > span[passing, 0]
    own, foreign = is_own & counts, ~is_own & counts
    guards = np.zeros((int(foreign.sum()), N_SHAPE))
    guards[:, 0] = GUARD_RAY
    guards[:, 1:5] = ray[foreign, : c.DIRECTION_Y + 1]
    guards[:, 5] = distance[foreign]
    guards[:, 6] = span[passing[foreign], 0]
    stops = np.unique(stop[foreign & (stop != c.NONE)]).astype(np.int64)
    return Shared(
        passing[own],
        np.column_stack([span[passing[own], 0], np.minimum(span[passing[own], 1], distance[own])]),
        np.where(stop[own] != c.NONE, distance[own], np.inf),
        guards,
        stops,
    )


def clip_beams(ray: Floats, influence: Floats, tile: Floats) -> Floats:
    """Return between which distances (n, 2) each beam passes the tile within its influence; (inf, -inf) for never."""
    origin, direction = ray[:, : c.ORIGIN_Y + 1], ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (tile[:2] - origin) / direction, (tile[2:] - origin) / direction
    always = (tile[:2] < origin) & (origin < tile[2:])
    enters = np.where(direction == 0.0, np.where(always, -np.inf, np.inf), np.minimum(low, high))
    leaves = np.where(direction == 0.0, np.where(always, np.inf, -np.inf), np.maximum(low, high))
    first, last = enters.max(axis=1, initial=0.0), np.minimum(leaves.min(axis=1), influence)
    return np.where((first < last)[:, None], np.stack([first, last], axis=1), [np.inf, -np.inf])


def share_cones(data: TileData, tile: Floats) -> tuple[Ints, Floats]:
    """Return the sonar readings whose cones lie in the tile (n,), and triangles (m, 6) round others that meet it."""
    window = np.array(data.target.window, np.float64)
    corners = data.triangle.reshape(-1, 3, 2)
    low = np.maximum(corners.min(axis=1), window[:2]) if len(corners) else np.zeros((0, 2))
    high = np.minimum(corners.max(axis=1), window[2:]) if len(corners) else np.zeros((0, 2))
    inside = ((tile[:2] < low) | (tile[:2] == window[:2])) & ((high < tile[2:]) | (tile[2:] == window[2:]))
    is_own = inside.all(axis=1)
    meets = ((low <= tile[2:]) & (tile[:2] <= high)).all(axis=1)
    return np.flatnonzero(is_own), data.triangle[meets & ~is_own]


def _triangle_guards(triangles: Floats) -> Floats:
    """Return the guards that keep triangles (n, 6) free of new edges."""
    return np.column_stack([np.full(len(triangles), GUARD_TRIANGLE), triangles])


def _passes(segments: Floats, box: Floats) -> NDArray[np.bool_]:
    """Return whether segments (n, 4) pass a box (4,)."""
    start, direction = segments[:, :2], segments[:, 2:] - segments[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        first, last = (box[:2] - start) / direction, (box[2:] - start) / direction
    outside = (direction == 0.0) & ((start < box[:2]) | (start > box[2:]))
    enters = np.where(direction == 0.0, 0.0, np.minimum(first, last)).max(axis=1, initial=0.0)
    leaves = np.where(direction == 0.0, 1.0, np.maximum(first, last)).min(axis=1, initial=1.0)
    return np.asarray((enters <= leaves) & ~outside.any(axis=1), np.bool_)


def cut_out(whole: Coloring, passes: NDArray[np.bool_], tile: Floats) -> tuple[Coloring, Ints, Ints]:
    """Return the edges that pass a tile and those next to them, as a map, with the vertices and edges of the whole.

    Moves read the other edges of vertices at the ends of passing edges.
    """
    is_near = np.zeros(len(whole.xy), np.bool_)
    is_near[whole.edges[passes]] = True
    edges = np.flatnonzero(is_near[whole.edges].any(axis=1))
    vertices, ends = np.unique(whole.edges[edges], return_inverse=True)
    part = Coloring(
        Window(*tile.tolist()),
        whole.xy[vertices],
        whole.side[vertices],
        ends.reshape(-1, 2).astype(np.int32),
        False,
    )
    return part, vertices.astype(np.int64), edges


def cut_image(data: TileData, begun: Round, tile: Floats) -> tuple[Image, Ints]:
    """Return the image of a tile, its times at nothing, and the pixels of the whole image that it has."""
    whole = begun.pixels
    if whole.nx == 0:
        i0 = i1 = k0 = k1 = 0
    else:
        i0, i1 = (round(x) for x in (tile[[0, 2]] - whole.x0) / whole.cell)
        k0, k1 = (round(y) for y in (tile[[1, 3]] - whole.y0) / whole.cell)
        i1 = whole.nx if tile[2] == data.target.window.x_max else i1
        k1 = whole.ny if tile[3] == data.target.window.y_max else k1
    grid = Grid(whole.x0 + i0 * whole.cell, whole.y0 + k0 * whole.cell, whole.cell, i1 - i0, k1 - k0)
    pixels = (np.arange(i0, i1)[None, :] + whole.nx * np.arange(k0, k1)[:, None]).ravel()
    return white_image(grid)._replace(black=begun.black[pixels]), pixels


def _assemble(
    data: TileData,
    begun: Round,
    tile: Floats,
    graph: Graph,
    frozen: Ints,
    guards: Guards,
    image: Image,
    beams: Shared,
    own_cones: Ints,
) -> Chain:
    """Return the chain of a tile with its readings sensed."""
    target, window = data.target, Window(*tile.tolist())
    grid = make_grid(*window, target.cell_size())
    capacity = len(graph.edge_length)
    targets = cut_targets(data.targets._replace(cumulative=begun.aim), window)
    tuning = begun.tuning.copy()
    if len(targets.cell) == 0:
        tuning[c.AIMED_SHARE] = 0.0
    sensors = data.sensors[window.contains(data.sensors)]
    chain = Chain(
        graph=graph,
        edge_index=make_index(graph, grid, FIRST_CELL_ROOM, frozen.astype(np.int32)),
        beams=part_beams(data, grid, beams, capacity),
        cones=make_cones(grid, data.sonar, data.pose[own_cones], capacity),
        points=part_points(target.points, begun.coloring, window),
        sensors=make_sites(grid, sensors, begun.coloring if np.isfinite(begun.density[c.OCCUPIED_COST]) else None),
        targets=targets,
        image=image,
        guards=guards,
        proposal=make_proposal(grid),
        density=begun.density,
        lines=begun.lines,
        tuning=tuning,
        move_probabilities=begun.move_probabilities,
        outcomes=np.zeros((c.N_MOVES, c.N_OUTCOMES), np.int64),
    )
    if image.black.size > 0:
        edges = np.append(graph.members[c.EDGES, : graph.counts[c.EDGES]], frozen)
        count_edges(image, graph.edge_xy[edges], int(graph.counts[c.STEP]))
    trace_all(chain)
    recompute_sums(chain)
    return chain


def cut_targets(whole: Targets, window: Window) -> Targets:
    """Return the targets that a window meets, with those near each among them."""
    grid = whole.grid
    low, high = (np.array(corner) - (grid.x0, grid.y0) for corner in (window[:2], window[2:]))
    (i0, k0), (i1, k1) = (np.floor(corner / grid.cell).astype(int) for corner in (low, high))
    ix, iy = whole.cell % grid.nx, whole.cell // grid.nx
    inside = (i0 <= ix) & (ix <= i1) & (k0 <= iy) & (iy <= k1)
    part = Grid(grid.x0 + i0 * grid.cell, grid.y0 + k0 * grid.cell, grid.cell, int(i1 - i0 + 1), int(k1 - k0 + 1))
    kept = np.flatnonzero(inside)
    renumbered = np.full(len(whole.cell), c.NONE, np.int32)
    renumbered[kept] = np.arange(len(kept), dtype=np.int32)
    cell = (ix[kept] - i0 + part.nx * (iy[kept] - k0)).astype(np.int32)
    number = np.full(part.nx * part.ny, c.NONE, np.int32)
    number[cell] = np.arange(len(kept), dtype=np.int32)
    counts = np.diff(whole.near_start)
    near = renumbered[whole.near[np.repeat(inside, counts)]]
    owner = np.repeat(np.arange(len(kept)), counts[kept])[near != c.NONE]
    start = np.searchsorted(owner, np.arange(len(kept) + 1))
    cumulative = np.cumsum(np.diff(whole.cumulative, prepend=0.0)[kept])
    if len(kept) > 0:
        cumulative /= cumulative[-1]
    return Targets(part, cell, cumulative, number, start.astype(np.int64), near[near != c.NONE])


def part_beams(data: TileData, grid: Grid, shared: Shared, capacity: int) -> Beams:
    """Return the beams of a tile: listed from where they enter it, with what stops them beyond."""
    ray = data.ray[shared.own]
    enter, end = shared.span.T
    moved = ray.copy()
    moved[:, : c.ORIGIN_Y + 1] += enter[:, None] * ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1]
    moved[:, c.MAX_DISTANCE] = end - enter
    beams = make_beams(grid, data.laser, moved, data.weight[shared.own], capacity, data.target.execution.levels)
    ray[:, c.MAX_DISTANCE] = end
    # Exits are distances from the sensor, rounded down as before.
    exits = beams.slot_exit + np.repeat(enter, np.diff(beams.slot_start))
    exits = exits * (1.0 - REL_TOL) - ABS_TOL
    last = beams.slot_start[1:] - 1
    exits[last] = end
    slot_exit = exits.astype(np.float32)
    near, far = aims_of(data.laser, ray[:, c.RANGE], beams.weight)
    aim = np.zeros_like(beams.aim)
    find_aims(near - MARGIN, far + MARGIN, beams.slot_start, slot_exit, aim)
    return beams._replace(ray=ray, beyond=shared.beyond, slot_exit=slot_exit, aim=aim)


def part_points(data: PointData | None, coloring: Coloring, window: Window) -> Points:
    """Return the point observations in a tile, in the colours of the map."""
    if data is None:
        return painted_points(None, coloring)
    return painted_points(dataclasses.replace(data, readings=data.readings.inside(window)), coloring)
