"""The line of an edge goes where docs/moves.md says, from the numbers that are drawn, and nowhere else."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from prf.coloring import Coloring
from prf.kernels import constants as c
from prf.kernels.chain import Chain
from prf.posterior import Settings
from prf.window import INTERIOR, Window
from tests.reference.hastings import attempt, make_lab
from tests.reference.scripted import FIRST, SECOND, pick, scripted, signed

WINDOW = Window(3.0, -2.5, 7.0, -0.5)
Place = NDArray[np.float64]


def moved_to(a: Place, u: Place, v: Place, b: Place, r: float, pivot: float | None) -> list[Place] | str:
    """Places of u and v after a shift by r, or after a turn by a reach r about a share of uv; or why there are none."""
    along = (v - u) / math.dist(u, v)
    if pivot is None:
        on_line, direction = u + r * np.array([-along[1], along[0]]), along
    else:
        angle = 2.0 * r / math.dist(u, v)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        on_line, direction = u + pivot * (v - u), turn @ along
        if abs(angle) > 1.5:
            return "too steep"
    ends = []
    for start, through in ((a, u), (b, v)):
        stretch, _ = np.linalg.solve(np.column_stack([through - start, -direction]), on_line - start)
        ends.append(start + stretch * (through - start))
        if stretch <= 0.0:
            return "behind a ray"
        outside = np.flatnonzero([*(ends[-1] < WINDOW[:2]), *(ends[-1] > WINDOW[2:])])
        if outside.size:
            return f"outside, side {outside[0]}"
    if pivot is not None and not 0.0 < (on_line - ends[0]) @ (ends[1] - ends[0]) < math.dist(*ends) ** 2:
        return "pivot off the new edge"
    return ends


def polygon(rng: np.random.Generator) -> Coloring:
    """Four to six corners round the middle of the window."""
    n = int(rng.integers(4, 7))
    angle = 2.0 * math.pi * (np.arange(n) + rng.uniform(0.0, 0.8, n)) / n
    radius = rng.uniform(0.4, 0.95, (n, 1)) * (WINDOW.width / 2.0, WINDOW.height / 2.0)
    xy = WINDOW.centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    edges = np.column_stack([np.arange(n), (np.arange(n) + 1) % n]).astype(np.int32)
    return Coloring(WINDOW, xy, np.full(n, INTERIOR, np.int8), edges, False)


def path_along(chain: Chain, edge: int) -> list[Place]:
    """The ends u and v of an edge between their other neighbours a and b."""
    graph = chain.graph
    u, v = graph.edge_vertices[edge].tolist()
    a, b = (
        next(w for e in graph.vertex_edges[end] for w in graph.edge_vertices[e] if e != edge and w != end)
        for end in (u, v)
    )
    return [graph.vertex_xy[w].copy() for w in (a, u, v, b)]


def test_a_line_is_shifted_and_turned_as_the_documentation_says() -> None:
    rng = np.random.default_rng(20)
    lab = make_lab(Settings(WINDOW, 0.5), rng)
    chains = [lab.chain_at(polygon(rng)) for _ in range(12)]
    n_moved, refusals = 0, set()
    for start in 20 * chains:
        chain = copy.deepcopy(start)
        edge = int(rng.integers(chain.graph.counts[c.EDGES]))
        r, pivot = float(rng.choice([-1.0, 1.0])) * math.exp(rng.uniform(-4.0, 1.0)), float(rng.beta(0.3, 0.3))
        is_turn = rng.random() < 0.6
        expected = moved_to(*path_along(chain, edge), r, pivot if is_turn else None)
        way = FIRST if is_turn else SECOND
        numbers = [pick(chain, c.EDGES, edge), way, *signed(r, lab.plan.line_reach), pivot]
        legal = attempt(chain, c.MOVE_LINE, scripted(numbers))[0]
        if isinstance(expected, str):
            refusals.add(expected)
            assert not legal, expected
        else:
            n_moved += 1
            places = chain.graph.vertex_xy[chain.proposal.new_vertices[:2]]
            assert legal
            assert places == pytest.approx(np.array(expected), abs=1e-9)
    assert n_moved > 80
    assert len(refusals) == 7
