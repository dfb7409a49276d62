"""The work in one tile: a pure function of the round and the readings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.chain import Chain
from prf.kernels.image import settle_all
from prf.layout import run_chain
from prf.sampler.record import functionals
from prf.sampler.tiles.data import TileData
from prf.sampler.tiles.part import Part, make_part
from prf.sampler.tiles.rounds import Round


class TileState(NamedTuple):
    """Inside of a tile at one of the looks of a round."""

    xy: NDArray[np.float64]  # (m, 2): new vertices
    # (k, 2): new edges: numbers of vertices of the round's map that stay, or -1 - i for the new vertex i
    edges: NDArray[np.int64]
    gain: NDArray[np.float64]  # by how much what is watched has changed since the round began
    probe_black: NDArray[np.bool_]  # (n_probes,): colours of the probes in the tile, False elsewhere


class TileResult(NamedTuple):
    """What came of a round in a tile."""

    drawn: NDArray[np.int64]  # (n,): edges of the round's map in whose place the new ones come
    states: tuple[TileState, ...]  # one a look; the last is that of the end
    outcomes: NDArray[np.int64]  # (n_moves, 3)
    pixels: NDArray[np.int64]  # (p,): pixels of the image that belong to the tile
    black: NDArray[np.uint8]  # (p,)
    black_time: NDArray[np.int64]  # (p,): in steps of the tile
    mixed_time: NDArray[np.int64]  # (p,): in steps of the tile


def work_tile(data: TileData, begun: Round, number: int) -> TileResult:
    """Run the chain of one tile from the map of the round; the same on any machine."""
    part = make_part(data, begun, number)
    chain, rng = part.chain, np.random.default_rng(int(begun.seeds[number]))
    at_first, states = functionals(chain), []
    for look in begun.looks.tolist():
        chain = run_chain(chain, rng, look)
        states.append(_state(part, chain, at_first, begun.probes))
    settle_all(chain.image, begun.steps)
    return TileResult(
        part.drawn,
        tuple(states),
        chain.outcomes,
        part.pixels,
        chain.image.black,
        chain.image.black_time,
        chain.image.mixed_time,
    )


def _state(part: Part, chain: Chain, at_first: NDArray[np.float64], probes: NDArray[np.int64]) -> TileState:
    """Return the inside of a tile as it stands."""
    graph = chain.graph
    ends = graph.edge_vertices[graph.members[c.EDGES, : graph.counts[c.EDGES]]]
    is_new = np.ones(len(graph.edge_length), np.bool_)
    is_new[part.pinned] = False
    fresh = np.unique(ends[is_new[ends]])
    code = np.zeros(len(graph.edge_length), np.int64)
    code[: len(part.vertices)] = part.vertices
    code[fresh] = -1 - np.arange(len(fresh))
    black = np.zeros(len(probes), np.bool_)
    inside = np.isin(probes, part.pixels)
    black[inside] = chain.image.black[np.searchsorted(part.pixels, probes[inside])]
    return TileState(graph.vertex_xy[fresh], code[ends].reshape(-1, 2), functionals(chain) - at_first, black)
