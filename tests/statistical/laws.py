"""One harness for exact and Markov chain draws: the z-score of every exact law of the Arak process.

Every law is written as one number a draw whose mean is exactly 0 (:func:`residuals`), so that the z-score is the mean
over its standard error whatever the law: plain for independent draws, by batch means within chains otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.model import arak
from prf.model.coloring import Draws, black_areas, black_at_draws
from prf.model.window import INTERIOR, LEFT, SIDE_NAMES, SIDES, Window
from tests.reference import arak_laws

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Flat:
    """Draws with what the laws look at: ends of edges, neighbours of vertices, sums by draw.

    Parameters
    ----------
    draws : Draws
    scale : float
    window : Window
        As the sampler was asked for.
    """

    def __init__(self, draws: Draws, scale: float, window: Window) -> None:
        if draws.window != window:
            raise ValueError(f"draws are of {draws.window}, not {window}")
        self.draws, self.scale, self.window = draws, scale, window
        self.edges = draws.global_edges()
        self.edge_draw = draws.draw_of_edge()
        self.vertex_draw = np.repeat(np.arange(len(draws)), np.diff(draws.vertex_offsets))
        self.interior = np.flatnonzero(draws.side == INTERIOR)
        self.boundary = np.flatnonzero(draws.side != INTERIOR)

    def per_draw(self, owner: Ints, values: NDArray[np.generic] | None = None) -> Floats:
        """Return the sum of `values` (or the number of items) by draw, (n_draws,)."""
        return np.bincount(owner, values, len(self.draws)).astype(np.float64)

    @cached_property
    def rightward(self) -> tuple[Floats, Floats, NDArray[np.int8]]:
        """Left ends, right ends (n, 2) and side of the right end (n,) of all edges."""
        xy = self.draws.xy
        swap = xy[self.edges[:, 0], 0] > xy[self.edges[:, 1], 0]
        ordered = np.where(swap[:, None], self.edges[:, ::-1], self.edges)
        return xy[ordered[:, 0]], xy[ordered[:, 1]], self.draws.side[ordered[:, 1]]

    @cached_property
    def _neighbours(self) -> tuple[Ints, Ints]:
        ends = self.edges.ravel()
        others = self.edges[:, ::-1].ravel()[np.argsort(ends, kind="stable")]
        starts = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=len(self.draws.xy)))])
        return others, starts

    @cached_property
    def interior_directions(self) -> tuple[Floats, Floats]:
        """Unit vectors from each interior vertex to its two neighbours, (n, 2) each."""
        others, starts = self._neighbours
        return self._unit(self.interior, others[starts[self.interior]]), self._unit(
            self.interior, others[starts[self.interior] + 1]
        )

    @cached_property
    def boundary_directions(self) -> Floats:
        """Unit vectors from each boundary vertex to its neighbour, (n, 2)."""
        others, starts = self._neighbours
        return self._unit(self.boundary, others[starts[self.boundary]])

    def _unit(self, start: Ints, end: Ints) -> Floats:
        vectors = self.draws.xy[end] - self.draws.xy[start]
        return vectors / np.hypot(*vectors.T)[:, None]

    def meets_convex(self, corners: Floats) -> NDArray[np.bool_]:
        """Return which draws have an edge in the convex polygon (k, 2) of counter-clockwise `corners` (Cyrus-Beck)."""
        start, end, _ = self.rightward
        enter, leave = np.zeros(len(start)), np.ones(len(start))
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inward = np.array([a[1] - b[1], b[0] - a[0]])
            depth, slope = (start - a) @ inward, (end - start) @ inward
            with np.errstate(divide="ignore", invalid="ignore"):
                t = -depth / slope
            enter = np.where(slope > 0, np.maximum(enter, t), enter)
            leave = np.where(slope < 0, np.minimum(leave, t), leave)
            leave = np.where((slope == 0) & (depth < 0), -1.0, leave)
        return self.per_draw(self.edge_draw[enter <= leave]) > 0

    def crossings(self, a: Floats, b: Floats) -> Floats:
        """Return how many edges of each draw cross the segment a-b."""
        start, end, _ = self.rightward
        along = b - a
        across = np.array([-along[1], along[0]])
        height_start, height_end = (start - a) @ across, (end - a) @ across
        with np.errstate(divide="ignore", invalid="ignore"):
            t = height_start / (height_start - height_end)
            reach = ((start + t[:, None] * (end - start)) - a) @ along
        hit = ((height_start > 0) != (height_end > 0)) & (reach > 0) & (reach < along @ along)
        return self.per_draw(self.edge_draw[hit])


Residuals = dict[str, Floats]
DECILES = np.arange(1, 10) / 10
MIN_EXPECTED = 100.0
"""A rare event is looked at only if so many draws are expected to show it: its mean is then near to normal."""


class LawScores(NamedTuple):
    """What the laws say about some draws.

    Attributes
    ----------
    z : dict of str to float
        z-score by law; inf where a law that holds in every draw is broken.
    relative_error_edges : float
        Standard error of the mean number of edges, over that mean.
    """

    z: dict[str, float]
    relative_error_edges: float

    def worst(self, n: int = 5) -> list[tuple[str, float]]:
        """Return the `n` laws with the largest ``|z|``."""
        return sorted(self.z.items(), key=lambda item: -abs(item[1]))[:n]

    def beyond(self, limit: float) -> dict[str, float]:
        """Return the laws with ``|z|`` of `limit` or more; not a number counts."""
        return {name: z for name, z in self.z.items() if not abs(z) < limit}


def law_scores(
    draws: Draws, scale: float, window: Window, chain_ids: ArrayLike | None = None, batch: int | None = None
) -> LawScores:
    """Return the z-score of every law.

    Parameters
    ----------
    draws : Draws
        Those of one chain in the order of its steps.
    scale, window
        What the sampler was asked for.
    chain_ids : (n,) array of int, optional
        Chain of each draw; default: one chain.
    batch : int, optional
        None: the draws are independent. Else so many consecutive draws of a chain make a batch, whose means are taken
        as independent: several times the autocorrelation time, with 100 batches or more in all. A chain's last,
        incomplete batch is left out.
    """
    rows = None if batch is None else _batches(len(draws), chain_ids, batch)
    values = residuals(draws, scale, window)
    edges = draws.n_edges.astype(np.float64)
    return LawScores(
        {name: _z(residual, rows) for name, residual in values.items()},
        _standard_error(edges, rows) / float(edges.mean()),
    )


def residuals(draws: Draws, scale: float, window: Window) -> Residuals:
    """Return, for every law, one number a draw with mean exactly 0."""
    flat = Flat(draws, scale, window)
    return {name: values for law in LAWS for name, values in law(flat).items()}


def _batches(n: int, chain_ids: ArrayLike | None, batch: int) -> NDArray[np.int64]:
    """Return the rows of each batch, (n_batches, batch)."""
    chains = np.zeros(n, np.int64) if chain_ids is None else np.asarray(chain_ids)
    rows = [np.flatnonzero(chains == chain) for chain in np.unique(chains)]
    return np.concatenate([row[: len(row) // batch * batch].reshape(-1, batch) for row in rows])


def _standard_error(values: Floats, rows: NDArray[np.int64] | None) -> float:
    means = values if rows is None else values[rows].mean(axis=1)
    return float(means.std(ddof=1)) / math.sqrt(len(means))


def _z(residual: Floats, rows: NDArray[np.int64] | None) -> float:
    used = residual if rows is None else residual[rows]
    mean = float(used.mean())
    if not math.isfinite(mean):
        return math.inf
    error = _standard_error(residual, rows)
    if error == 0.0:
        return 0.0 if mean == 0.0 else math.copysign(math.inf, mean)
    return mean / error


def _poisson(name: str, counts: Floats, mean: float) -> Residuals:
    """Return mean and variance residuals of a Poisson number; the exact mean centres the squares."""
    centred = counts - mean
    return {f"{name}: mean": centred, f"{name}: variance": centred**2 - mean}


def _cosines(name: str, flat: Flat, owner: NDArray[np.int64], cosine: Floats) -> Residuals:
    """Return residuals of cosines uniform on (-1, 1): mean, mean square 1/3, and each decile."""
    found = {
        f"{name}: mean": flat.per_draw(owner, cosine),
        f"{name}: variance": flat.per_draw(owner, cosine**2 - 1.0 / 3.0),
    }
    for q in DECILES:
        found[f"{name}: decile {q:.1f}"] = flat.per_draw(owner, (cosine < 2.0 * q - 1.0) - q)
    return found


def edge_count(flat: Flat) -> Residuals:
    """Mean number of edges p P + 4 pi p^2 A, P perimeter and A area of the window."""
    return {"edges: mean": flat.draws.n_edges - arak.expected_edges(flat.scale, flat.window)}


def total_length(flat: Flat) -> Residuals:
    """Mean total length pi p A."""
    return {"length: mean": flat.draws.total_length() - arak.expected_length(flat.scale, flat.window)}


def interior_vertices(flat: Flat) -> Residuals:
    """Mean number of interior vertices 4 pi p^2 A."""
    count = flat.per_draw(flat.vertex_draw[flat.interior])
    return {"interior vertices: mean": count - arak_laws.expected_interior_vertices(flat.scale, flat.window)}


def extremes(flat: Flat) -> Residuals:
    """Local minima in x, maxima in x and minima in a slanted direction: each Poisson(pi p^2 A)."""
    first, second = flat.interior_directions
    mean = arak_laws.expected_extremes(flat.scale, flat.window)
    found: Residuals = {}
    for name, angle in (("minima in x", 0.0), ("maxima in x", math.pi), ("minima at 0.7 rad", 0.7)):
        direction = np.array([math.cos(angle), math.sin(angle)])
        is_minimum = (first @ direction > 0) & (second @ direction > 0)
        found |= _poisson(name, flat.per_draw(flat.vertex_draw[flat.interior[is_minimum]]), mean)
    return found


def side_vertices(flat: Flat) -> Residuals:
    """Boundary vertices on a side of length L: Poisson(2 p L)."""
    found: Residuals = {}
    for side in SIDES:
        count = flat.per_draw(flat.vertex_draw[flat.draws.side == side])
        mean = arak_laws.expected_crossings(flat.scale, flat.window.side_length(side))
        found |= _poisson(f"{SIDE_NAMES[side]} vertices", count, mean)
    return found


def border_vertices(flat: Flat) -> Residuals:
    """Whole border: mean 2 p P and always even; vertices where x enters, and where it leaves, each Poisson(p P)."""
    owner = flat.vertex_draw[flat.boundary]
    count = flat.per_draw(owner)
    mean = arak_laws.expected_boundary_vertices(flat.scale, flat.window)
    enters = flat.boundary_directions[:, 0] > 0
    return {
        "border vertices: mean": count - mean,
        "border vertices: even": np.where(count % 2 == 0, 0.0, np.inf),
        **_poisson("entering vertices", flat.per_draw(owner[enters]), 0.5 * mean),
        **_poisson("leaving vertices", flat.per_draw(owner[~enters]), 0.5 * mean),
    }


def segment_crossings(flat: Flat) -> Residuals:
    """Crossings of a segment of length d: Poisson(2 p d); of disjoint collinear segments: uncorrelated."""
    a, b = _at(flat.window, (0.13, 0.22)), _at(flat.window, (0.81, 0.67))
    found: Residuals = {}
    centred = []
    for name, start, stop in (("first segment", 0.0, 0.35), ("second segment", 0.45, 1.0)):
        count = flat.crossings(a + start * (b - a), a + stop * (b - a))
        mean = arak_laws.expected_crossings(flat.scale, (stop - start) * float(np.hypot(*(b - a))))
        found |= _poisson(f"crossings of {name}", count, mean)
        centred.append(count - mean)
    return {**found, "crossings of both segments: covariance": centred[0] * centred[1]}


def colours(flat: Flat) -> Residuals:
    """P(same colour at distance d) = (1 + exp(-4 p d)) / 2; E of four signs on a line = exp(-4 p (ab + cd))."""
    window, scale = flat.window, flat.scale
    d = min(0.3 * min(window.width, window.height), 0.25 / scale)
    places = np.array([0.0, 0.5, 1.5, 2.2]) * d
    points = _at(window, (0.15, 0.2)) + places[:, None] * np.array([math.cos(0.5), math.sin(0.5)])
    sign = np.where(black_at_draws(flat.draws, points), 1.0, -1.0)
    found = {"colour: mean": sign[:, 0], "four colours on a line": np.prod(sign, axis=1)}
    found["four colours on a line"] -= arak_laws.four_point_correlation(scale, 0.5 * d, 0.7 * d)
    for name, k in (("near", 1), ("far", 3)):
        same = sign[:, 0] == sign[:, k]
        found[f"same colour, {name}"] = same - arak_laws.same_colour_probability(scale, float(places[k]))
    return found


def monochrome(flat: Flat) -> Residuals:
    """A convex set K meets no edge with probability exp(-p Per(K) - pi p^2 area(K)): square, triangle, window."""
    size = min(0.35 * min(flat.window.width, flat.window.height), 0.3 / flat.scale)
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * size + _at(flat.window, (0.3, 0.4))
    triangle = np.array([[0.0, 0.0], [1.2, -0.4], [0.3, 1.0]]) * size + _at(flat.window, (0.45, 0.35))
    found: Residuals = {}
    for name, corners in (("square", square), ("triangle", triangle)):
        sides = np.roll(corners, -1, axis=0) - corners
        doubled = corners[:, 0] @ np.roll(corners[:, 1], -1) - corners[:, 1] @ np.roll(corners[:, 0], -1)
        free = arak_laws.no_edge_probability(flat.scale, float(np.hypot(*sides.T).sum()), 0.5 * float(doubled))
        found |= _if_expected(f"{name} without edge", ~flat.meets_convex(corners), free)
    free = arak_laws.no_edge_probability(flat.scale, flat.window.perimeter, flat.window.area)
    return {**found, **_if_expected("window without edge", flat.draws.n_edges == 0, free)}


def edge_lengths(flat: Flat) -> Residuals:
    """Edge lengths are Exp(4 p), cut by the window.

    From its left end an edge could run for b, up to the border. Those that do number sum exp(-4 p b) in the mean over
    all edges; for the others U = (1 - exp(-4 p l)) / (1 - exp(-4 p b)) is uniform.
    """
    rate, owner = arak_laws.edge_length_rate(flat.scale), flat.edge_draw
    start, end, end_side = flat.rightward
    length = np.hypot(*(end - start).T)
    cut = end_side != INTERIOR
    room = np.where(cut, length, _distance_to_border(start, end, flat.window))
    found = {"edge length: cut edges": flat.per_draw(owner, cut - np.exp(-rate * room))}
    inner = ~cut
    uniform = np.expm1(-rate * length[inner]) / np.expm1(-rate * room[inner])
    found["edge length: mean"] = flat.per_draw(owner[inner], uniform - 0.5)
    found["edge length: variance"] = flat.per_draw(owner[inner], (uniform - 0.5) ** 2 - 1.0 / 12.0)
    for q in DECILES:
        found[f"edge length: decile {q:.1f}"] = flat.per_draw(owner[inner], (uniform < q) - q)
    return found


def interior_angles(flat: Flat) -> Residuals:
    """The angle phi at an interior vertex has density sin(phi) / 2: its cosine is uniform on (-1, 1)."""
    first, second = flat.interior_directions
    return _cosines("interior angle", flat, flat.vertex_draw[flat.interior], np.einsum("ij,ij->i", first, second))


def side_angles(flat: Flat) -> Residuals:
    """The angle to the side has density sin / 2: its cosine is uniform on (-1, 1)."""
    horizontal = np.isin(flat.draws.side[flat.boundary], SIDES[::2])
    cosine = np.where(horizontal, *flat.boundary_directions.T)
    return _cosines("angle to the side", flat, flat.vertex_draw[flat.boundary], cosine)


def left_angles(flat: Flat) -> Residuals:
    """The same on the left side alone, where every particle of the exact simulator's border law starts."""
    on_left = flat.draws.side[flat.boundary] == LEFT
    owner = flat.vertex_draw[flat.boundary][on_left]
    cosine = flat.boundary_directions[on_left, 1]
    return {"angle to the left side: variance": flat.per_draw(owner, cosine**2 - 1.0 / 3.0)}


def black_fraction(flat: Flat) -> Residuals:
    """Black share of the window: mean 1/2, variance E exp(-4 p |X - Y|) / 4 for X, Y uniform in the window."""
    centred = black_areas(flat.draws) / flat.window.area - 0.5
    variance = arak_laws.black_fraction_variance(flat.scale, flat.window)
    return {"black share: mean": centred, "black share: variance": centred**2 - variance}


LAWS: tuple[Callable[[Flat], Residuals], ...] = (
    edge_count,
    total_length,
    interior_vertices,
    extremes,
    side_vertices,
    border_vertices,
    segment_crossings,
    colours,
    monochrome,
    edge_lengths,
    interior_angles,
    side_angles,
    left_angles,
    black_fraction,
)


def _at(window: Window, share: tuple[float, float]) -> Floats:
    """Return the point at a share of the window's width and height."""
    return np.array([window.x_min + share[0] * window.width, window.y_min + share[1] * window.height])


def _if_expected(name: str, happened: NDArray[np.bool_], probability: float) -> Residuals:
    return {name: happened - probability} if len(happened) * probability >= MIN_EXPECTED else {}


def _distance_to_border(start: Floats, end: Floats, window: Window) -> Floats:
    """Return how far each edge could run from its left end through its right end before it leaves the window."""
    direction = (end - start) / np.hypot(*(end - start).T)[:, None]
    goal = np.where(direction > 0, np.array(window[2:]), np.array(window[:2]))
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(direction == 0, np.inf, (goal - start) / direction)
    return room.min(axis=1)
