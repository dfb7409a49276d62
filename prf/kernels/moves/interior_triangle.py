"""Figure 2 (a): birth of a triangle in the interior, and its death."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.state import proposal as edit
from prf.kernels.state.graph import Graph, distance, edges_at, neighbors_of, outer_edge, pick
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal
from prf.kernels.state.targets import (
    Targets,
    first_density,
    pick_near,
    pick_target,
    point_in,
    second_density,
    target_of,
)


@core
def cluster_density(
    graph: Graph, median: float, u: int, v: int, w: int, first_u: float, first_v: float, first_w: float
) -> float:
    """Density of the unordered triangle u, v, w if any was the first, with these densities, and two lie round it."""
    near_uv = placing.near_density(distance(graph, u, v), median)
    near_vw = placing.near_density(distance(graph, v, w), median)
    near_wu = placing.near_density(distance(graph, w, u), median)
    return 2.0 * (first_u * near_uv * near_wu + first_v * near_uv * near_vw + first_w * near_vw * near_wu)


@core
def free_density(graph: Graph, tuning: Array, u: int, v: int, w: int) -> float:
    """Density of the unordered triangle u, v, w among births that know nothing of the readings.

    Uniform births: 3! orders of three uniform points. Local births: any of the three may have been the first
    (uniform), and the other two are drawn in either order round it.
    """
    surface = placing.area(graph.window)
    local = cluster_density(graph, tuning[c.BIRTH_REACH], u, v, w, 1.0, 1.0, 1.0) / surface
    uniform = 6.0 / (surface * surface * surface)
    return tuning[c.LOCAL_SHARE] * local + (1.0 - tuning[c.LOCAL_SHARE]) * uniform


@core
def post_density(graph: Graph, targets: Targets, tuning: Array, median: float, u: int, v: int, w: int) -> float:
    """Density of the unordered triangle u, v, w among aimed births of a post: two vertices round one in a target."""
    first_u = first_density(targets, tuning, target_of(targets, graph, u))
    first_v = first_density(targets, tuning, target_of(targets, graph, v))
    first_w = first_density(targets, tuning, target_of(targets, graph, w))
    return cluster_density(graph, median, u, v, w, first_u, first_v, first_w)


@core
def panel_density(graph: Graph, targets: Targets, tuning: Array, median: float, u: int, v: int, apex: int) -> float:
    """Density of a panel: one end in a target, the other in one near it, the apex beside the line of both."""
    one = target_of(targets, graph, u)
    other = target_of(targets, graph, v)
    ends = first_density(targets, tuning, one) * second_density(targets, one, other)
    ends += first_density(targets, tuning, other) * second_density(targets, other, one)
    if ends == 0.0:
        return 0.0
    x = graph.vertex_xy[apex, 0]
    y = graph.vertex_xy[apex, 1]
    return ends * placing.beside_density(graph.vertex_xy[u], graph.vertex_xy[v], x, y, median)


@core
def aimed_density(graph: Graph, targets: Targets, tuning: Array, median: float, u: int, v: int, w: int) -> float:
    """Density of the unordered triangle u, v, w among aimed births of one size."""
    density = post_density(graph, targets, tuning, median, u, v, w)
    density += panel_density(graph, targets, tuning, median, u, v, w)
    density += panel_density(graph, targets, tuning, median, v, w, u)
    return 0.5 * (density + panel_density(graph, targets, tuning, median, w, u, v))


@core
def birth_density(graph: Graph, targets: Targets, tuning: Array, u: int, v: int, w: int) -> float:
    """Density with which a birth proposes the unordered triangle u, v, w."""
    aimed = tuning[c.AIMED_SHARE]
    density = (1.0 - aimed) * free_density(graph, tuning, u, v, w)
    if aimed > 0.0:
        for size in range(placing.N_SIZES):
            median = placing.reach_of(tuning, size)
            density += aimed / placing.N_SIZES * aimed_density(graph, targets, tuning, median, u, v, w)
    return density


@core
def draw_free(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> tuple[int, int, int]:
    """Three uniform vertices, or two round a uniform first."""
    is_local = rng.random() < tuning[c.LOCAL_SHARE]
    u = placing.uniform_vertex(graph, proposal, rng)
    if is_local:
        v = placing.vertex_near(graph, proposal, u, tuning[c.BIRTH_REACH], rng)
        return u, v, placing.vertex_near(graph, proposal, u, tuning[c.BIRTH_REACH], rng)
    v = placing.uniform_vertex(graph, proposal, rng)
    return u, v, placing.uniform_vertex(graph, proposal, rng)


@core
def draw_aimed(graph: Graph, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng) -> tuple[int, int, int]:
    """A post at a return, or a panel along two returns, of one of the sizes."""
    median = placing.reach_of(tuning, int(rng.random() * placing.N_SIZES))
    is_post = rng.random() < 0.5
    target = pick_target(targets, tuning, rng)
    x, y = point_in(targets, target, rng)
    u = edit.add_vertex(graph, proposal, x, y, c.INTERIOR)
    if is_post:
        v = placing.vertex_near(graph, proposal, u, median, rng)
        return u, v, placing.vertex_near(graph, proposal, u, median, rng)
    x, y = point_in(targets, pick_near(targets, target, rng), rng)
    v = edit.add_vertex(graph, proposal, x, y, c.INTERIOR)
    x, y = placing.beside(graph.vertex_xy[u], graph.vertex_xy[v], median, rng)
    return u, v, edit.add_vertex(graph, proposal, x, y, c.INTERIOR)


@core
def propose_birth(graph: Graph, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose a triangle: anywhere, or aimed at returns."""
    if tuning[c.AIMED_SHARE] > 0.0 and rng.random() < tuning[c.AIMED_SHARE]:
        u, v, w = draw_aimed(graph, targets, proposal, tuning, rng)
    else:
        u, v, w = draw_free(graph, proposal, tuning, rng)
    for vertex in (u, v, w):
        if not placing.is_in_window(graph, vertex):
            return ILLEGAL
        edit.turn_at_vertex(graph, proposal, vertex)
    edit.add_edge(graph, proposal, u, v)
    edit.add_edge(graph, proposal, v, w)
    edit.add_edge(graph, proposal, w, u)
    density = birth_density(graph, targets, tuning, u, v, w)
    if density == 0.0:
        return ILLEGAL  # rounding put the apex of a panel on the line of its ends
    return True, math.log(density), -math.log(graph.counts[c.TRIANGLE_VERTICES] // 3 + 1)


@core
def propose_death(graph: Graph, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to remove a uniform triangle."""
    if graph.counts[c.TRIANGLE_VERTICES] == 0:
        return ILLEGAL
    u = pick(graph, c.TRIANGLE_VERTICES, rng)
    first, last = edges_at(graph, u)
    v, w = neighbors_of(graph, u)
    edit.remove_edges(proposal, (first, outer_edge(graph, v, first), last))
    edit.remove_vertices(proposal, (u, v, w))
    edit.turn_round(graph, proposal, (u, v, w))
    log_forward = -math.log(graph.counts[c.TRIANGLE_VERTICES] // 3)
    return True, log_forward, placing.log_or_minus_infinity(birth_density(graph, targets, tuning, u, v, w))
