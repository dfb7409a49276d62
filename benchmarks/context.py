"""What context is worth on true geometry that looks like an error: archways, fences, two-sided walls, gaps, glass.

Worlds with three times the usual look-alikes, driven through without drift (every patch is plausible, so what is called
suspicious is a false alarm) and with it (false alarms among plausible patches, and what is found). Models are trained
on 2,000 patches drawn from six usual worlds and two more of the first kind; last is the one that ships, whose worlds
are others. The majority, plausible, has no false alarm and finds nothing. "Without passes" takes the fields away that
say when and from where points were seen, as most maps have it. Some four minutes; `python -m benchmarks.context --json`
prints all numbers.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.drawn_labels import draw_labels
from benchmarks.literal import measure_by
from benchmarks.table2 import MANY, PLAIN, TRAIN_SEEDS, Row, make_map, seen
from mapq.configuration import CONTEXTS, FeatureSettings, SimulateSettings, TrainSettings
from mapq.crf import classify
from mapq.crf.cross_validation import train
from mapq.crf.train import TrainingMap
from mapq.features.compute import feature_settings
from mapq.io.models import read_default_model
from mapq.labels import SUSPICIOUS
from mapq.model import Model
from mapq.patches import Patches
from mapq.simulate import Kind
from mapq.training import N_REGIONS, region_size, regions_of

TRAIN_CLEAN_SEEDS = (51, 52)
"""Of worlds that look like those below and have no drift either, beside the six usual ones: a model must have seen what
it is to let pass."""
CLEAN_SEEDS, DRIFTED_SEEDS = (41, 42, 43, 44), (45, 46)
LOOK_ALIKES = 3.0
GROUPS = {
    "archways": (Kind.ARCH,),
    "fences": (Kind.RAILING,),
    "two-sided walls": (Kind.GARDEN_WALL,),
    "side walls": (Kind.SIDE_WALL,),
    "panes and doors": (Kind.RECESS,),
    "facades": (Kind.FACADE,),
    "kerbs": (Kind.KERB,),
    "all patches": tuple(Kind),
}
"""Groups of patches by what most of their points were reflected from."""


ROWS = (
    Row("nodes only", PLAIN, TrainSettings(edge_model="none")),
    Row("paper-literal", None, TrainSettings(edge_model="symmetric")),
    Row("no context", PLAIN, TrainSettings()),
    Row("context, without passes", FeatureSettings(), TrainSettings()),
    Row("context", FeatureSettings(), TrainSettings(), True),
    Row("context, max-margin", FeatureSettings(), TrainSettings(objective="max-margin"), True),
    *(
        Row(
            f"  without {name}", FeatureSettings(context=tuple(c for c in CONTEXTS if c != name)), TrainSettings(), True
        )
        for name in CONTEXTS
    ),
)


def kinds_of(patches: Patches) -> NDArray[np.int64]:
    """Return the kind (m,) of most points of each patch."""
    inside = patches.patch >= 0
    votes = np.zeros((len(patches), len(Kind)), np.int64)
    np.add.at(votes, (patches.patch[inside], patches.cloud.fields["kind"][inside]), 1)
    return np.asarray(votes.argmax(axis=1))


def teach(row: Row, maps: Sequence[Patches]) -> Model:
    """Return the model that a row teaches."""
    labels = draw_labels(maps, MANY, 0)
    regions = regions_of(maps, labels, region_size(labels, N_REGIONS))
    found = [measure_by(patches, row.features) for patches in maps]
    return train([TrainingMap(*each) for each in zip(found, labels, regions, strict=True)], row.settings).model


def shipped_rows() -> dict[str, tuple[Row, Model]]:
    """Return the model that ships, as it judges maps without passes and with them."""
    model = read_default_model()
    settings = feature_settings(model)
    rows = [Row("shipped model", settings, TrainSettings()), Row("  passes known", settings, TrainSettings(), True)]
    return {row.name: (row, model) for row in rows}


def run(row: Row, model: Model, worlds: Mapping[str, Sequence[Patches]]) -> dict[str, Any]:
    """Return false alarms by group and world, and the share of suspicious patches that is found."""
    out: dict[str, Any] = {"name": row.name}
    for world, maps in worlds.items():
        called = np.concatenate(
            [classify(measure_by(each, row.features), model).label == SUSPICIOUS for each in seen(row, maps)]
        )
        truth = np.concatenate([each.label == SUSPICIOUS for each in maps])
        kind = np.concatenate([kinds_of(each) for each in maps])
        out[world] = {}
        for name, kinds in GROUPS.items():
            some = np.isin(kind, kinds) & ~truth
            out[world][name] = {"n": int(some.sum()), "false_alarms": int(called[some].sum())}
        out[world]["found"] = float(called[truth].mean()) if truth.any() else None
    return out


def lines(rows: Sequence[dict[str, Any]], world: str) -> list[str]:
    """Return the table of one world."""
    counts = rows[0][world]
    names = [name for name in GROUPS if counts[name]["n"]]
    table = [f"{world}: false alarms, per cent of the plausible patches; found: per cent of the suspicious ones"]
    table.append(f"{'':26}" + "".join(f"{name:>17}" for name in names) + f"{'found':>8}")
    table.append(f"{'patches':26}" + "".join(f"{counts[name]['n']:>17}" for name in names))
    for row in rows:
        shares = [100.0 * row[world][name]["false_alarms"] / counts[name]["n"] for name in names]
        found = row[world]["found"]
        end = "" if found is None else f"{100.0 * found:>8.1f}"
        table.append(f"{row['name']:26}" + "".join(f"{share:>17.1f}" for share in shares) + end)
    return table


def main() -> None:
    """Run all rows and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    as_json = parser.parse_args().json
    clean = SimulateSettings(look_alikes=LOOK_ALIKES, drift=0.0)
    train_maps = [make_map(seed) for seed in TRAIN_SEEDS] + [make_map(seed, clean) for seed in TRAIN_CLEAN_SEEDS]
    worlds = {
        "without drift": [make_map(seed, clean) for seed in CLEAN_SEEDS],
        "with drift": [make_map(seed, SimulateSettings(look_alikes=LOOK_ALIKES)) for seed in DRIFTED_SEEDS],
    }
    models = {row.name: (row, teach(row, seen(row, train_maps))) for row in ROWS} | shipped_rows()
    rows = [run(row, model, worlds) for row, model in models.values()]
    if as_json:
        print(json.dumps(rows))
        return
    for world in worlds:
        print("\n".join(lines(rows, world)), "\n")


if __name__ == "__main__":
    main()
