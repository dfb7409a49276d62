"""What a page holds of a run as numbers: draws, cells, path and readings, packed small.

A chain changes little between two draws, so that each edge is stored once with the draws that have it, one after the
other. Coordinates are whole steps from the window's lower left corner.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Draws, black_at_draws
from prf.model.window import INTERIOR, Window
from prf.output.export.cells import Raster, returned_square
from prf.poses.posterior import Trajectory
from prf.results import PosteriorImage, RunData
from prf.results.estimate import NEAR
from prf.results.run import LEAST_DIFFERENCE
from prf.shell.cli.page import packed

MAX_BYTES = 2_500_000
"""Of the draws in a page, as text: all that is recorded of most runs. Of larger ones a thinned share is embedded."""
FINEST = 1e-3
"""Metres: coordinates are whole numbers of it, of less in windows under 16 m."""
STEPS = 2**14
MAX_READINGS = 20_000

Ints = NDArray[np.int64]


class Numbers(NamedTuple):
    """Whole numbers of a page: how to read them, and the text that holds them."""

    head: dict[str, Any]
    text: str


def step_of(window: Window) -> float:
    """Return the metres of a step."""
    return min(FINEST, max(window.width, window.height) / STEPS)


def fitting(run: RunData) -> tuple[RunData, Numbers]:
    """Return the run with as many of its draws as fit into a page, evenly thinned, and these draws packed."""
    every, kept, numbers = 1, run, pack_draws(run)
    while len(numbers.text) > MAX_BYTES and len(kept.draws) > run.n_chains:
        every = max(every + 1, round(every * len(numbers.text) / MAX_BYTES))
        kept = thinned(run, every)
        numbers = pack_draws(kept)
    return kept, numbers


def thinned(run: RunData, every: int) -> RunData:
    """Return the run with each chain's newest draw and every k-th before it."""
    rows = [np.flatnonzero(run.chain == chain)[::-1][::every] for chain in np.unique(run.chain)]
    keep = np.sort(np.concatenate(rows))
    return dataclasses.replace(
        run,
        draws=Draws.from_colorings([run.draws[i] for i in keep], run.draws.window),
        chain=run.chain[keep],
        step=run.step[keep],
        functionals={name: values[keep] for name, values in run.functionals.items()},
        probe_black=run.probe_black[keep],
    )


def pack_draws(run: RunData) -> Numbers:
    """Return draws in the order of chains: their vertices, and their edges with the draws that have them."""
    order = np.argsort(run.chain, kind="stable")
    chain, place = run.chain[order], np.argsort(order)
    window = run.draws.window
    vertices, edges, first, last = _lifetimes(run.draws, place, chain)
    corner = black_at_draws(run.draws, [[window.x_min, window.y_min]])[order, 0]
    by_x = np.diff(vertices[:, 0], prepend=0)
    by_start = np.diff(edges[:, 0], prepend=0)
    columns = (by_x, vertices[:, 1], by_start, edges[:, 1] - edges[:, 0], first, last - first)
    head = {
        "n_vertices": len(vertices),
        "n_edges": len(edges),
        "starts": [*np.searchsorted(chain, np.unique(chain)).tolist(), len(chain)],
        "chains": np.unique(chain),
        "step": run.step[order],
        "corner_black": corner.astype(np.uint8),
        "smallest_ess": run.smallest_ess,
        "probes": np.column_stack([run.probe_xy, run.probe_ess])[~np.isnan(run.probe_ess)],
        "near": NEAR,
    }
    return Numbers(head, packed(_planes(*columns)))


def _lifetimes(draws: Draws, place: Ints, chain: NDArray[np.int32]) -> tuple[Ints, Ints, Ints, Ints]:
    """Return vertices (n, 2), edges (m, 2) among them, and the draws (m,) from which and before which each is there.

    `place` (n_draws,): of each draw in the order of chains. `chain` (n_draws,): in that order.
    """
    xy = _whole(draws)
    key = (xy[:, 0] << 32) | xy[:, 1]
    ends = np.sort(key[draws.global_edges()], axis=1)
    draw = place[draws.draw_of_edge()]
    real = ends[:, 0] != ends[:, 1]
    ends, draw = ends[real], draw[real]
    order = np.lexsort((draw, ends[:, 1], ends[:, 0]))
    ends, draw = ends[order], draw[order]
    begins = np.ones(len(draw), np.bool_)
    is_next = (draw[1:] == draw[:-1] + 1) & (chain[draw[1:]] == chain[draw[:-1]])
    begins[1:] = (ends[1:] != ends[:-1]).any(axis=1) | ~is_next
    first = draw[begins]
    last = draw[np.append(begins[1:], np.ones(min(1, len(draw)), np.bool_))] + 1
    used, number = np.unique(ends[begins], return_inverse=True)
    return np.column_stack([used >> 32, used & 0xFFFFFFFF]), number.reshape(-1, 2), first, last


def _whole(draws: Draws) -> Ints:
    """Return the vertices in steps; those inside the window stay off its sides, by which colours are counted."""
    window, step = draws.window, step_of(draws.window)
    xy = np.rint((draws.xy - [window.x_min, window.y_min]) / step).astype(np.int64)
    size = np.rint([window.width / step, window.height / step]).astype(np.int64)
    inside = draws.side == INTERIOR
    xy[inside] = np.clip(xy[inside], 1, size - 1)
    return np.asarray(xy)


def pack_image(image: PosteriorImage, returns: Raster | None) -> Numbers:
    """Return the cells: probability and difference of chains in 255ths, whether a reading saw them, and p_return.

    `returns`: p_return of the same cells; None: not known.
    """
    differs = np.zeros_like(image.occupancy) if image.disagreement is None else image.disagreement
    shares = [np.rint(255.0 * np.nan_to_num(part)).astype(np.uint8) for part in (image.occupancy, differs)]
    rows, columns = image.occupancy.shape
    head = {
        "nx": columns,
        "ny": rows,
        "origin": image.origin,
        "resolution": image.resolution,
        "differs": 255 * LEAST_DIFFERENCE,
        "square": None if returns is None else returned_square(image.resolution),
    }
    parts = [*shares, image.seen.astype(np.uint8)]
    if returns is not None:
        parts.append(np.rint(255.0 * np.nan_to_num(returns.probability)).astype(np.uint8))
    return Numbers(head, packed(b"".join(part.tobytes() for part in parts)))


def pack_scene(run: RunData) -> Numbers:
    """Return the sensor's path, as it was given and where it may be, ends of readings, edges of the best map seen."""
    window, step = run.draws.window, step_of(run.draws.window)
    given = np.zeros((0, 2)) if run.trajectory is None else run.trajectory.given[:, :2]
    ellipses = np.zeros((0, 6)) if run.trajectory is None else _ellipses(run.trajectory)
    run = run.placed()
    ends = np.zeros((0, 2)) if run.laser is None else run.laser.impacts()
    arcs = np.zeros((0, 6)) if run.sonar is None else run.sonar.arcs()[:, [0, 4, 8]].reshape(-1, 6)
    points = np.zeros((0, 2)) if run.points is None else run.points.xy
    parts = {"path": run.path_xy, "given": given, "ellipses": ellipses}
    parts |= {"returns": _some(ends), "arcs": _some(arcs), "points": _some(points), "best": _outline(run)}
    corner = np.array([window.x_min, window.y_min])
    columns = [np.rint((part.reshape(-1, 2) - corner) / step).astype(np.int64) for part in parts.values()]
    head: dict[str, Any] = {name: part.size for name, part in parts.items()}
    return Numbers(head, packed(_planes(*(part.ravel() for part in columns))))


def _ellipses(found: Trajectory) -> NDArray[np.float64]:
    """Return for each pose (n, 6) the middle and an end of each half axis of the ellipse that holds it at 95 %."""
    middle = found.mean[:, None, :2]
    return np.concatenate([middle, middle + found.ellipses()], axis=1).reshape(-1, 6)


def _outline(run: RunData) -> NDArray[np.float64]:
    """Return the edges (n, 4) of the best map that touch ground which readings saw."""
    if run.best is None or run.image is None:
        return np.zeros((0, 4))
    lines = run.best.xy[run.best.edges]
    return np.asarray(lines[run.image.sees(lines)].reshape(-1, 4))


def _some(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return every k-th row, so that no more than `MAX_READINGS` are embedded."""
    return rows[:: max(1, -(-len(rows) // MAX_READINGS))]


def _planes(*columns: Ints) -> bytes:
    """Return whole numbers as little-endian int32, first all lowest bytes: what is alike then lies together."""
    whole = np.concatenate([np.asarray(column, "<i4") for column in columns])
    return whole.view(np.uint8).reshape(-1, 4).T.tobytes()
