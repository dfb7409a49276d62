"""Where chains start: the empty map, the contour of an occupancy grid, or where a draw of the prior leads.

Chains that start alike may agree for want of time to part. Contours differ from chain to chain in the readings that
they stand on, draws of the prior in everything. No step on the way to a start is a step of the chain.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from prf.arak import exact_draws
from prf.coloring import Coloring, occupied_polygons
from prf.configuration import Start
from prf.kernels import constants as c
from prf.kernels.build import recompute_sums
from prf.layout import read_coloring, run_chain
from prf.posterior import Settings, make_chain
from prf.sampler.contour import contour_map, map_of_region
from prf.sampler.first_map import find_first_map, has_shares
from prf.sampler.tempering_state import occupied_cost

LOWEST_POWER = 0.003
"""Power of the likelihood with which a chain leaves a draw of the prior."""
RISE = 30
"""Looks over which the power rises to 1."""
LOOK = 10_000
"""Steps between two looks."""
MOST_DOUBLINGS = 20
"""How often, from look to look, the cost of an occupied sensor doubles if one still is."""


def needs_search(start: Start, settings: Settings) -> bool:
    """Return whether where chains start must be searched for: work before their first step."""
    return start != "empty" or has_shares(settings)


def find_start_map(
    start: Start, settings: Settings, rng: np.random.Generator, stop_requested: Callable[[], bool]
) -> Coloring:
    """Return a map to start from, every sensor in white."""
    if start == "grid":
        return contour_map(settings, rng)
    if start == "prior":
        return from_prior(settings, rng, stop_requested)
    return find_first_map(settings, rng, stop_requested)


def from_prior(settings: Settings, rng: np.random.Generator, stop_requested: Callable[[], bool]) -> Coloring:
    """Return where a chain from an exact draw of the prior comes to.

    The power of its likelihood rises from next to nothing to 1, so that colours come before walls. An occupied sensor
    costs a finite number of nats; in the end that number rises until there is none. What is black round a sensor even
    then, or when the search is cut short, is cut out.
    """
    draw = exact_draws(settings.scale, settings.window, 1, rng)[0]
    chain = make_chain(dataclasses.replace(settings, resolution=None), draw)
    cost = occupied_cost(settings, len(chain.sensors.xy))
    for look in range(1, RISE + MOST_DOUBLINGS + 1):
        if stop_requested() or (look > RISE and chain.graph.counts[c.OCCUPIED] == 0):
            break
        chain.density[c.LIKELIHOOD_POWER] = LOWEST_POWER ** (1.0 - min(look, RISE) / RISE)
        chain.density[c.OCCUPIED_COST] = cost * 2.0 ** max(0, look - RISE)
        chain = run_chain(chain, rng, look * LOOK)
        recompute_sums(chain)
    coloring = read_coloring(chain.graph)
    return map_of_region(occupied_polygons(coloring), settings) if chain.graph.counts[c.OCCUPIED] else coloring
