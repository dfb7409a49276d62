"""A second, naive simulator of the Arak process, written without a look at the first, with switches to spoil it.

Particles stand in no order; the next random event is drawn afresh after each event (Gillespie), the next meeting is
the first among all pairs, and every direction comes by rejection from its density. Velocity form: y = y0 + v (x - x0).
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring, Draws
from prf.model.window import BOTTOM, INTERIOR, LEFT, RIGHT, TOP, Window

MOST = 4096
"""Room for vertices, edges and particles of one draw."""


def naive_draws(
    scale: float, window: Window, n_draws: int, rng: np.random.Generator, turns: float = 2.0, sine_border: bool = False
) -> Draws:
    """Return draws; `turns` other than 2 or `sine_border` make a wrong process.

    Parameters
    ----------
    turns : float
        Rate of turns per length in units of p.
    sine_border : bool
        Let particles start on the left side with density |sin f| / 2 in place of cos(f) / 2.
    """
    found = []
    for _ in range(n_draws):
        vertices, edges = _simulate(window.width, window.height, scale, turns, sine_border, rng)
        found.append(_coloring(vertices, edges, window, rng))
    return Draws.from_colorings(found, window)


def _coloring(
    vertices: NDArray[np.float64], edges: NDArray[np.int64], window: Window, rng: np.random.Generator
) -> Coloring:
    side = vertices[:, 2].astype(np.int8)
    xy = vertices[:, :2] + (window.x_min, window.y_min)
    for s in range(4):
        xy[side == s, 1 - s % 2] = window.side_coordinate(s)
    return Coloring(window, xy, side, edges.astype(np.int32), bool(rng.integers(2)))


@numba.njit
def _by_rejection(reference: float, rng: np.random.Generator) -> float:
    """Direction in (-pi/2, pi/2) with density proportional to |sin(f - reference)|."""
    while True:
        f = math.pi * (rng.random() - 0.5)
        if rng.random() < abs(math.sin(f - reference)):
            return f


@numba.njit
def _first_meeting(now: float, x0: np.ndarray, y0: np.ndarray, v: np.ndarray, n: int) -> tuple[float, int, int]:
    best, first, second = math.inf, -1, -1
    for i in range(n):
        for j in range(i):
            if v[i] != v[j] and not (x0[i] == x0[j] and y0[i] == y0[j]):
                x = (y0[j] - v[j] * x0[j] - y0[i] + v[i] * x0[i]) / (v[i] - v[j])
                if now < x < best:
                    best, first, second = x, i, j
    return best, first, second


@numba.njit
def _first_exit(
    width: float, height: float, x0: np.ndarray, y0: np.ndarray, v: np.ndarray, n: int
) -> tuple[float, int]:
    best, which = math.inf, -1
    for i in range(n):
        x = width
        if v[i] != 0.0:
            goal = height if v[i] > 0.0 else 0.0
            x = min(width, x0[i] + (goal - y0[i]) / v[i])
        if x < best:
            best, which = x, i
    return best, which


@numba.njit
def _simulate(
    width: float, height: float, p: float, turns: float, sine_border: bool, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    x0, y0, v, origin = np.empty(MOST), np.empty(MOST), np.empty(MOST), np.empty(MOST, np.int64)
    vertices, edges = np.empty((MOST, 3)), np.empty((MOST, 2), np.int64)
    n = n_v = n_e = 0
    left_reference = 0.0 if sine_border else 0.5 * math.pi
    for _ in range(rng.poisson(2.0 * p * height)):
        x0[n], y0[n], v[n], origin[n] = 0.0, height * rng.random(), math.tan(_by_rejection(left_reference, rng)), n_v
        vertices[n_v, 0], vertices[n_v, 1], vertices[n_v, 2] = 0.0, y0[n], LEFT
        n, n_v = n + 1, n_v + 1
    now = 0.0
    while True:
        rates = np.sqrt(1.0 + v[:n] ** 2) * turns * p
        inside, border = math.pi * p * p * height, 2.0 * p
        total = rates.sum() + inside + border
        random_x = now + rng.exponential() / total
        meeting_x, i, j = _first_meeting(now, x0, y0, v, n)
        exit_x, leaving = _first_exit(width, height, x0, y0, v, n)
        now = min(random_x, meeting_x, exit_x)
        if now >= width and n == 0:
            return vertices[:n_v], edges[:n_e]
        gone = (-1, -1)
        new = 0
        x, y, side = now, 0.0, INTERIOR
        first = second = 0.0
        if now == meeting_x and meeting_x < exit_x:
            gone, y = (max(i, j), min(i, j)), y0[i] + v[i] * (now - x0[i])
        elif now == exit_x:
            gone = (leaving, -1)
            y = y0[leaving] + v[leaving] * (now - x0[leaving])
            side = RIGHT if now == width else (TOP if v[leaving] > 0.0 else BOTTOM)
            if side != RIGHT:
                y = height if side == TOP else 0.0
        elif now >= width:
            continue
        else:
            chosen = rng.random() * total
            if chosen < inside:
                y, new = height * rng.random(), 2
                first = math.pi * (rng.random() - 0.5)
                second = _by_rejection(first, rng)
            elif chosen < inside + border:
                side = BOTTOM if rng.random() < 0.5 else TOP
                y, new = (0.0 if side == BOTTOM else height), 1
                first = abs(_by_rejection(0.0, rng)) * (1.0 if side == BOTTOM else -1.0)
            else:
                turning = min(int(np.searchsorted(np.cumsum(rates), chosen - inside - border)), n - 1)
                gone, new = (turning, -1), 1
                y = y0[turning] + v[turning] * (now - x0[turning])
                first = _by_rejection(math.atan(v[turning]), rng)
        vertices[n_v, 0], vertices[n_v, 1], vertices[n_v, 2] = x, y, side
        for k in gone:
            if k >= 0:
                edges[n_e, 0], edges[n_e, 1] = origin[k], n_v
                n_e, n = n_e + 1, n - 1
                x0[k], y0[k], v[k], origin[k] = x0[n], y0[n], v[n], origin[n]
        for k in range(new):
            x0[n], y0[n], v[n], origin[n] = x, y, math.tan(first if k == 0 else second), n_v
            n += 1
        n_v += 1
