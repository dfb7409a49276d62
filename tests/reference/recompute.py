"""Twins of everything that the kernels keep up to date by increments, computed from the map alone."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels._jit import core_entry
from prf.kernels.readings import cones as cone_columns
from prf.kernels.readings import points as point_columns
from prf.kernels.readings.beams import Beams
from prf.kernels.readings.cones import Cones
from prf.kernels.readings.laser import beam_log_likelihood
from prf.kernels.state import guards as guard_columns
from prf.kernels.state.build import trace_all
from prf.kernels.state.chain import Chain
from prf.kernels.state.geometry import ray_hit
from prf.kernels.state.graph import Graph
from prf.model.coloring import Coloring, Draws, black_areas, black_at
from prf.model.layout import make_graph, make_image, make_index, pixel_centres, read_coloring
from tests.reference.arak_laws import log_density
from tests.reference.slow_coloring import slow_log_directions

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]

TOLERANCE = 1e-9
"""Relative to 1 + the magnitude: sums in another order differ by rounding."""


class Impacts(NamedTuple):
    """Where every beam meets the map: edge slots (n,), distances (n,) in metres, log likelihoods (n,) and their sum."""

    edge: Ints
    distance: Floats
    log_likelihood: Floats
    total: float


@core_entry
def impacts_from_scratch(
    graph: Graph,
    beams: Beams,
    impact_edge: np.ndarray,
    distance: np.ndarray,
    log_likelihood: np.ndarray,
) -> float:
    """Fill edge, distance and log likelihood (n,) of every beam; return the sum of log likelihoods."""
    model, ray = beams.model, beams.ray
    total = 0.0
    for beam in range(ray.shape[0]):
        best = ray[beam, c.MAX_DISTANCE]
        best_edge = c.NONE
        for i in range(graph.counts[c.EDGES]):
            edge = graph.members[c.EDGES, i]
            t = ray_hit(ray[beam], graph.edge_xy[edge])
            if t < best:
                best = t
                best_edge = edge
        impact_edge[beam] = best_edge
        distance[beam] = best if best_edge != c.NONE else math.inf
        log_likelihood[beam] = beam_log_likelihood(model, beams.weight[beam], ray[beam, c.RANGE], distance[beam])
        total += log_likelihood[beam]
    return total


def recompute_log_prior(chain: Chain) -> float:
    """Return log h of the map (equations 1-3), its directions and its black area, without any cached term."""
    coloring, scale, lines = read_coloring(chain.graph), float(chain.density[c.SCALE]), chain.lines
    found = log_density(coloring, scale)
    if lines[c.ORIENTATION] > 0.0:
        found += slow_log_directions(coloring, scale, lines[c.ORIENTATION], lines[c.ANGLE]) - lines[c.LOG_NORMALISER]
    if chain.density[c.FREE_SPACE] > 0.0:
        found -= float(chain.density[c.FREE_SPACE] * black_areas(Draws.from_colorings([coloring]))[0])
    return found


def recompute_impacts(chain: Chain) -> Impacts:
    """Return the impacts of all beams by asking every edge."""
    beams = chain.beams
    n = len(beams.ray)
    edge, distance, log_likelihood = np.zeros(n, np.int32), np.zeros(n), np.zeros(n)
    total = impacts_from_scratch(chain.graph, beams, edge, distance, log_likelihood)
    return Impacts(edge, distance, log_likelihood, total)


def recompute_cones(chain: Chain) -> Floats:
    """Return poses, extents and log likelihoods (n, N_POSE) of all sonar readings, each sensed from scratch."""
    fresh = chain.cones._replace(
        pose=chain.cones.pose.copy(), last_slot=chain.cones.last_slot.copy(), sight=chain.cones.sight
    )
    untouched = chain.beams._replace(ray=chain.beams.ray.copy(), impact_edge=chain.beams.impact_edge.copy())
    trace_all(chain._replace(cones=fresh, beams=untouched))
    return fresh.pose


def recompute_points(chain: Chain) -> tuple[NDArray[np.bool_], Floats, float]:
    """Return colour (n,) and gain of turning (n,) of every point observation, and the sum of their log densities."""
    column = chain.points.column
    black = black_at(read_coloring(chain.graph), column[[point_columns.X, point_columns.Y]].T)
    white_density, black_density = column[[point_columns.LOG_WHITE, point_columns.LOG_BLACK]]
    gain = np.where(black, white_density - black_density, black_density - white_density)
    return black, gain, float(np.where(black, black_density, white_density).sum())


def recompute_listed_cones(chain: Chain) -> NDArray[np.bool_]:
    """Return which slots of cones should be listed: the first, and those that are entered within the extent."""
    cones = chain.cones
    n_slots = np.diff(cones.slot_start)
    cone = np.repeat(np.arange(len(n_slots)), n_slots)
    listed: NDArray[np.bool_] = cones.slot_near <= cones.pose[cone, cone_columns.EXTENT]
    listed[cones.slot_start[:-1][n_slots > 0]] = True
    return listed


def recompute_sets(coloring: Coloring) -> list[int]:
    """Return the sizes of the sets that moves sample from, counted on the bare graph."""
    neighbors: list[set[int]] = [set() for _ in coloring.xy]
    for a, b in coloring.edges.tolist():
        neighbors[a].add(b)
        neighbors[b].add(a)
    side = coloring.side.tolist()
    interior = [v for v in range(len(side)) if side[v] == c.INTERIOR]
    pairs = [sorted(neighbors[v]) for v in interior]
    adjacent = [1 for a, b in coloring.edges.tolist() if side[a] >= 0 and side[b] >= 0 and (side[a] - side[b]) % 2]
    return [
        len(coloring.edges),
        len(interior),
        len(side) - len(interior),
        sum(b in neighbors[a] for a, b in pairs),
        sum(side[a] >= 0 and side[a] == side[b] for a, b in pairs),
        len(adjacent),
    ]


def recompute_edge_cells(chain: Chain) -> list[list[int]]:
    """Return the sorted edges of every cell, from a fresh index."""
    fresh = make_index(chain.graph, chain.edge_index.grid, chain.edge_index.cell_edges.shape[1])
    return cell_lists(fresh.cell_edges, fresh.cell_count)


def cell_lists(cell_edges: Ints, cell_count: Ints) -> list[list[int]]:
    """Return the sorted edges of every cell of an index."""
    return [sorted(row[:n].tolist()) for row, n in zip(cell_edges, cell_count, strict=True)]


def recompute_listed(chain: Chain) -> NDArray[np.bool_]:
    """Return which slots of beams should be listed: those up to the impact."""
    beams = chain.beams
    n_slots = np.diff(beams.slot_start)
    beam = np.repeat(np.arange(len(n_slots)), n_slots)
    before = np.concatenate([[np.float32(-1.0)], beams.slot_exit[:-1]])
    before[beams.slot_start[:-1][n_slots > 0]] = -1.0
    listed: NDArray[np.bool_] = before < beams.ray[beam, c.DISTANCE]
    return listed


def listed_now(readings: Beams | Cones) -> NDArray[np.bool_]:
    """Return which slots of beams or cones are found in the list of their cell, each at the place that it claims."""
    listed = np.zeros(len(readings.slot_cell), bool)
    for cell in np.flatnonzero(readings.cell_count):
        start = readings.cell_start[cell]
        slots = readings.entries[start : start + readings.cell_count[cell], 1]
        right = (readings.slot_cell[slots] == cell) & (readings.slot_place[slots] == np.arange(len(slots)))
        owner = readings.entries[start : start + readings.cell_count[cell], 0]
        right &= (readings.slot_start[owner] <= slots) & (slots < readings.slot_start[owner + 1])
        listed[slots[right]] = True
    return listed


def recompute_shortfalls(chain: Chain) -> tuple[Floats, Floats]:
    """Return what beams lack to their best log likelihood, summed by edge met and level, and by list of readings."""
    beams = chain.beams
    impacts = recompute_impacts(chain)
    shortfall = beams.best - impacts.log_likelihood
    by_edge, by_cell = np.zeros_like(beams.edge_shortfall), np.zeros_like(beams.cell_shortfall)
    met = impacts.edge != c.NONE
    np.add.at(by_edge, (impacts.edge[met], beams.level[met]), shortfall[met])
    n_cells = beams.aim[:, 1] - beams.aim[:, 0]
    offset = np.arange(n_cells.sum()) - np.repeat(np.cumsum(n_cells) - n_cells, n_cells)
    np.add.at(by_cell, beams.slot_cell[np.repeat(beams.aim[:, 0], n_cells) + offset], np.repeat(shortfall, n_cells))
    return by_edge, by_cell


def shortfalls_hold(chain: Chain) -> bool:
    """Whether the shortfalls by edge and by cell equal those summed anew; of edges and cells in use."""
    by_edge, by_cell = recompute_shortfalls(chain)
    edges = chain.graph.members[c.EDGES, : chain.graph.counts[c.EDGES]]
    now = np.concatenate([chain.beams.edge_shortfall[edges].ravel(), chain.beams.cell_shortfall])
    anew = np.concatenate([by_edge[edges].ravel(), by_cell])
    return bool(np.allclose(now, anew, rtol=TOLERANCE, atol=TOLERANCE * len(chain.beams.best)))


def beams_by_edge(chain: Chain) -> dict[int, list[int]]:
    """Return the beams linked to each edge, sorted."""
    beams = chain.beams
    linked: dict[int, list[int]] = {}
    for edge, level in np.argwhere(beams.first_beam != c.NONE).tolist():
        beam = int(beams.first_beam[edge, level])
        while beam != c.NONE:
            linked.setdefault(edge, []).append(beam if beams.level[beam] == level else c.NONE)
            beam = int(beams.next_beam[beam])
    return {edge: sorted(row) for edge, row in linked.items()}


def differences(chain: Chain) -> list[str]:
    """Return the names of the incremental quantities that differ from their twins (none: all hold)."""
    graph, coloring = chain.graph, read_coloring(chain.graph)
    impacts, cones = recompute_impacts(chain), recompute_cones(chain)
    black, gain, points_total = recompute_points(chain)
    total = impacts.total + float(cones[:, cone_columns.CONE_LOG_LIKELIHOOD].sum()) + points_total
    by_edge: dict[int, list[int]] = {}
    for beam in np.flatnonzero(impacts.edge != c.NONE).tolist():
        by_edge.setdefault(int(impacts.edge[beam]), []).append(beam)
    holds = {
        "log prior": is_close(graph.sums[c.LOG_PRIOR], recompute_log_prior(chain)),
        "log likelihood": is_close(graph.sums[c.LOG_LIKELIHOOD], total),
        "total length": is_close(graph.sums[c.TOTAL_LENGTH], coloring.total_length()),
        "impact edges": np.array_equal(impacts.edge, chain.beams.impact_edge),
        "impact distances": np.array_equal(impacts.distance, chain.beams.ray[:, c.DISTANCE]),
        "beam log likelihoods": np.array_equal(impacts.log_likelihood, chain.beams.ray[:, c.BEAM_LOG_LIKELIHOOD]),
        "beams by edge": by_edge == beams_by_edge(chain),
        "shortfalls of beams": shortfalls_hold(chain),
        "beam index": np.array_equal(recompute_listed(chain), listed_now(chain.beams)),
        "cones": np.array_equal(cones, chain.cones.pose),
        "cone index": np.array_equal(recompute_listed_cones(chain), listed_now(chain.cones)),
        "point colours": np.array_equal(black, chain.points.column[point_columns.BLACK]),
        "point gains": np.array_equal(gain, chain.points.column[point_columns.GAIN]),
        "edge index": recompute_edge_cells(chain)
        == cell_lists(chain.edge_index.cell_edges, chain.edge_index.cell_count),
        "sets": recompute_sets(coloring) == graph.counts[: c.N_SETS].tolist(),
        "sines": sines_hold(chain, coloring),
        "occupied sensors": sensors_hold(chain, coloring),
        "image": image_holds(chain, coloring),
    }
    return [name for name, held in holds.items() if not held]


def is_close(value: float, twin: float) -> bool:
    """Whether a sum by increments equals its twin up to rounding."""
    return abs(value - twin) <= TOLERANCE * (1.0 + abs(twin))


def sines_hold(chain: Chain, coloring: Coloring) -> bool:
    """Whether the cached sines and lengths equal those of a fresh graph."""
    fresh = make_graph(coloring, 2 * len(coloring.xy) + c.MOST_CHANGES)
    graph = chain.graph
    slots = np.concatenate(
        [graph.members[kind, : graph.counts[kind]] for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES)]
    )
    edges = graph.members[c.EDGES, : graph.counts[c.EDGES]]
    sines = np.allclose(graph.vertex_sine[slots], fresh.vertex_sine[: len(slots)], rtol=1e-9, atol=0.0)
    return sines and np.allclose(graph.edge_length[edges], coloring.edge_lengths(), rtol=1e-12, atol=0.0)


def recompute_blocked(chain: Chain, coloring: Coloring) -> int:
    """Return the number of pairs of an edge and a piece of the way nearer to each other than the piece's radius."""
    pieces = chain.guards.shape[chain.guards.shape[:, guard_columns.KIND] == guard_columns.GUARD_WAY]
    ways, edges = (shapely.linestrings(ends.reshape(-1, 2, 2)) for ends in (pieces[:, 1:5], coloring.segments()))
    return int((shapely.distance(edges[:, None], ways) <= pieces[:, 5]).sum())


def sensors_hold(chain: Chain, coloring: Coloring) -> bool:
    """Whether the colours of the sensors are those of the map, and black ones and blocked pieces of the way counted.

    There is none of either where none may be.
    """
    black = black_at(coloring, chain.sensors.xy)
    n = int(black.sum()) + recompute_blocked(chain, coloring)
    counted = np.array_equal(black, chain.sensors.black) and n == chain.graph.counts[c.OCCUPIED]
    return counted and (n == 0 or bool(np.isfinite(chain.density[c.OCCUPIED_COST])))


def image_holds(chain: Chain, coloring: Coloring) -> bool:
    """Whether the pixels' colours and edge counts equal those of a fresh image."""
    image = chain.image
    if image.black.size == 0:
        return True
    fresh = make_image(coloring, chain.graph, image.grid.cell)
    centres = pixel_centres(image.grid)
    inside = coloring.window.contains(centres)
    colours = black_at(coloring, centres)
    return np.array_equal(colours[inside], image.black[inside]) and np.array_equal(fresh.n_edges, image.n_edges)
