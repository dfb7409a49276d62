"""Figure 2 (a): birth of a triangle in the interior, and its death."""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.graph import Graph, other_end, pick
from prf.kernels.moves.placing import area, is_inside, near_density, random_reach
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join, place_vertex, turn_at_vertex


@core
def distance(graph: Graph, a: int, b: int) -> float:
    """Distance between two vertices."""
    dx = graph.vertex_xy[a, 0] - graph.vertex_xy[b, 0]
    dy = graph.vertex_xy[a, 1] - graph.vertex_xy[b, 1]
    return math.sqrt(dx * dx + dy * dy)


@core
def birth_density(graph: Graph, tuning: np.ndarray, u: int, v: int, w: int) -> float:
    """Density with which a birth proposes the unordered triangle u, v, w.

    Uniform births: 3! orders of three uniform points. Local births: any of the three may have been the first
    (uniform), and the other two come in either order round it.
    """
    surface = area(graph.window)
    median = tuning[c.BIRTH_REACH]
    near_uv = near_density(distance(graph, u, v), median)
    near_vw = near_density(distance(graph, v, w), median)
    near_wu = near_density(distance(graph, w, u), median)
    local = 2.0 * (near_uv * near_wu + near_uv * near_vw + near_vw * near_wu) / surface
    uniform = 6.0 / (surface * surface * surface)
    return tuning[c.LOCAL_SHARE] * local + (1.0 - tuning[c.LOCAL_SHARE]) * uniform


@core
def uniform_vertex(graph: Graph, proposal: Proposal, rng: np.random.Generator) -> int:
    """New vertex, uniform in the window."""
    window = graph.window
    x = window[0] + rng.random() * (window[2] - window[0])
    y = window[1] + rng.random() * (window[3] - window[1])
    return place_vertex(graph, proposal, x, y, c.INTERIOR)


@core
def vertex_near(graph: Graph, proposal: Proposal, u: int, median: float, rng: np.random.Generator) -> int:
    """New vertex near u, perhaps outside the window."""
    r = random_reach(rng, median)
    direction = 2.0 * math.pi * rng.random()
    x = graph.vertex_xy[u, 0] + r * math.cos(direction)
    y = graph.vertex_xy[u, 1] + r * math.sin(direction)
    return place_vertex(graph, proposal, x, y, c.INTERIOR)


@core
def propose_birth(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose a triangle: three uniform points, or two round a uniform first."""
    is_local = rng.random() < tuning[c.LOCAL_SHARE]
    u = uniform_vertex(graph, proposal, rng)
    if is_local:
        v = vertex_near(graph, proposal, u, tuning[c.BIRTH_REACH], rng)
        w = vertex_near(graph, proposal, u, tuning[c.BIRTH_REACH], rng)
    else:
        v = uniform_vertex(graph, proposal, rng)
        w = uniform_vertex(graph, proposal, rng)
    for k in range(3):
        vertex = proposal.new_vertices[k]
        if not is_inside(graph.window, graph.vertex_xy[vertex, 0], graph.vertex_xy[vertex, 1]):
            return False, 0.0
        turn_at_vertex(graph, proposal, vertex)
    join(graph, proposal, u, v)
    join(graph, proposal, v, w)
    join(graph, proposal, w, u)
    triangles = graph.counts[c.TRIANGLE_VERTICES] // 3 + 1
    forward = odds[c.TRIANGLE_BIRTH] * birth_density(graph, tuning, u, v, w)
    return True, math.log(odds[c.TRIANGLE_DEATH] / (triangles * forward))


@core
def propose_death(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose to remove a uniform triangle."""
    if graph.counts[c.TRIANGLE_VERTICES] == 0:
        return False, 0.0
    u = pick(graph, c.TRIANGLE_VERTICES, rng)
    first = graph.vertex_edges[u, 0]
    last = graph.vertex_edges[u, 1]
    v = other_end(graph, first, u)
    w = other_end(graph, last, u)
    middle = graph.vertex_edges[v, 0]
    if middle == first:
        middle = graph.vertex_edges[v, 1]
    drop_edge(proposal, first)
    drop_edge(proposal, middle)
    drop_edge(proposal, last)
    for vertex in (u, v, w):
        drop_vertex(proposal, vertex)
        turn_at_vertex(graph, proposal, vertex)
    triangles = graph.counts[c.TRIANGLE_VERTICES] // 3
    backward = odds[c.TRIANGLE_BIRTH] * birth_density(graph, tuning, u, v, w)
    return True, math.log(backward * triangles / odds[c.TRIANGLE_DEATH])
