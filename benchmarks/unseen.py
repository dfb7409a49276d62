"""`mapq` on real maps that no model was trained on: right ones, and wrong ones with known errors.

`prepare` writes the maps (PATCHES, a quarter of an hour) and, with `--training`, those of the shipped model, on which a
rival is trained; `score` prints the table for a model. Each set has two rows, *points alone* and *scans known*. Sets
for development may be looked at while something is built, all others only judge it. The data are public but not part
of this repository (`--data FOLDER`).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import real_data
from benchmarks.real_methods import without_scans
from benchmarks.unseen_rivals import Plain, columns_of, forest_of, make_training_maps, plain_numbers
from benchmarks.unseen_sets import ALONE, PAIRED, RIGHT, WRONG, Map, prepare, read_index, read_map
from benchmarks.unseen_table import (
    BEFORE,
    BINS,
    ENTROPY,
    FALSE_ALARMS,
    FOREST,
    METHODS,
    MODEL,
    POINTS,
    SCANS,
    SPREAD,
    THICKNESS,
    lines,
)
from mapq.configuration import SURFACES
from mapq.crf import Labelling, classify
from mapq.features.compute import feature_settings
from mapq.io.models import read_default_model, read_model
from mapq.labels import PLAUSIBLE, SUSPICIOUS
from mapq.model import Model
from mapq.results.compare import compare
from mapq.results.evaluate import area_under_curve, calibration_error
from mapq.results.judged import Judged, judge
from mapq.results.result import Result, assess
from prf.shell.errors import InputError

TRAINING, PLAIN = "training", "plain"
"""Folders of the cache."""
CELL, MOST_COMPARED = 5.0, 100_000
"""Side in metres of the cubes in which maps are compared, and points of a map that are asked."""
LEAST_LABELS = 5
"""Patches of either label that a row of a set needs."""

TOLERANCES = (0.1, 0.2, 0.3)
"""Metres at which maps are judged; all else is at the last."""
BETWEEN, AGREES = (0.12, 0.3), 0.05
"""Metres: truly apart at the first tolerance and not at the last, and surely not apart."""
FAR, NEAR = 0.2, 0.1
"""Metres: patches farther apart shall rank before those that are closer."""
OF_SURFACES = {POINTS: (TOLERANCES[-1], 0.28, 0.1), SCANS: (TOLERANCES[0], 0.1, AGREES)}
"""Tolerance at which kinds of surfaces are judged; patches truly farther apart, and closer, than these are compared."""

Say = Callable[[str], None]


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


def read_said(folder: Path, row: Map, model: Model, forest: Any, before: dict[str, Any]) -> dict[str, Said]:
    """Return what is said of a map, by variant."""
    known = read_map(folder, row)
    plain = plain_numbers(known, folder / PLAIN / f"{row.name}.npz")
    found = {}
    for variant, patches in ((POINTS, without_scans(known)), (SCANS, known)):
        result = assess(patches, model, tolerance=TOLERANCES[-1])
        score = _scores(result, plain if variant == SCANS else plain._replace(spread=None), forest)
        earlier = before.get(variant, {}).get(row.name)
        if earlier is not None:
            score[BEFORE] = np.array(earlier["difference"], np.float64)
        counts = result.counts
        found[variant] = Said(
            row,
            known.label,
            plain,
            result.area,
            result.is_suspicious,
            result.labelling.probability.astype(np.float64),
            score,
            float(counts["share_of_area"]),
            counts["n_points_in_patches"] / max(counts["n_points"], 1),
            patches.kinds,
            patches.counts / max(counts["n_points"], 1),
            _some(judge(result, row.name)),
            result.features.disagreement,
            {tolerance: classify(result.features, model, tolerance) for tolerance in TOLERANCES},
        )
    return found


def _scores(result: Result, plain: Plain, forest: Any) -> dict[str, np.ndarray]:
    """Return the scores (m,) of all methods but the earlier model."""
    shape = result.features.shape[:, result.features.shape_names.index("thickness_m")]
    found = {MODEL: result.labelling.difference, THICKNESS: shape, ENTROPY: plain.entropy}
    if forest is not None and len(shape):
        found[FOREST] = forest.predict_proba(columns_of(result.features))[:, 1]
    if plain.spread is not None:
        found[SPREAD] = plain.spread
    # What is not known speaks neither for nor against.
    return {name: np.nan_to_num(each, nan=_middle(each)) for name, each in found.items()}


def _middle(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _some(points: Judged) -> Judged:
    """Return every n-th point with the area of n."""
    step = max(1, -(-len(points.xyz) // MOST_COMPARED))
    names = ("xyz", "area", "suspicious", "probability", "disagreement", "error")
    some = points._replace(**{name: getattr(points, name)[::step] for name in names})
    return some._replace(area=step * some.area)


def of_surface(said: Sequence[Said], kind: int, variant: str) -> dict[str, float]:
    """Return how one kind of surface is judged: share of points, ranks, recall, and what is called of right maps."""
    tolerance, far, near = OF_SURFACES[variant]
    parts = []
    for each in said:
        mine, at = each.kind == kind, each.at[tolerance]
        is_right = np.full(np.count_nonzero(mine), each.row.kind in (RIGHT, ALONE))
        parts.append((each.plain.metres[mine], at.probability[mine], at.label[mine] == SUSPICIOUS, is_right))
    true, p, called, is_right = (np.concatenate(part) for part in zip(*parts, strict=True))
    ranked = (true > far) | (true < near)
    both = len(np.unique(true[ranked] > far)) == 2
    return {
        "share_of_points": float(np.mean([each.counts[each.kind == kind].sum() for each in said])),
        "n_far": int((true > far).sum()),
        "auc": area_under_curve(p[ranked].astype(float), true[ranked] > far) if both else float("nan"),
        "found": _share(called[true > far].sum(), (true > far).sum()),
        "n_right": int(is_right.sum()),
        "alarms": _share(called[is_right].sum(), is_right.sum()),
    }


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
        "surfaces": {name: of_surface(said, number, variant) for number, name in enumerate(SURFACES[:2])},
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


def score(
    folder: Path, model: Model, before: dict[str, Any], places: Sequence[str] | None, say: Say
) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Yield of each set its name, its numbers and what the model says of its patches, both by variant."""
    forest = forest_of(folder / TRAINING, feature_settings(model), say)
    rows = [row for row in read_index(folder) if places is None or row.place in places]
    for place in dict.fromkeys(row.place for row in rows):
        maps = [read_said(folder, row, model, forest, before) for row in rows if row.place == place]
        by_variant = {variant: [each[variant] for each in maps] for variant in (POINTS, SCANS)}
        yield (
            place,
            {variant: summary(said, variant) for variant, said in by_variant.items()},
            {variant: {each.row.name: kept(each) for each in said} for variant, said in by_variant.items()},
        )


def kept(said: Said) -> dict[str, list[float]]:
    """Return what the model says of the patches of a map, for JSON."""
    columns = {"label": said.called.astype(int), "probability": said.probability, "difference": said.score[MODEL]}
    return {name: values.round(6).tolist() for name, values in columns.items()}


def main() -> None:
    """Write the maps, or print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("verb", choices=("prepare", "score"))
    parser.add_argument("--cache", type=Path, required=True, help="folder with the maps, some 2 GB")
    parser.add_argument("--data", type=Path, default=real_data.DATA, help="folder with the public scans, for prepare")
    parser.add_argument("--training", action="store_true", help="prepare the maps of the shipped model too")
    parser.add_argument("--model", help="file of the model; that of the package unless given")
    parser.add_argument("--sets", nargs="+", help="these alone")
    parser.add_argument("--before", type=Path, help="what --keep wrote for another model, as one more column")
    parser.add_argument("--keep", type=Path, help="write what the model says of every patch")
    parser.add_argument("--json", type=Path, help="all numbers")
    options = parser.parse_args()
    say: Say = lambda line: print(line, flush=True)  # noqa: E731
    if options.verb == "prepare":
        prepare(options.data, options.cache, say)
        if options.training:
            make_training_maps(options.cache / TRAINING, say)
        return
    model = read_model(options.model) if options.model else read_default_model()
    before = json.loads(options.before.read_text()) if options.before else {}
    found: dict[str, Any] = {}
    said: dict[str, dict[str, Any]] = {POINTS: {}, SCANS: {}}
    for place, numbers, of_patches in score(options.cache, model, before, options.sets, say):
        say(f"scored {place}")
        found[place] = numbers
        for variant, maps in of_patches.items():
            said[variant] |= maps
        # After every set, as all of them take long.
        for path, content in ((options.json, found), (options.keep, said)):
            if path:
                path.write_text(json.dumps(content, default=float))
    for line in lines(found):
        say(line)


if __name__ == "__main__":
    main()
