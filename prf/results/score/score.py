"""All scores of one map: against a held-out log, and cell by cell against a true plan (docs/scores.md).

A log gives densities of readings, labelled points and distances; a plan how much of what was in view is right.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from prf.kernels.readings.sonar_features import BORDER, POSE_COS, POSE_SIN
from prf.model.layout import image_grid, pixel_centres
from prf.model.ranges import window_exit
from prf.model.sensors import LARGEST_RANGE
from prf.model.window import Window
from prf.results.geojson import OccupiedArea
from prf.results.score.heldout import CLIP, OUTSIDE, SQUARE, HeldOut, HeldOutSonar
from prf.results.score.maps import DrawsMap, ScoredMap
from prf.results.score.poses import MOST_MAPS, marginalise
from prf.results.score.scene import first_edges, outline
from prf.shell.cli.storage import spawn_generators
from prf.shell.errors import ConfigError, InputError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEAR = 0.2  # metres within which a distance counts as right
FREE_UP_TO = 0.95  # share of a beam on which free points lie
METRES_PER_FREE_POINT = 2.0
POINT_SCORES = ("auc", "nll", "brier")
SQUARE_OF_WEIGHTS = 0.2
"""Metres of a beam for which a free point counts as one: a beam passes so many squares and ends in one."""


class LabelledPoints(NamedTuple):
    """Points of known state."""

    xy: Floats  # (n, 2) metres
    occupied: Bools  # (n,)
    weight: Floats | None = None  # (n,) of each point; None: all alike


def score(
    scored: ScoredMap,
    held_out: HeldOut | None,
    seed: int | None = None,
    sonar: HeldOutSonar | None = None,
    cells: LabelledPoints | None = None,
    square: float = SQUARE,
) -> dict[str, Any]:
    """Return every score of a map that the readings and a true plan allow.

    `held_out`: beams whose sensor is outside the window of the map are dropped and counted. `seed`: of the free points;
    wanted with beams. `sonar`: likewise. `cells`: of the true plan. `square`: side in metres of the square round each
    held-out point; 0: the point, of a GRID its cell. Returns: names and definitions: docs/scores.md; nan where a score
    is not defined.
    """
    if not 0.0 <= square <= LARGEST_RANGE:
        raise ConfigError(f"square {square}: must be a number of metres from 0 to {LARGEST_RANGE:g}")
    found: dict[str, Any] = {"kind": scored.kind, "n_draws": scored.n_draws}
    if held_out is not None:
        assert seed is not None
        found |= _laser_scores(scored, held_out, seed, square)
    if sonar is not None:
        inside = _known(scored, sonar.origin)
        cones = sonar.select(inside)
        found |= sonar_scores(scored, cones, int(np.count_nonzero(~inside)))
    if cells is not None:
        found |= truth_scores(scored, cells)
    return found


def _laser_scores(scored: ScoredMap, held_out: HeldOut, seed: int, square: float) -> dict[str, Any]:
    """Return the scores that beams give."""
    inside = _known(scored, held_out.origin)
    beams = held_out.select(inside)
    judged = _certain_scores if beams.poses is None else _marginal_scores
    return {
        "n_beams": len(beams.range),
        "n_outside": int(np.count_nonzero(~inside)),
        "n_no_return": held_out.n_no_return,
        "n_censored": int(np.count_nonzero(beams.readings(beams.rays(scored.window)) < 0.0)),
        **judged(scored, beams, seed, square),
        "square": square,
        "max_range": beams.model.limit,
        "seed": seed,
    }


def _certain_scores(scored: ScoredMap, beams: HeldOut, seed: int, square: float) -> dict[str, Any]:
    """Return the scores of beams where they are."""
    density, distance, share_occupied = scored.predict(beams)
    points = draw_points(beams, spawn_generators(seed, 1)[0])
    return {
        "beam_nll": -float(np.log(density).mean()),
        **point_scores(scored, points, square),
        **distance_scores(distance, beams),
        "sensor_occupied": share_occupied,
        "n_points": len(points.occupied),
    }


def _marginal_scores(scored: ScoredMap, beams: HeldOut, seed: int, square: float) -> dict[str, Any]:
    """Return the scores of beams whose poses are integrated out; those of points and distances are at mean poses."""
    assert beams.poses is not None
    maps = scored.singles(MOST_MAPS)
    placed, distance, beam_nll, ess = marginalise(scored, maps, beams, spawn_generators(seed, 2)[1])
    points = [draw_points(each, spawn_generators(seed, 1)[0]) for each in placed]  # the same along each beam
    shares = [one.predict(each)[2] for one, each in zip(maps, placed, strict=True)]
    probability = np.zeros(len(points[0].occupied))
    for one, at in zip(maps, points, strict=True):
        probability += np.nan_to_num(one.occupied(at.xy, square), nan=OUTSIDE) / len(maps)
    middle = points[0]._replace(xy=np.mean([at.xy for at in points], axis=0))
    returned = scored.returned(middle.xy, square) if isinstance(scored, DrawsMap) else None
    return {
        "beam_nll": beam_nll,
        **_point_scores(probability, returned, middle, scored.seen(middle.xy)),
        **distance_scores(distance, beams),
        "sensor_occupied": float(np.mean(shares)),
        "n_points": len(probability),
        "pose_noise": beams.poses.noise[1:].tolist(),
        "pose_draws": len(maps),
        "pose_ess": ess,
    }


def sonar_scores(scored: ScoredMap, cones: HeldOutSonar, n_outside: int) -> dict[str, Any]:
    """Return ``sonar_nll`` (nats) and its companions; the better one where there are several ways."""
    densities, share_occupied = scored.predict_sonar(cones)
    with np.errstate(divide="ignore"):
        found = {way: -float(np.log(density).mean()) for way, density in densities.items()}
    ways = {f"sonar_nll_{way}": value for way, value in found.items() if way}
    return {
        "n_readings": len(cones.pose),
        "n_readings_outside": n_outside,
        "n_readings_no_return": int(np.count_nonzero(np.isinf(cones.range))),
        "sonar_nll": min(found.values()),
        **ways,
        "sonar_sensor_occupied": share_occupied,
        "sonar_max_range": cones.model.max_range,
    }


def point_scores(scored: ScoredMap, points: LabelledPoints, square: float) -> dict[str, float]:
    """Return ``auc``, ``nll``, ``brier`` of all points, and of those that some reading of the map's log saw.

    Of a RUN they are of the probability that a beam ends there, and ``*_map`` of the share of draws that are occupied.
    """
    returned = scored.returned(points.xy, square) if isinstance(scored, DrawsMap) else None
    return _point_scores(scored.occupied(points.xy, square), returned, points, scored.seen(points.xy))


def _point_scores(
    occupied: Floats, returned: Floats | None, points: LabelledPoints, seen: Bools | None
) -> dict[str, float]:
    """Return the scores of the probabilities (n,) that points are occupied, or rather that beams end there."""
    probability = occupied if returned is None else returned
    weight = np.ones(len(probability)) if points.weight is None else points.weight
    found = _with_unweighted(probability, points.occupied, weight, "")
    if returned is not None:
        found |= _with_unweighted(occupied, points.occupied, weight, "_map")
    if seen is None:
        return {**found, **dict.fromkeys(("share_unseen", *(f"{name}_seen" for name in POINT_SCORES)), math.nan)}
    known = classification_scores(probability[seen], points.occupied[seen], weight[seen])
    return {**found, "share_unseen": float(np.mean(~seen)), **{f"{name}_seen": v for name, v in known.items()}}


def _with_unweighted(probability: Floats, occupied: Bools, weight: Floats, of: str) -> dict[str, float]:
    """Return the scores of probabilities (n,), weighted and not; `of` is added to their names."""
    weighted, plain = (classification_scores(probability, occupied, each) for each in (weight, None))
    found = {f"{name}{of}": value for name, value in weighted.items()}
    return found | {f"{name}{of}_unweighted": value for name, value in plain.items()}


def distance_scores(distance: Floats, beams: HeldOut) -> dict[str, float]:
    """Return ``within_0.2m``, ``rmse`` in metres, and ``no_obstacle``, the share of beams that meet none."""
    error = np.abs(beams.range - distance)
    met = distance < beams.model.limit
    if np.isnan(distance).any():
        return dict.fromkeys(("within_0.2m", "rmse", "no_obstacle"), math.nan)
    return {
        "within_0.2m": float(np.mean(error < NEAR)),
        "rmse": float(np.sqrt(np.mean(error[met] ** 2))) if met.any() else math.nan,
        "no_obstacle": float(np.mean(~met)),
    }


def _known(scored: ScoredMap, origin: Floats) -> NDArray[np.bool_]:
    """Return which sensors are inside the window; at least one of them is."""
    if scored.window is None:
        return np.ones(len(origin), np.bool_)
    inside = scored.window.contains(origin, strictly=True)
    if not inside.any():
        raise InputError("no held-out sensor is inside the window of the map. Are both in one frame?")
    return inside


def draw_points(beams: HeldOut, rng: np.random.Generator) -> LabelledPoints:
    """Return one occupied point at each return r, and int(r / 2) free points uniform on [0, 0.95 r] of its beam.

    The free points of a beam weigh together as much as it passes squares of 0.2 m there.
    """
    n_free = (beams.range / METRES_PER_FREE_POINT).astype(np.int64)
    beam = np.repeat(np.arange(len(n_free)), n_free)
    along = rng.random(len(beam)) * FREE_UP_TO * beams.range[beam]
    free = beams.origin[beam] + along[:, None] * beams.direction[beam]
    occupied = np.arange(len(n_free) + len(beam)) < len(n_free)
    weight = FREE_UP_TO * beams.range[beam] / (SQUARE_OF_WEIGHTS * n_free[beam])
    xy = np.concatenate([beams.returns(), free])
    return LabelledPoints(xy, occupied, np.concatenate([np.ones(len(n_free)), weight]))


def classification_scores(probability: Floats, occupied: Bools, weight: Floats | None = None) -> dict[str, float]:
    """Return ``auc``, ``nll`` (nats, mean) and ``brier`` (mean) of probabilities (n,) against states (n,).

    `weight` (n,): of each; None: all alike.
    """
    if len(occupied) == 0:
        return dict.fromkeys(POINT_SCORES, math.nan)
    known = np.where(np.isnan(probability), OUTSIDE, probability)
    clipped = np.clip(known, CLIP, 1.0 - CLIP)
    return {
        "auc": ranking_area(known, occupied, weight),
        "nll": float(np.average(-np.log(np.where(occupied, clipped, 1.0 - clipped)), weights=weight)),
        "brier": float(np.average((known - occupied) ** 2, weights=weight)),
    }


def ranking_area(values: Floats, positive: Bools, weight: Floats | None = None) -> float:
    """Return the area under the ROC curve: how often a positive outranks a negative, a tie counting half.

    `values` (n,). `positive` (n,). `weight` (n,): of each; None: all alike. Returns: nan if one of the two kinds is
    absent.
    """
    weight = np.ones(len(values)) if weight is None else weight
    if positive.all() or not positive.any():
        return float("nan")
    _, place = np.unique(values, return_inverse=True)
    place = place.reshape(-1)
    above, below = np.bincount(place, weight * positive), np.bincount(place, weight * ~positive)
    return float(above @ (np.cumsum(below) - 0.5 * below) / (above.sum() * below.sum()))


CELL = 0.1  # side of the cells in metres
WALL_DEPTH = 0.2
"""Metres from a free cell in view up to which occupied cells count: no reading shows what lies deeper in a wall."""
SPACING = 0.05  # metres between places along a ray, and between rays of a cone at its maximum range: half a cell
MAX_CELLS = 25_000_000
MAX_PLACES = 4_000_000  # places in a batch of rays, about


def true_cells(truth: OccupiedArea, beams: HeldOut | None, cones: HeldOutSonar | None) -> LabelledPoints:
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
    return LabelledPoints(xy[counts], occupied[counts])


def truth_scores(scored: ScoredMap, cells: LabelledPoints) -> dict[str, Any]:
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
