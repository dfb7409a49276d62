"""Numbers of a set of maps of `benchmarks.unseen`: ranks, false alarms, what is found by kind of surface and error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.unseen_rivals import Plain
from benchmarks.unseen_sets import ALONE, PAIRED, RIGHT, WRONG, Map
from benchmarks.unseen_table import BINS, FALSE_ALARMS, METHODS, MODEL, POINTS, SCANS
from mapq.crf import Labelling
from mapq.labels import PLAUSIBLE, SUSPICIOUS
from mapq.results.compare import compare
from mapq.results.evaluate import area_under_curve, calibration_error
from mapq.results.judged import Judged
from prf.shell.errors import InputError

CELL = 5.0
"""Side in metres of the cubes in which maps are compared."""
LEAST_LABELS = 5
"""Patches of either label that a row of a set needs."""

TOLERANCES = (0.1, 0.2, 0.3)
"""Metres at which maps are judged; all else is at the last."""
BETWEEN, AGREES = (0.12, 0.3), 0.05
"""Metres: truly apart at the first tolerance and not at the last, and surely not apart."""
FAR, NEAR = 0.2, 0.1
"""Metres: patches farther apart shall rank before those that are closer."""
OF_KINDS = {POINTS: (TOLERANCES[-1], 0.28, 0.1), SCANS: (TOLERANCES[0], 0.1, AGREES)}
"""Tolerance at which kinds of surfaces are judged; patches truly farther apart, and closer, than these are compared."""
KINDS = {"upright": [0], "level": [1], "both": [0, 1]}
"""Kinds of surfaces, by their places in `mapq.configuration.SURFACES`."""
HEIGHTS = ("raised", "rising")
"""Errors of the height of scans."""


class Said(NamedTuple):
    """What is said of a map, in one variant.

    Attributes
    ----------
    row : Map
    label : (m,) uint8
        The truth.
    plain : Plain
    area : (m,) float64
        m².
    called : (m,) bool
        Suspicious by the model, at its threshold.
    probability : (m,) float64
        Of the model.
    score : dict of str to (m,) float64
        By method; the higher, the more suspicious.
    share, judged : float
        Of area that is called suspicious, and of points that are in patches.
    kind, counts : (m,)
        Of the surface, its place in `SURFACES`; its share of the points of the map.
    points : Judged
        At most `MOST_COMPARED` of them.
    disagreement : (m, 3) float64
        Low, value and high in metres, nan where unknown.
    at : dict of float to Labelling
        By tolerance.
    """

    row: Map
    label: np.ndarray
    plain: Plain
    area: np.ndarray
    called: np.ndarray
    probability: np.ndarray
    score: dict[str, np.ndarray]
    share: float
    judged: float
    kind: np.ndarray
    counts: np.ndarray
    points: Judged
    disagreement: np.ndarray
    at: dict[float, Labelling]


def of_kind(said: Sequence[Said], kind: str, variant: str) -> dict[str, float]:
    """Return how one kind of surface is judged: share of points, ranks, what is found, and false alarms.

    Of level surfaces maps that are right, or wrong in height: other errors move them within their planes.
    """
    tolerance, far, near = OF_KINDS[variant]
    parts, shares = [], []
    for each in said:
        mine = np.isin(each.kind, KINDS[kind])
        shares.append(each.counts[mine].sum())
        is_right = each.row.kind in (RIGHT, ALONE)
        if is_right or kind != "level" or each.row.error in HEIGHTS:
            at, first = each.at[tolerance], each.at[TOLERANCES[0]].label == SUSPICIOUS
            columns = (at.probability, at.label == SUSPICIOUS, each.score[MODEL], first, each.plain.metres)
            parts.append((np.full(np.count_nonzero(mine), is_right), *(values[mine] for values in columns)))
    right, p, called, at_last, called_first, true = (np.concatenate(part) for part in zip(*parts, strict=True))
    between, agrees = (true > BETWEEN[0]) & (true < BETWEEN[1]), true < AGREES
    return {
        "share_of_points": float(np.mean(shares)),
        "n_far": int((true > far).sum()),
        "auc": _auc(p, true, far, near),
        "found": _share(called[true > far].sum(), (true > far).sum()),
        "n_right": int(right.sum()),
        "alarms": _share(called[right].sum(), right.sum()),
        "auc_at_last": _auc(at_last, true, TOLERANCES[-1], NEAR),
        "recall_at_last": _recall(at_last[true > TOLERANCES[-1]], at_last[true < NEAR]),
        "found_between": _share(called_first[between].sum(), between.sum()),
        "called_below": _share(called_first[agrees].sum(), agrees.sum()),
    }


def _auc(score: np.ndarray, true: np.ndarray, far: float, near: float) -> float:
    """Return how often a patch truly farther apart than `far` scores above one closer than `near`."""
    ranked = (true > far) | (true < near)
    both = len(np.unique(true[ranked] > far)) == 2
    return area_under_curve(score[ranked].astype(float), true[ranked] > far) if both else float("nan")


def summary(said: Sequence[Said], variant: str) -> dict[str, Any]:
    """Return the numbers of one set in one variant."""
    right = [each for each in said if each.row.kind in (RIGHT, ALONE)]
    found: dict[str, Any] = {
        "role": said[0].row.role,
        "false_alarms": {
            thinned: false_alarms([e for e in right if e.row.thinned == thinned]) for thinned in _thinned(right)
        },
        "ranks": {thinned: ranks([e for e in said if e.row.thinned == thinned]) for thinned in (1, PAIRED)},
        "judged": float(np.mean([each.judged for each in said])),
        "shares": {each.row.name: each.share for each in said},
        "disagreement": metres(said),
        "curve": curve(said),
        "tolerances": tolerances(said),
        "kinds": {kind: of_kind(said, kind, variant) for kind in KINDS},
    }
    pairs = [(one, other) for one in said for other in said if one.row.kind == RIGHT and other.row.kind == WRONG]
    found["compare"] = [sum(_ranked(*pair) for pair in pairs), len(pairs)]
    alike = [(one, other) for one, other in pairs if one.row.thinned == other.row.thinned]
    found["compare_entropy"] = [sum(one.plain.whole < other.plain.whole for one, other in alike), len(alike)]
    found["thinning"], found["growth"] = _shift(said), _growth(said)
    return found


def _thinned(said: Sequence[Said]) -> list[int]:
    return sorted({each.row.thinned for each in said})


def false_alarms(said: Sequence[Said]) -> dict[str, float]:
    """Return the share of patches and of area called suspicious of maps that are right."""
    called, area = (np.concatenate([getattr(each, name) for each in said]) for name in ("called", "area"))
    return {
        "n": len(called),
        "patches": _share(called.sum(), len(called)),
        "area": _share(area[called].sum(), area.sum()),
    }


def _share(part: float, whole: float) -> float:
    return float(part / whole) if whole else float("nan")


def ranks(said: Sequence[Said]) -> dict[str, Any] | None:
    """Return how well methods tell suspicious patches from plausible ones, over all maps; None of too few."""
    if not said:
        return None
    label = np.concatenate([each.label for each in said])
    bad, good = label == SUSPICIOUS, label == PLAUSIBLE
    if min(bad.sum(), good.sum()) < LEAST_LABELS:
        return None
    known = bad | good
    found: dict[str, Any] = {"n": int(known.sum()), "base_rate": float(bad.sum() / known.sum())}
    for method in METHODS:
        if all(method in each.score for each in said):
            score = np.concatenate([each.score[method] for each in said])
            found[method] = {
                "auc": area_under_curve(score[known], bad[known]),
                "recall": _recall(score[bad], score[good]),
            }
    called, p = (np.concatenate([getattr(each, name) for each in said]) for name in ("called", "probability"))
    found["recall_shipped"], found["alarms_shipped"] = (
        _share(called[bad].sum(), bad.sum()),
        _share(called[good].sum(), good.sum()),
    )
    found["ece"] = calibration_error(p[known], bad[known])
    return found


def _recall(bad: np.ndarray, good: np.ndarray) -> float:
    """Return the share of suspicious patches above the threshold that calls at most `FALSE_ALARMS` of the others so."""
    if not len(bad) or not len(good):
        return float("nan")
    allowed = int(FALSE_ALARMS * len(good))
    return float(np.mean(bad > np.sort(good)[::-1][allowed]))


def metres(said: Sequence[Said]) -> dict[str, float] | None:
    """Return errors of the disagreement in metres where it is measured and known; None elsewhere."""
    low, value, high = np.concatenate([each.disagreement for each in said]).T
    true = np.concatenate([each.plain.metres for each in said])
    known = np.isfinite(true) & np.isfinite(value)
    if not known.any():
        return None
    inside = (low[known] <= true[known]) & (true[known] <= high[known])
    error, width = np.abs(value - true)[known], (high - low)[known]
    return {
        "n": int(known.sum()),
        "known": _share(known.sum(), np.isfinite(true).sum()),
        "error": float(np.median(error)),
        "coverage": float(inside.mean()),
        "width": float(np.median(width)),
    }


def tolerances(said: Sequence[Said]) -> dict[str, Any]:
    """Return what is called suspicious at two tolerances, how patches rank, and how well p is calibrated."""
    true = np.concatenate([each.plain.metres for each in said])
    label, p = (
        {t: np.concatenate([getattr(each.at[t], name) for each in said]) for t in TOLERANCES}
        for name in ("label", "probability")
    )
    between, agrees, known = (true > BETWEEN[0]) & (true <= BETWEEN[1]), true < AGREES, np.isfinite(true)
    first, last = (label[t] == SUSPICIOUS for t in (TOLERANCES[0], TOLERANCES[-1]))
    ranked = known & ((true > FAR) | (true < NEAR))
    both = len(np.unique(true[ranked] > FAR)) == 2
    return {
        "n_between": int(between.sum()),
        "found": _share(first[between].sum(), between.sum()),
        "alarms": _share(first[agrees].sum(), agrees.sum()),
        "called_at_last": _share(last[between].sum(), between.sum()),
        "auc": area_under_curve(p[0.2][ranked].astype(float), true[ranked] > FAR) if both else float("nan"),
        "ece": [calibration_error(p[t][known].astype(float), true[known] > t) for t in TOLERANCES],
    }


def curve(said: Sequence[Said]) -> dict[str, list[float]]:
    """Return how many patches are displaced by how much, and the share of them that is called suspicious."""
    true, called = np.concatenate([each.plain.metres for each in said]), np.concatenate([each.called for each in said])
    place = np.digitize(true[np.isfinite(true)], BINS)
    n, bad = (np.bincount(place, weight, len(BINS) + 1) for weight in (None, called[np.isfinite(true)]))
    return {"n": n.tolist(), "called": [_share(part, whole) for part, whole in zip(bad, n, strict=True)]}


def _ranked(right: Said, wrong: Said) -> bool:
    """Return whether the comparison of a right map and a wrong one says so."""
    try:
        return compare(right.points, wrong.points, CELL).better == "first"
    except InputError:  # no common ground
        return False


def _shift(said: Sequence[Said]) -> float:
    """Return by how much at most the share of area moves from all points to a sixth of them."""
    keyed = {(e.row.kind, e.row.error, e.row.size, e.row.seed, e.row.thinned): e.share for e in said}
    moved = [
        abs(keyed[(*key[:4], 1)] - share) for key, share in keyed.items() if key[4] == PAIRED and (*key[:4], 1) in keyed
    ]
    return float(np.max(moved)) if moved else float("nan")


def _growth(said: Sequence[Said]) -> list[int]:
    """Return in how many pairs of maps, wrong alike by two sizes, the larger error has the larger share; and all."""
    wrong = [each for each in said if each.row.kind == WRONG]
    pairs = [
        (one.share, other.share)
        for one in wrong
        for other in wrong
        if one.row.size < other.row.size
        and (one.row.error, one.row.seed, one.row.thinned) == (other.row.error, other.row.seed, other.row.thinned)
    ]
    return [sum(small < large for small, large in pairs), len(pairs)]
