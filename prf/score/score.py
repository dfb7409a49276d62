"""All scores of one map against one held-out log."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.score.cones import HeldOutSonar, sonar_scores
from prf.score.config import SQUARE
from prf.score.heldout import HeldOut
from prf.score.maps import Prediction, ScoredMap
from prf.score.points import LabelledPoints, classification_scores, draw_points
from prf.score.truth import TrueCells, truth_scores
from prf.shell.errors import InputError
from prf.shell.seeds import spawn_generators

Floats = NDArray[np.float64]

NEAR = 0.2
"""Metres within which a distance counts as right."""


def score(
    scored: ScoredMap,
    held_out: HeldOut | None,
    seed: int | None = None,
    sonar: HeldOutSonar | None = None,
    cells: TrueCells | None = None,
    square: float = SQUARE,
) -> dict[str, Any]:
    """Return every score of a map that the readings and a true plan allow.

    Parameters
    ----------
    scored : ScoredMap
    held_out : HeldOut or None
        Beams whose sensor stands outside the window of the map are dropped and counted.
    seed : int, optional
        Of the free points; wanted with beams.
    sonar : HeldOutSonar, optional
        Likewise.
    cells : TrueCells, optional
        Of the true plan.
    square : float
        Side in metres of the square round each held-out point that is asked for; 0: the point, of a GRID its cell.

    Returns
    -------
    dict
        Names and definitions stand in docs/scores.md; nan where a score is not defined.

    Raises
    ------
    InputError
        If no sensor of a kind stands inside the window.
    """
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
    prediction = scored.predict(beams)
    points = draw_points(beams, spawn_generators(seed, 1)[0])
    return {
        "n_beams": len(beams.range),
        "n_outside": int(np.count_nonzero(~inside)),
        "n_no_return": held_out.n_no_return,
        "n_censored": int(np.count_nonzero(beams.readings(beams.rays(scored.window)) < 0.0)),
        "beam_nll": -float(np.log(prediction.density).mean()),
        **point_scores(scored, points, square),
        **distance_scores(prediction, beams),
        "sensor_occupied": prediction.share_occupied,
        "n_points": len(points.occupied),
        "square": square,
        "max_range": beams.model.max_range,
        "seed": seed,
    }


def point_scores(scored: ScoredMap, points: LabelledPoints, square: float) -> dict[str, float]:
    """Return ``auc``, ``nll``, ``brier`` of all points, and of those that some reading of the map's log saw."""
    probability = scored.occupied(points.xy, square)
    found = classification_scores(probability, points.occupied)
    seen = scored.seen(points.xy)
    if seen is None:
        return {**found, **dict.fromkeys(("share_unseen", *(f"{name}_seen" for name in found)), math.nan)}
    known = classification_scores(probability[seen], points.occupied[seen])
    return {**found, "share_unseen": float(np.mean(~seen)), **{f"{name}_seen": v for name, v in known.items()}}


def distance_scores(prediction: Prediction, beams: HeldOut) -> dict[str, float]:
    """Return ``within_0.2m``, ``rmse`` in metres, and ``no_obstacle``, the share of beams that meet none."""
    error = np.abs(beams.range - prediction.distance)
    met = prediction.distance < beams.model.max_range
    if np.isnan(prediction.distance).any():
        return dict.fromkeys(("within_0.2m", "rmse", "no_obstacle"), math.nan)
    return {
        "within_0.2m": float(np.mean(error < NEAR)),
        "rmse": float(np.sqrt(np.mean(error[met] ** 2))) if met.any() else math.nan,
        "no_obstacle": float(np.mean(~met)),
    }


def _known(scored: ScoredMap, origin: Floats) -> NDArray[np.bool_]:
    """Return which sensors stand inside the window; at least one of them does."""
    if scored.window is None:
        return np.ones(len(origin), np.bool_)
    inside = scored.window.contains(origin, strictly=True)
    if not inside.any():
        raise InputError("no held-out sensor stands inside the window of the map. Are both in one frame?")
    return inside
