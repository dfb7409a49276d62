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
from typing import Any

import numpy as np

from benchmarks import real_data
from benchmarks.real_methods import without_scans
from benchmarks.unseen_numbers import TOLERANCES, Said, summary
from benchmarks.unseen_rivals import Plain, columns_of, forest_of, make_training_maps, plain_numbers
from benchmarks.unseen_sets import Map, prepare, read_index, read_map
from benchmarks.unseen_table import BEFORE, ENTROPY, FOREST, MODEL, POINTS, SCANS, SPREAD, THICKNESS, lines
from mapq.crf import classify
from mapq.features.compute import feature_settings
from mapq.io.models import read_default_model, read_model
from mapq.model import Model
from mapq.results.judged import Judged, judge
from mapq.results.result import Result, assess

TRAINING, PLAIN = "training", "plain"
"""Folders of the cache."""
MOST_COMPARED = 100_000
"""Points of a map that are asked."""

Say = Callable[[str], None]


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
