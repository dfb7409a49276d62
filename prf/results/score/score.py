"""All scores of one map against one held-out log: densities of readings, labelled points, distances."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.window import LARGEST_RANGE
from prf.results.score.heldout import CLIP, OUTSIDE, SQUARE, HeldOut, HeldOutSonar
from prf.results.score.maps import ScoredMap, SonarPrediction
from prf.results.score.poses import marginalise
from prf.results.score.truth import TrueCells, truth_scores
from prf.shell.cli.provenance import spawn_generators
from prf.shell.errors import ConfigError, InputError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEAR = 0.2  # metres within which a distance counts as right
FREE_UP_TO = 0.95  # share of a beam on which free points lie
METRES_PER_FREE_POINT = 2.0


def score(
    scored: ScoredMap,
    held_out: HeldOut | None,
    seed: int | None = None,
    sonar: HeldOutSonar | None = None,
    cells: TrueCells | None = None,
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
        found |= sonar_scores(scored.predict_sonar(cones), cones, int(np.count_nonzero(~inside)))
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
        "max_range": beams.model.max_range,
        "seed": seed,
    }


def _certain_scores(scored: ScoredMap, beams: HeldOut, seed: int, square: float) -> dict[str, Any]:
    """Return the scores of beams where they are."""
    prediction = scored.predict(beams)
    points = draw_points(beams, spawn_generators(seed, 1)[0])
    return {
        "beam_nll": -float(np.log(prediction.density).mean()),
        **point_scores(scored, points, square),
        **distance_scores(prediction.distance, beams),
        "sensor_occupied": prediction.share_occupied,
        "n_points": len(points.occupied),
    }


def _marginal_scores(scored: ScoredMap, beams: HeldOut, seed: int, square: float) -> dict[str, Any]:
    """Return the scores of beams whose poses are integrated out; those of points and distances are at mean poses."""
    assert beams.poses is not None
    found = marginalise(scored, beams, spawn_generators(seed, 2)[1])
    points = [draw_points(placed, spawn_generators(seed, 1)[0]) for placed in found.placed]  # the same along each beam
    shares = [one.predict(placed).share_occupied for one, placed in zip(found.maps, found.placed, strict=True)]
    probability = np.zeros(len(points[0].occupied))
    for one, at in zip(found.maps, points, strict=True):
        probability += np.nan_to_num(one.occupied(at.xy, square), nan=OUTSIDE) / len(found.maps)
    middle = np.mean([at.xy for at in points], axis=0)
    return {
        "beam_nll": found.beam_nll,
        **_point_scores(probability, points[0].occupied, scored.seen(middle)),
        **distance_scores(found.distance, beams),
        "sensor_occupied": float(np.mean(shares)),
        "n_points": len(probability),
        "pose_noise": beams.poses.noise[1:].tolist(),
        "pose_draws": len(found.maps),
        "pose_ess": found.ess,
    }


def sonar_scores(prediction: SonarPrediction, cones: HeldOutSonar, n_outside: int) -> dict[str, Any]:
    """Return ``sonar_nll`` (nats) and its companions; the better one where there are several ways."""
    with np.errstate(divide="ignore"):
        found = {way: -float(np.log(density).mean()) for way, density in prediction.density.items()}
    ways = {f"sonar_nll_{way}": value for way, value in found.items() if way}
    return {
        "n_readings": len(cones.pose),
        "n_readings_outside": n_outside,
        "n_readings_no_return": int(np.count_nonzero(np.isinf(cones.range))),
        "sonar_nll": min(found.values()),
        **ways,
        "sonar_sensor_occupied": prediction.share_occupied,
        "sonar_max_range": cones.model.max_range,
    }


def point_scores(scored: ScoredMap, points: LabelledPoints, square: float) -> dict[str, float]:
    """Return ``auc``, ``nll``, ``brier`` of all points, and of those that some reading of the map's log saw."""
    return _point_scores(scored.occupied(points.xy, square), points.occupied, scored.seen(points.xy))


def _point_scores(probability: Floats, occupied: Bools, seen: Bools | None) -> dict[str, float]:
    found = classification_scores(probability, occupied)
    if seen is None:
        return {**found, **dict.fromkeys(("share_unseen", *(f"{name}_seen" for name in found)), math.nan)}
    known = classification_scores(probability[seen], occupied[seen])
    return {**found, "share_unseen": float(np.mean(~seen)), **{f"{name}_seen": v for name, v in known.items()}}


def distance_scores(distance: Floats, beams: HeldOut) -> dict[str, float]:
    """Return ``within_0.2m``, ``rmse`` in metres, and ``no_obstacle``, the share of beams that meet none."""
    error = np.abs(beams.range - distance)
    met = distance < beams.model.max_range
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


class LabelledPoints(NamedTuple):
    """Points of known state."""

    xy: Floats  # (n, 2) metres
    occupied: NDArray[np.bool_]  # (n,)


def draw_points(beams: HeldOut, rng: np.random.Generator) -> LabelledPoints:
    """Return one occupied point at each return r, and int(r / 2) free points uniform on [0, 0.95 r] of its beam."""
    n_free = (beams.range / METRES_PER_FREE_POINT).astype(np.int64)
    beam = np.repeat(np.arange(len(n_free)), n_free)
    along = rng.random(len(beam)) * FREE_UP_TO * beams.range[beam]
    free = beams.origin[beam] + along[:, None] * beams.direction[beam]
    occupied = np.arange(len(n_free) + len(beam)) < len(n_free)
    return LabelledPoints(np.concatenate([beams.returns(), free]), occupied)


def classification_scores(probability: Floats, occupied: NDArray[np.bool_]) -> dict[str, float]:
    """Return ``auc``, ``nll`` (nats, mean) and ``brier`` (mean) of probabilities (n,) against states (n,)."""
    if len(occupied) == 0:
        return dict.fromkeys(("auc", "nll", "brier"), math.nan)
    known = np.where(np.isnan(probability), OUTSIDE, probability)
    clipped = np.clip(known, CLIP, 1.0 - CLIP)
    return {
        "auc": ranking_area(known, occupied),
        "nll": float(-np.log(np.where(occupied, clipped, 1.0 - clipped)).mean()),
        "brier": float(((known - occupied) ** 2).mean()),
    }


def ranking_area(values: Floats, positive: NDArray[np.bool_]) -> float:
    """Return the area under the ROC curve: how often a positive outranks a negative, a tie counting half.

    `values` (n,). `positive` (n,). Returns: nan if one of the two kinds is absent.
    """
    n_positive = int(np.count_nonzero(positive))
    n_negative = len(positive) - n_positive
    if n_positive == 0 or n_negative == 0:
        return float("nan")
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    middle_rank = np.cumsum(counts) - 0.5 * (counts - 1)
    rank_sum = float(middle_rank[place.reshape(-1)[positive]].sum())
    return (rank_sum - 0.5 * n_positive * (n_positive + 1)) / (n_positive * n_negative)
