"""Maps against a true plan, cell by cell: how much of what was in view they have right (docs/scores.md)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from prf.kernels.readings.sonar_features import BORDER, POSE_COS, POSE_SIN
from prf.model.laser import window_exit
from prf.model.layout import image_grid, pixel_centres
from prf.model.window import Window
from prf.results.geojson import OccupiedArea
from prf.results.score.heldout import CLIP, OUTSIDE, HeldOut, HeldOutSonar
from prf.results.score.maps import ScoredMap
from prf.results.score.scene import first_edges, outline
from prf.shell.errors import InputError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

CELL = 0.1  # side of the cells in metres
WALL_DEPTH = 0.2
"""Metres from a free cell in view up to which occupied cells count: no reading shows what lies deeper in a wall."""
SPACING = 0.05  # metres between places along a ray, and between rays of a cone at its maximum range: half a cell
MAX_CELLS = 25_000_000
MAX_PLACES = 4_000_000  # rays are followed in batches of about so many places


class TrueCells(NamedTuple):
    """The cells that count, and what they are in truth."""

    xy: Floats  # (n, 2) their middles in metres
    occupied: Bools  # (n,)


def true_cells(truth: OccupiedArea, beams: HeldOut | None, cones: HeldOutSonar | None) -> TrueCells:
    """Return the cells of a plan that count: those in view of the readings, or all.

    `truth`: without a window, the box round its polygons. `beams`, `cones`: where the sensors stood and looked. A free
    cell counts if a ray from them through the plan, up to its first wall, the maximum range or the end of the window,
    passes it; an occupied cell if such a cell lies within 0.2 m. None and None: every cell counts. Cells whose middle
    lies beyond the window never do.
    """
    window = truth.window or _box_round(truth)
    grid = image_grid(window, CELL)
    nx, ny = grid.nx, grid.ny
    if nx * ny > MAX_CELLS:
        raise InputError(f"the true plan fills {nx} x {ny} cells of {CELL} m, more than {MAX_CELLS}. Is it in metres?")
    xy = pixel_centres(grid)
    shapely.prepare(truth.region)
    occupied = np.asarray(shapely.contains_xy(truth.region, xy), dtype=np.bool_)
    counts = window.contains(xy, strictly=True)
    if not counts.any():
        raise InputError(f"the true plan is {window.width:g} x {window.height:g} m, less than a cell of {CELL} m.")
    if beams is not None or cones is not None:
        counts = _in_view(truth, window, counts.reshape(ny, nx), occupied.reshape(ny, nx), _rays(beams, cones))
    return TrueCells(xy[counts], occupied[counts])


def truth_scores(scored: ScoredMap, cells: TrueCells) -> dict[str, Any]:
    """Return ``iou_occupied``, ``iou_free`` and their companions; nan where neither has such a cell."""
    found = scored.occupied(cells.xy, 0.0)
    p = np.where(np.isnan(found), OUTSIDE, found)
    clipped = np.clip(p, CLIP, 1.0 - CLIP)
    return {
        "n_cells": len(p),
        "n_cells_occupied": int(np.count_nonzero(cells.occupied)),
        "iou_occupied": _overlap(p > OUTSIDE, cells.occupied),
        "iou_free": _overlap(p < OUTSIDE, ~cells.occupied),
        "cell_brier": float(((p - cells.occupied) ** 2).mean()),
        "cell_nll": float(-np.log(np.where(cells.occupied, clipped, 1.0 - clipped)).mean()),
        "cell_unknown": float(np.mean(p == OUTSIDE)),
    }


def _overlap(one: Bools, other: Bools) -> float:
    """Return intersection over union."""
    union = np.count_nonzero(one | other)
    return float(np.count_nonzero(one & other) / union) if union else math.nan


def _box_round(truth: OccupiedArea) -> Window:
    if truth.region.is_empty:
        raise InputError("the true plan has neither a polygon nor a window. Give it a property window.")
    return Window(*truth.region.bounds)


def _rays(beams: HeldOut | None, cones: HeldOutSonar | None) -> Floats:
    """Return origins, directions and maximum ranges of all rays, (n, 5); a cone is a fan of rays."""
    parts = [np.empty((0, 5))]
    if beams is not None:
        parts.append(beams.rays(None))
    if cones is not None:
        reach, pose = cones.model.max_range, cones.pose
        half = np.arctan(pose[:, BORDER])
        n = max(1, math.ceil(2.0 * half.max() * reach / SPACING))
        axis = np.arctan2(pose[:, POSE_SIN], pose[:, POSE_COS])
        turn = axis[:, None] + half[:, None] * ((2.0 * np.arange(n) + 1.0) / n - 1.0)
        fan = np.stack([np.cos(turn), np.sin(turn)], axis=-1).reshape(-1, 2)
        parts.append(np.column_stack([np.repeat(cones.origin, n, axis=0), fan, np.full(len(fan), reach)]))
    return np.concatenate(parts)


def _in_view(truth: OccupiedArea, window: Window, inside: Bools, occupied: Bools, rays: Floats) -> Bools:
    """Return which cells `inside` count, (ny nx,): free ones that a ray passes, occupied ones close to these."""
    is_free = window.contains(rays[:, :2], strictly=True) & ~shapely.contains_xy(truth.region, rays[:, :2])
    rays = rays[is_free]
    rays[:, 4] = np.minimum(rays[:, 4], window_exit(window, rays[:, :2], rays[:, 2:4]))
    segments = outline(truth.region, window)[0]
    seen = np.zeros(inside.shape, np.bool_)
    batch = max(1, int(MAX_PLACES * SPACING / max(rays[:, 4].max(initial=0.0), SPACING)))
    for start in range(0, len(rays), batch):
        some = np.ascontiguousarray(rays[start : start + batch])
        _mark_passed(seen, window, some, np.minimum(first_edges(some, segments, window), some[:, 4]))
    seen &= inside & ~occupied
    if not seen.any():
        raise InputError("no free cell of the true plan is in view of the readings. Are both in one frame?")
    near = ndimage.distance_transform_edt(~seen, sampling=CELL) <= WALL_DEPTH + 1e-9
    counts: Bools = (seen | (occupied & near)).reshape(-1)
    return counts


def _mark_passed(seen: Bools, window: Window, rays: Floats, length: Floats) -> None:
    """Mark the cells of places along rays, from the sensor on up to `length` (n,)."""
    n = np.ceil(length / SPACING).astype(np.int64)
    ray = np.repeat(np.arange(len(rays)), n)
    along = (np.arange(len(ray)) - np.repeat(np.cumsum(n) - n, n) + 0.5) * (length / np.maximum(n, 1))[ray]
    place = rays[ray, :2] + along[:, None] * rays[ray, 2:4]
    column, row = np.floor((place - np.array(window[:2])) / CELL).astype(np.int64).T
    seen[np.minimum(row, seen.shape[0] - 1), np.minimum(column, seen.shape[1] - 1)] = True
