"""Draws from the prior by the Markov chain: the sampler without readings, to be held against the exact laws."""

from __future__ import annotations

import math

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.model.arak import expected_edges, refuse_too_many_edges
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring
from prf.model.orientation import PLAIN, Orientation
from prf.model.window import Window
from prf.sampler.directions import redraw_directions
from prf.sampler.target import Target, make_chain, run_chain
from prf.shell.cli.storage import spawn_generators

THIN_PER_EDGE = 50
"""Steps between draws for each edge to be expected: about the autocorrelation time of the number of edges."""
TURN = 500
"""Steps between two draws of the directions of the building."""
BURN_IN_DRAWS = 40
"""Burn-in in units of the chosen spacing."""


def chosen_thin(scale: float, window: Window) -> int:
    """Return the spacing of draws that is used unless one is given, in steps."""
    return math.ceil(THIN_PER_EDGE * (10.0 + expected_edges(scale, window)))


def mcmc_draws(
    scale: float,
    window: Window,
    n_draws: int,
    thin: int | None = None,
    seed: int = 0,
    orientation: Orientation = PLAIN,
    free_space: float = 0.0,
) -> tuple[Draws, int]:
    """Draw maps from the Arak prior by one Markov chain from the all white map."""
    refuse_too_many_edges(scale, window, n_draws)
    target = Target(window, scale, orientation=orientation, free_space=free_space)
    chain = make_chain(target, Coloring.empty(window))
    rng = spawn_generators(seed, 1)[0]
    spacing = thin if thin is not None else chosen_thin(scale, window)
    until = BURN_IN_DRAWS * chosen_thin(scale, window)
    colorings = []
    for _ in range(n_draws):
        while chain.graph.counts[c.STEP] < until:
            step = int(chain.graph.counts[c.STEP])
            chain = run_chain(chain, rng, min(until, step + TURN) if orientation.is_sampled else until)
            redraw_directions(chain, orientation, rng)
        recompute_sums(chain)
        colorings.append(read_coloring(chain.graph))
        until += spacing
    return Draws.from_colorings(colorings, window), spacing
