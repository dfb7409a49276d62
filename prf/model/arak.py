"""The Arak process with scale p, the prior over polygonal maps: exact means and exact draws.

How moves weigh it: prf/kernels/state/prior.py. Sources: Arak 1982; Arak & Surgailis 1989; Paskin & Thrun 2005, 1.3.2.
Further exact laws: tests/reference/arak_laws.py.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray

from prf.kernels.arak_sampler import Size, draw_many
from prf.model.coloring.graph import Coloring, Draws, black_areas
from prf.model.orientation import PLAIN, Orientation, line_law
from prf.model.window import SIDES, Window
from prf.shell.errors import ConfigError

MAX_EDGES = 1e8
"""Of all draws of a call: gigabytes."""
MOST_TILT = 15.0
"""Cost of a window that is all black, nats, up to which draws are kept often enough."""
BATCH = 2000
"""Draws of which some are kept, at a time."""


def compare(
    draws: Draws, scale: float, orientation: Orientation = PLAIN, free_space: float = 0.0
) -> dict[str, float | None]:
    """Return the means of edge count and total length (m) over one or more draws, beside their exact values.

    There are none where black costs something.
    """
    is_known = free_space == 0.0
    return {
        "n_draws": len(draws),
        "mean_edges": float(draws.n_edges.mean()),
        "expected_edges": expected_edges(scale, draws.window, orientation) if is_known else None,
        "mean_length": float(draws.total_length().mean()),
        "expected_length": expected_length(scale, draws.window) if is_known else None,
    }


def expected_edges(scale: float, window: Window, orientation: Orientation = PLAIN) -> float:
    """Return the mean number of edges, p perimeter + 4 pi p^2 area without preferred directions.

    With these both parts are smaller, as p d log Z / dp and the mean of sum lambda |e| give them.
    """
    border, inside = scale * window.perimeter, 4.0 * math.pi * scale**2 * window.area
    if orientation.is_plain:
        return border + inside
    crossed, paired = orientation.mean_factors()
    return border * crossed + inside * paired


def expected_length(scale: float, window: Window) -> float:
    """Return the mean total edge length, pi p area."""
    return math.pi * scale * window.area


def refuse_too_many_edges(scale: float, window: Window, n_draws: int) -> None:
    """Raise ConfigError if draws have so many edges that neither time nor memory would do for them."""
    expected = min(n_draws, sys.maxsize) * expected_edges(scale, window)
    if not expected <= MAX_EDGES:
        raise ConfigError(
            f"scale {scale:g}: {n_draws} draws on {window.width:g} x {window.height:g} m would have about "
            f"{expected:.2g} edges. Give a smaller scale or window, or fewer draws."
        )


def exact_draws(
    scale: float,
    window: Window,
    n_draws: int,
    rng: np.random.Generator,
    orientation: Orientation = PLAIN,
    free_space: float = 0.0,
) -> Draws:
    """Return independent draws of the Arak process by its dynamic representation.

    With a cost of black, draws are kept with the probability that it leaves them.

    Parameters
    ----------
    scale : float
        p in 1/m, above 0.
    window : Window
    n_draws : int
    rng : numpy.random.Generator
        Advanced by as many numbers as the draws take.
    orientation : Orientation
        Directions that edges prefer; what is sampled is drawn anew for each draw.
    free_space : float
        Cost of a square metre of black, nats.

    Returns
    -------
    Draws

    Raises
    ------
    ConfigError
        If `n_draws` is negative, the draws would have more than `MAX_EDGES`, or hardly any would be kept.
    """
    if n_draws < 0:
        raise ConfigError(f"{n_draws} draws: the number cannot be negative.")
    refuse_too_many_edges(scale, window, n_draws)
    if free_space > 0.0:
        return _kept_draws(scale, window, n_draws, rng, orientation, free_space)
    n_laws = n_draws if orientation.is_sampled else 1
    lines = np.array([line_law(*orientation.draw(rng), scale, window) for _ in range(n_laws)]).reshape(n_laws, -1)
    size = Size(window.width, window.height, scale, np.zeros(0))
    vertices, edges, offsets, anchor_black = draw_many(n_draws, size, lines, rng)
    side = vertices[:, 2].astype(np.int8)
    columns = np.ascontiguousarray(offsets.T)
    return Draws(
        window, columns[0], _placed(vertices[:, :2], side, window), side, columns[1], edges.copy(), anchor_black
    )


def _kept_draws(
    scale: float, window: Window, n_draws: int, rng: np.random.Generator, orientation: Orientation, free_space: float
) -> Draws:
    """Return draws of the process weighed by exp(-free_space x black area), by rejection."""
    if free_space * window.area > MOST_TILT:
        raise ConfigError(
            f"free_space {free_space:g}: exact draws would be refused nearly always in a window of {window.area:g} m². "
            f"Give at most {MOST_TILT / window.area:.2g}, or --method mcmc."
        )
    kept: list[Coloring] = []
    while len(kept) < n_draws:
        draws = exact_draws(scale, window, BATCH, rng, orientation)
        is_kept = rng.random(BATCH) < np.exp(-free_space * black_areas(draws))
        kept += [draws[int(i)] for i in np.flatnonzero(is_kept)]
    return Draws.from_colorings(kept[:n_draws], window)


def _placed(xy: NDArray[np.float64], side: NDArray[np.int8], window: Window) -> NDArray[np.float64]:
    """Move vertices of [0, width] x [0, height] into the window: inside stays inside, sides get their coordinate."""
    lower, upper = np.array(window[:2]), np.array(window[2:])
    placed: NDArray[np.float64] = np.clip(xy + lower, np.nextafter(lower, upper), np.nextafter(upper, lower))
    for s in SIDES:
        placed[side == s, 1 - s % 2] = window.side_coordinate(s)
    return placed
