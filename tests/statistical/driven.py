"""Chains of the prior whose way driven is free, and exact draws that are rejected or weighted for the same law."""

from __future__ import annotations

import numpy as np

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at_draws
from prf.model.layout import make_guards, read_coloring
from prf.model.window import Window
from prf.sampler.target import Target, make_chain, run_chain
from tests.reference.free_way import obstacles
from tests.statistical.means import Floats, Mean, weighted_mean

ROOM = Window(0.0, 0.0, 6.0, 6.0)
WAY = np.array([[2.0, 2.0, 3.2, 2.6], [3.2, 2.6, 3.4, 3.1], [4.5, 4.2, 4.5, 4.2]])
RADIUS = 0.2
TARGET = Target(ROOM, 0.25, way=WAY, driven_radius=RADIUS)
"""28 edges that meet no border in the mean of the prior, of which one draw in eighteen leaves the way free."""
PLACES = np.array([[1.5, 2.2], [2.5, 3.2], [4.0, 3.5], [5.5, 5.5], [0.4, 5.0], [4.9, 1.0]])
NAMES = ("edges", "length", "black area", "edges near", *(f"black at ({x:g}, {y:g})" for x, y in PLACES))
BURN_IN = 100_000


def values(draws: Draws) -> Floats:
    """What is compared (n_draws, len(NAMES)); near is within four radii of the way."""
    middle = draws.xy[draws.global_edges()].mean(axis=1)
    a, b = WAY[:, :2], WAY[:, 2:]
    near = np.min(np.hypot(*(middle[:, None] - 0.5 * (a + b)).transpose(2, 0, 1)), axis=1) < 4.0 * RADIUS
    counts = np.bincount(draws.draw_of_edge(), near, len(draws))
    colours = black_at_draws(draws, PLACES)
    return np.column_stack([draws.n_edges, draws.total_length(), black_areas(draws), counts, colours])


def exact_means(cost: float, n: int, seed: int) -> Mean:
    """Of draws of the prior weighted by exp(-cost * obstacles): those of a free way alone if the cost is infinite."""
    draws = exact_draws(TARGET.scale, ROOM, n, np.random.default_rng(seed))
    met = obstacles(TARGET, draws)
    return weighted_mean(values(draws), np.where(met > 0, -cost * np.maximum(met, 1), 0.0))


def chain_draws(cost: float, n_draws: int, thin: int, seed: int, is_guarded: bool = True) -> Draws:
    """Every `thin`-th map of a chain from white; without guards only the ends of the pieces must be white."""
    chain, rng, maps = make_chain(TARGET, Coloring.empty(ROOM)), np.random.default_rng(seed), []
    chain.density[c.OCCUPIED_COST] = cost
    if not is_guarded:
        nothing = make_guards(chain.edge_index.grid, np.zeros(0, np.int64), chain.guards.shape[:0])
        chain = chain._replace(guards=nothing)
    for until in range(BURN_IN, BURN_IN + n_draws * thin, thin):
        chain = run_chain(chain, rng, until)
        recompute_sums(chain)
        maps.append(read_coloring(chain.graph))
    return Draws.from_colorings(maps, ROOM)
