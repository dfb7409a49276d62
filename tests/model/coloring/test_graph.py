"""Colorings: validity with every rule broken in turn, colours and areas against slow twins, a large real graph."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at, black_at_draws, check, violations
from prf.model.window import BOTTOM, INTERIOR, LEFT, RIGHT, TOP, Window
from prf.shell.errors import InputError
from tests.reference.slow_coloring import read_cf, slab_area, slow_black_at

UNIT = Window(0.0, 0.0, 1.0, 1.0)
SHIFTED = Window(-3.0, 1.0, 1.0, 3.5)


def coloring(xy: list[tuple[float, float]], side: list[int], edges: list[tuple[int, int]]) -> Coloring:
    arrays = (np.array(xy, float).reshape(-1, 2), np.array(side, np.int8), np.array(edges, np.int32).reshape(-1, 2))
    return Coloring(UNIT, *arrays, anchor_black=False)


TRIANGLE = coloring([(0.2, 0.2), (0.6, 0.2), (0.2, 0.6)], [INTERIOR] * 3, [(0, 1), (1, 2), (2, 0)])
CUT = coloring([(0.3, 0.0), (0.0, 0.4)], [BOTTOM, LEFT], [(0, 1)])
VALID = {
    "empty": Coloring.empty(UNIT),
    "triangle": TRIANGLE,
    "corner cut": CUT,
    "boundary triangle": coloring([(0.2, 1.0), (0.8, 1.0), (0.5, 0.7)], [TOP, TOP, INTERIOR], [(0, 2), (2, 1)]),
    "across": coloring([(0.2, 0.0), (1.0, 0.7)], [BOTTOM, RIGHT], [(0, 1)]),
}
I3 = [INTERIOR] * 3
INVALID = {
    "is on 1 edges, not 2": coloring([(0.2, 0.2), (0.6, 0.2), (0.2, 0.6)], I3, [(0, 1), (1, 2)]),
    "boundary) is on 2 edges": coloring([(0.2, 0.0), (0.6, 0.2), (0.2, 0.6)], [0, -1, -1], [(0, 1), (1, 2), (2, 0)]),
    "is on 0 edges": coloring([(0.2, 0.2)], [INTERIOR], []),
    "is called interior": coloring([(0.2, 0.0), (0.6, 0.2), (0.2, 0.6)], I3, [(0, 1), (1, 2), (2, 0)]),
    "not exactly on the bottom side": coloring([(0.3, 1e-17), (0.0, 0.4)], [BOTTOM, LEFT], [(0, 1)]),
    "not exactly on the right side": coloring([(0.3, 0.0), (1.0, 1.4)], [BOTTOM, RIGHT], [(0, 1)]),
    "must be even": coloring([(0.3, 0.0), (0.4, 0.4)], [BOTTOM, INTERIOR], [(0, 1)]),
    "lies along the top side": coloring([(0.3, 1.0), (0.8, 1.0)], [TOP, TOP], [(0, 1)]),
    "has length 0": coloring([(0.2, 0.2), (0.6, 0.2), (0.2, 0.2)], I3, [(0, 1), (1, 2), (2, 0)]),
    "is there 2 times": coloring([(0.2, 0.2), (0.6, 0.2)], [INTERIOR] * 2, [(0, 1), (1, 0)]),
    "edges 0 and 1 cross or touch": coloring(
        [(0.3, 0.0), (0.3, 1.0), (0.0, 0.4), (1.0, 0.4)], [BOTTOM, TOP, LEFT, RIGHT], [(0, 1), (2, 3)]
    ),
    "shape (n_edges, 2)": TRIANGLE._replace(edges=np.zeros((2, 3), np.int32)),
    "shape (n_vertices, 2)": TRIANGLE._replace(xy=np.zeros((3, 3))),
    "side must have shape": TRIANGLE._replace(side=np.zeros(2, np.int8)),
    "is not finite": TRIANGLE._replace(xy=np.full((3, 2), np.nan)),
    "outside 0 ... 2": TRIANGLE._replace(edges=np.array([[0, 3]], np.int32)),
    "side must be": TRIANGLE._replace(side=np.full(3, 7, np.int8)),
}


def fold() -> Coloring:
    """Two edges leave one vertex in the same direction: they overlap beyond the vertex that they share."""
    xy = [(0.1, 0.5), (0.5, 0.5), (0.9, 0.5), (0.5, 0.9)]
    return coloring(xy, [INTERIOR] * 4, [(0, 1), (0, 2), (2, 3), (3, 1)])


def touch() -> Coloring:
    """A vertex of one triangle lies on an edge of another."""
    xy = [(0.2, 0.2), (0.8, 0.2), (0.2, 0.8), (0.5, 0.5), (0.9, 0.6), (0.6, 0.9)]
    return coloring(xy, [INTERIOR] * 6, [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3)])


@pytest.mark.parametrize("name", VALID)
def test_valid_graphs_break_no_rule(name: str) -> None:
    assert violations(VALID[name]) == []
    check(VALID[name])


@pytest.mark.parametrize("message", INVALID)
def test_each_broken_rule_is_named(message: str) -> None:
    assert any(message in line for line in violations(INVALID[message])), violations(INVALID[message])


def test_overlap_beyond_a_shared_vertex_and_a_touch_are_crossings() -> None:
    assert "edges 0 and 1 cross or touch" in violations(fold())
    assert len(violations(touch())) >= 1
    assert all("cross or touch" in line for line in violations(touch()))


def test_check_raises_in_one_line_and_counts_the_rest() -> None:
    many = TRIANGLE._replace(side=np.array([BOTTOM, LEFT, TOP], np.int8))
    assert len(violations(many)) == 7
    with pytest.raises(InputError, match=r"^invalid coloring: [^\n]*; [^\n]*; [^\n]* \(and 4 more\)$"):
        check(many)


def test_lengths_and_segments() -> None:
    np.testing.assert_allclose(TRIANGLE.edge_lengths(), [0.4, 0.4 * np.sqrt(2), 0.4])
    assert TRIANGLE.total_length() == pytest.approx(0.8 + 0.4 * np.sqrt(2))
    assert TRIANGLE.segments()[0].tolist() == [0.2, 0.2, 0.6, 0.2]
    assert (TRIANGLE.n_edges, TRIANGLE.n_vertices) == (3, 3)
    assert Coloring.empty(UNIT).segments().shape == (0, 4)
    assert Coloring.empty(UNIT).total_length() == 0.0


@pytest.mark.parametrize("black", [False, True])
def test_an_empty_coloring_has_one_colour(black: bool) -> None:
    empty = Coloring.empty(SHIFTED, black)
    assert black_at(empty, [(-3.0, 1.0), (0.0, 2.0), (1.0, 3.5)]).tolist() == [black] * 3
    assert black_areas(Draws.from_colorings([empty])).tolist() == [black * SHIFTED.area]


@pytest.mark.parametrize(
    ("scale", "window", "n"), [(1.0, UNIT, 60), (0.3, SHIFTED, 60), pytest.param(3.0, UNIT, 2, marks=pytest.mark.slow)]
)
def test_colours_and_areas_agree_with_slow_twins(scale: float, window: Window, n: int) -> None:
    rng = np.random.default_rng(3)
    draws = exact_draws(scale, window, n, rng)
    xy = rng.uniform(window[:2], window[2:], (20, 2))
    black = black_at_draws(draws, xy)
    for i, draw in enumerate(draws):
        expected = slow_black_at(draw, xy)
        assert black_at(draw, xy).tolist() == expected
        assert black[i].tolist() == expected
    np.testing.assert_allclose(black_areas(draws), [slab_area(draw) for draw in draws], atol=1e-9 * window.area)


def test_points_on_the_border_have_the_colour_beside_them() -> None:
    draws = exact_draws(1.0, UNIT, 100, np.random.default_rng(4))
    t = np.random.default_rng(5).uniform(0.01, 0.99, 10)
    for side, inward in ((BOTTOM, 1e-9), (RIGHT, -1e-9), (TOP, -1e-9), (LEFT, 1e-9)):
        on = np.empty((10, 2))
        on[:, side % 2], on[:, 1 - side % 2] = t, UNIT.side_coordinate(side)
        beside = on.copy()
        beside[:, 1 - side % 2] += inward
        np.testing.assert_array_equal(black_at_draws(draws, on), black_at_draws(draws, beside))


def test_points_level_with_vertices_are_no_special_case() -> None:
    """The ray meets vertices exactly: above and below, left and right of them."""
    points = [(0.2, 0.9), (0.6, 0.9), (0.2, 0.1), (0.25, 0.25), (0.5, 0.5), (0.2 + 1e-12, 0.4)]
    # The anchor lies just outside the triangle.
    assert black_at(TRIANGLE, points).tolist() == [False, False, False, True, False, True]
    assert black_at(CUT, [(0.0, 0.0), (0.3, 0.3), (0.3, 0.0 + 1e-12), (0.0, 0.5)]).tolist() == [True] + [False] * 3


def test_a_large_graph_of_another_program_is_valid(shared_data: Path) -> None:
    graph = read_cf(shared_data / "prf" / "arak" / "test.cf")
    assert violations(graph) == []
    assert (graph.n_vertices, graph.n_edges, int((graph.side != INTERIOR).sum())) == (766, 741, 50)
    assert graph.total_length() == pytest.approx(167.7, abs=0.05)
    moved = graph.xy.copy()
    moved[np.flatnonzero(graph.side == INTERIOR)[100]] = (6.9, 0.1)
    assert violations(graph._replace(xy=moved))


def test_violations_agree_with_shapely_on_moved_vertices() -> None:
    """Move one vertex of a draw anywhere: our verdict on crossings is that of a test over all pairs of lines."""
    rng = np.random.default_rng(8)
    verdicts = set()
    for draw in exact_draws(1.0, UNIT, 150, rng):
        inside = np.flatnonzero(draw.side == INTERIOR)
        if not len(inside):
            continue
        xy = draw.xy.copy()
        xy[rng.choice(inside)] = rng.random(2)
        moved = draw._replace(xy=xy)
        lines = shapely.linestrings(xy[draw.edges])
        met = any(lines[i].crosses(lines[j]) for i in range(len(lines)) for j in range(i))
        assert bool(violations(moved)) == met
        verdicts.add(met)
    assert verdicts == {False, True}
