"""Impacts of all beams by asking every edge: the slow twin of the index of beams."""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core_entry
from prf.kernels.geometry import ray_hit
from prf.kernels.graph import Graph
from prf.kernels.laser import beam_log_likelihood


@core_entry
def impacts_from_scratch(
    graph: Graph,
    model: np.ndarray,
    ray: np.ndarray,
    impact_edge: np.ndarray,
    distance: np.ndarray,
    log_likelihood: np.ndarray,
) -> float:
    """Fill edge, distance and log likelihood (n,) of every beam; return the sum of log likelihoods."""
    total = 0.0
    for beam in range(ray.shape[0]):
        best = ray[beam, c.REACH]
        best_edge = c.NONE
        for i in range(graph.counts[c.EDGES]):
            edge = graph.members[c.EDGES, i]
            xy = graph.edge_xy[edge]
            t = ray_hit(
                ray[beam, c.ORIGIN_X],
                ray[beam, c.ORIGIN_Y],
                ray[beam, c.DIRECTION_X],
                ray[beam, c.DIRECTION_Y],
                xy[0],
                xy[1],
                xy[2],
                xy[3],
            )
            if t < best:
                best = t
                best_edge = edge
        impact_edge[beam] = best_edge
        distance[beam] = best if best_edge != c.NONE else math.inf
        log_likelihood[beam] = beam_log_likelihood(model, ray[beam, c.RANGE], distance[beam])
        total += log_likelihood[beam]
    return total
