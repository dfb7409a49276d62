"""The part of a chain that is its map and what follows from it: exchanged in swaps, or replaced."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums, trace_all
from prf.kernels.state.chain import Chain
from prf.kernels.state.graph import Graph
from prf.kernels.state.image import settle_all
from prf.model.coloring import Coloring
from prf.model.laser import empty_lists
from prf.model.layout import make_graph, make_image, make_index, paint_image, painted_sites, read_coloring
from prf.model.sonar import make_sight
from prf.sampler.posterior import FIRST_CAPACITY, Settings, painted_points

STATE = ("graph", "edge_index", "beams", "cones", "points", "sensors")
"""Fields of a chain that follow from its map; the others belong to the temperature."""
SHARED = (
    "grid",
    "model",
    "cell_start",
    "slot_start",
    "slot_cell",
    "slot_exit",
    "slot_near",
    "targets",
    "xy",
    "best",
    "aim",
    "level",
    "beyond",
    "shape",
    "lists",
)
"""Fields, of a chain or of its parts, that no step writes to: copies of a chain hold the same arrays."""
NATS_PER_CONE = 5.0
"""What a sonar reading may lose where nothing explains it, about."""
LEAST_COST = 5.0
"""Nats that an occupied sensor costs at least."""


def copied(part: Any) -> Any:
    """Return a copy of a chain, or of a part of one; what never changes is shared."""
    if isinstance(part, np.ndarray):
        return part.copy()
    if not isinstance(part, tuple):
        return part
    fields = part._asdict()  # type: ignore[attr-defined]
    return part._replace(  # type: ignore[attr-defined]
        **{name: value if name in SHARED else copied(value) for name, value in fields.items()}
    )


def without_image(chain: Chain) -> Chain:
    """Return a copy of a chain that keeps no image."""
    empty = make_image(read_coloring(chain.graph), chain.graph, None)
    found: Chain = copied(chain._replace(image=empty))
    return found


def exchanged(one: Chain, other: Chain) -> tuple[Chain, Chain]:
    """Return both chains, each with the map of the other. Images are left as they are."""
    return (
        one._replace(**{name: getattr(other, name) for name in STATE}),
        other._replace(**{name: getattr(one, name) for name in STATE}),
    )


def with_graph(chain: Chain, settings: Settings, graph: Graph) -> Chain:
    """Return the chain at another graph, all that follows from it recomputed. Its image is left as it is."""
    capacity, coloring = len(graph.edge_length), read_coloring(graph)
    placed = chain._replace(
        graph=graph,
        edge_index=make_index(graph, chain.edge_index.grid, chain.edge_index.cell_edges.shape[1]),
        beams=empty_lists(chain.beams, capacity),
        cones=chain.cones._replace(sight=make_sight(capacity + c.MOST_CHANGES)),
        points=painted_points(settings.points, coloring),
        sensors=painted_sites(chain.sensors, coloring),
    )
    trace_all(placed)
    recompute_sums(placed)
    return placed


def with_map(chain: Chain, settings: Settings, coloring: Coloring) -> Chain:
    """Return the chain at another map and at the same step. Its image is left as it is."""
    graph = make_graph(coloring, max(FIRST_CAPACITY, 2 * (len(coloring.xy) + c.MOST_CHANGES)))
    graph.counts[c.STEP] = chain.graph.counts[c.STEP]
    return with_graph(chain, settings, graph)


def repaint(chain: Chain) -> None:
    """Let the image follow the map that the chain was given; the times of the old one must be settled."""
    if chain.image.black.size > 0:
        paint_image(chain.image, read_coloring(chain.graph), int(chain.graph.counts[c.STEP]))


def settle_image(chain: Chain) -> None:
    """Add up the times of the image up to the present step."""
    settle_all(chain.image, int(chain.graph.counts[c.STEP]))


def penalised_log_likelihood(chain: Chain, cost: float) -> float:
    """Return E: the log likelihood less what occupied sensors cost, nats, which an inverse temperature multiplies."""
    occupied = int(chain.graph.counts[c.OCCUPIED])
    return float(chain.graph.sums[c.LOG_LIKELIHOOD]) - (cost * occupied if occupied else 0.0)


def occupied_cost(settings: Settings, n_sites: int) -> float:
    """Return the nats that an occupied sensor position costs by default.

    As much as if all its readings went unexplained: less, and a map that is black where it should be white would be as
    good as the right one, since beams see edges and not colours.
    """
    total = 0.0
    if settings.laser is not None:
        model = settings.laser.model
        peak = 1.0 / (math.sqrt(2.0 * math.pi) * model.noise)
        total += settings.laser.readings.n_beams * math.log(1.0 + peak * model.limit / model.outlier_probability)
    if settings.sonar is not None:
        total += NATS_PER_CONE * settings.sonar.readings.n_beams
    return max(LEAST_COST, total / max(n_sites, 1))
