"""Where a robot can go: places that a disc reaches from its start, in nearly all of the draws on the whole way."""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Draws, black_at_draws
from prf.results.estimate import path_free_in_draws
from prf.shell.errors import InputError

STEP = 0.2
"""Metres between the places of the lattice, which has one at the start."""
LEAST_FREE = 0.9
"""Share of draws in which the disc can follow the whole way to a place."""
DETOUR = 10.0
"""Metres of way that are driven rather than lose all draws: a way that is free in more of them may be longer."""
EDGES_AT_ONCE = 20_000
TINY = 1e-300
NEIGHBOURS = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))

Floats = NDArray[np.float64]
Place = tuple[int, int]


class Reach(NamedTuple):
    """Places that can be reached, nearest first; the first is the start."""

    xy: Floats  # (n, 2) metres
    metres: Floats  # (n,) of way
    p_free: Floats  # (n,) share of draws in which the disc can follow it
    before: NDArray[np.int64]  # (n,) the place before each on its way; -1: none
    lattice: NDArray[np.int64]  # (n, 2) steps from the start

    def way(self, place: int) -> Floats:
        """Return the way (k, 2) from the start to a place."""
        numbers = [place]
        while self.before[numbers[-1]] >= 0:
            numbers.append(int(self.before[numbers[-1]]))
        return self.xy[numbers[::-1]]


class Lattice(NamedTuple):
    """Places in steps from a start, and the draws in which the disc is free at each, with room for a step."""

    low: NDArray[np.int64]  # (2,) steps from the start to the first place
    free: list[list[int]]  # by steps in x and y: the draws, a bit each

    def draws_at(self, place: Place) -> int:
        """Return the draws in which the disc is free at a place; none outside the window."""
        i, j = place[0] - int(self.low[0]), place[1] - int(self.low[1])
        return self.free[i][j] if 0 <= i < len(self.free) and 0 <= j < len(self.free[0]) else 0


def make_lattice(draws: Draws, start: Floats, radius: float) -> Lattice:
    """Return the lattice of the window.

    A step between two places that are both farther than `apart` from an edge keeps farther than `radius` from it.
    """
    window = draws.window
    apart = math.hypot(radius, 0.5 * STEP * math.sqrt(2.0))
    low = np.ceil((np.array(window[:2]) - start) / STEP).astype(np.int64)
    high = np.floor((np.array(window[2:]) - start) / STEP).astype(np.int64)
    i, j = (np.arange(first, last + 1) for first, last in zip(low, high, strict=True))
    xy = start + STEP * np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1)
    free = ~black_at_draws(draws, xy.reshape(-1, 2)).reshape(len(draws), len(i), len(j))
    ends = draws.xy[draws.global_edges()] - xy[0, 0]
    owner = draws.draw_of_edge()
    for first in range(0, len(ends), EDGES_AT_ONCE):
        some = slice(first, first + EDGES_AT_ONCE)
        free[_near(ends[some], owner[some], apart, (len(i), len(j)))] = False
    packed = np.packbits(free.transpose(1, 2, 0), axis=2)
    return Lattice(low, [[int.from_bytes(each.tobytes(), "big") for each in row] for row in packed])


def _near(
    ends: Floats, owner: NDArray[np.int64], apart: float, shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return draws and places (i, j) that are not farther than `apart` from an edge of the draw.

    `ends` (n, 2, 2): of edges, from the first place; `owner` (n,): their draws.
    """
    most = np.array(shape) - 1
    first = np.clip(np.ceil((ends.min(axis=1) - apart) / STEP), 0, most).astype(np.int64)
    count = np.clip(np.floor((ends.max(axis=1) + apart) / STEP), 0, most).astype(np.int64) - first + 1
    count = np.maximum(count, 0)
    total = count.prod(axis=1)
    edge = np.repeat(np.arange(len(ends)), total)
    rank = np.arange(len(edge)) - np.repeat(np.cumsum(total) - total, total)
    i, j = first[edge, 0] + rank // count[edge, 1], first[edge, 1] + rank % count[edge, 1]
    off = STEP * np.column_stack([i, j]) - ends[edge, 0]
    along = (ends[:, 1] - ends[:, 0])[edge]
    share = np.clip((off * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), TINY), 0.0, 1.0)
    near = ((off - share[:, None] * along) ** 2).sum(axis=1) <= apart**2
    return owner[edge[near]], i[near], j[near]


def bits(which: NDArray[np.bool_]) -> int:
    """Return flags (n,) as an integer."""
    return int.from_bytes(np.packbits(which).tobytes(), "big")


def reachable(draws: Draws, start: Floats, radius: float) -> Reach:
    """Return the places that a disc reaches from `start` (2,), metres, with at least :data:`LEAST_FREE`.

    Every place keeps the draws in which the disc can follow the way to it: what is connected is not counted twice.
    InputError if the start itself is not so free.
    """
    begin = path_free_in_draws(draws, start[None], radius)
    if begin.mean() < LEAST_FREE:
        raise InputError(
            f"start ({start[0]:.2f}, {start[1]:.2f}): a disc of radius {radius:g} m is free there in "
            f"{begin.mean():.2f} of the draws, less than {LEAST_FREE:g}. Give a smaller --radius, or --from X Y."
        )
    lattice, most = make_lattice(draws, start, radius), len(draws)
    queue: list[tuple[float, float, Place, int, int]] = [(0.0, 0.0, (0, 0), bits(begin), -1)]
    settled: dict[Place, tuple[float, int, int]] = {}
    while queue:
        _, metres, here, free, before = heapq.heappop(queue)
        if here in settled:
            continue
        number = len(settled)
        settled[here] = (metres, free, before)
        for i, j in NEIGHBOURS:
            there = here[0] + i, here[1] + j
            kept = 0 if there in settled else free & lattice.draws_at(there)
            if kept and here == (0, 0):
                # The robot stands where it stands, perhaps nearer to a wall than places of the lattice are held to be.
                kept &= bits(path_free_in_draws(draws, [start, start + STEP * np.array(there)], radius))
            share = kept.bit_count() / most
            if share >= LEAST_FREE:
                so_far = metres + STEP * math.hypot(i, j)
                heapq.heappush(queue, (so_far + DETOUR * (1.0 - share), so_far, there, kept, number))
    return _reach(start, settled, most)


def _reach(start: Floats, settled: dict[Place, tuple[float, int, int]], n_draws: int) -> Reach:
    """Return places, with the metres of way to each, the draws in which it is free, and the place before it."""
    steps = np.array(list(settled))
    metres, free, before = zip(*settled.values(), strict=True)
    share = np.array([each.bit_count() / n_draws for each in free])
    return Reach(start + STEP * steps, np.array(metres), share, np.array(before), steps)
