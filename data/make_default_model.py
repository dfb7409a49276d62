"""Train the model that ships with mapq, on simulated maps of different noise and drift: ``make model``, four minutes.

Half of the maps have no drift: those of users are right for the most part, and a model that has hardly seen such maps
calls too much suspicious. Most have what real streets have beside offices (lorries side by side, sheds, balconies,
hedges), and a laser that looks all round. Each is given twice, with the fields that say when and from where points were
seen and, as most maps of users are, without. Labels are those of ``mapq perturb``: suspicious above 0.3 m of
disagreement, plausible up to 0.1 m, none between. Both kinds of labels count as often as they are.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from mapq.cli import app
from mapq.features.provenance import PASS, SCAN, TIME, TO_SENSOR
from mapq.io import write_patches
from mapq.io.models import read_model, write_model
from mapq.labels import label_from_field
from mapq.patches import Patches
from mapq.perturb.label import Rule, label_points
from mapq.segmentation import segment
from mapq.simulate import Settings, simulate
from prf.shell.run import run_app

MODEL = Path(__file__).resolve().parent.parent / "mapq" / "models" / "default.json"

OFFICES = {"variety": 0.0}
STREET = {"variety": 1.0, "all_round": True}
YARDS = {"variety": 2.0, "all_round": True}
LOOK_ALIKES = {"variety": 1.0, "look_alikes": 3.0}
BUSY = {"variety": 3.0, "look_alikes": 2.0, "all_round": True}
SPARSE = {"n_points": 250_000}
MAPS: tuple[tuple[int, float, float, dict[str, Any]], ...] = (
    # seed, standard deviation of ranges in metres, drift in times the usual, world
    (101, 0.010, 1.0, STREET),
    (102, 0.015, 1.0, OFFICES),
    (103, 0.020, 1.0, {"variety": 1.0}),
    (104, 0.030, 1.0, STREET),
    (105, 0.050, 1.0, YARDS),
    (106, 0.015, 0.6, STREET),
    (107, 0.030, 0.6, STREET),
    (108, 0.010, 1.5, {"variety": 1.0}),
    (109, 0.050, 1.5, STREET),
    (116, 0.030, 0.6, YARDS | SPARSE),
    (110, 0.010, 0.0, LOOK_ALIKES | STREET),
    (111, 0.030, 0.0, BUSY),
    (112, 0.050, 0.0, BUSY),
    (113, 0.015, 0.0, BUSY),
    (114, 0.020, 0.0, OFFICES | {"look_alikes": 3.0}),
    (115, 0.040, 0.0, BUSY | SPARSE),
    (117, 0.010, 0.0, BUSY | SPARSE),
    (118, 0.020, 0.0, BUSY | SPARSE),
    (119, 0.030, 0.0, LOOK_ALIKES | SPARSE),
    (120, 0.050, 0.0, YARDS | SPARSE),
)
LEAST_PLAUSIBLE, PLAUSIBLE_IN_NOISE = 0.1, 2.0
"""Metres, and standard deviations: passes closer than the larger of both agree."""
MOST_FALSE_ALARMS = 0.02
"""Of the plausible patches that were kept out."""


def call(*args: object) -> None:
    """Run a verb quietly; its failure ends the script."""
    with contextlib.redirect_stdout(io.StringIO()):
        code = run_app(app, "mapq", [*map(str, args), "-q"])
    if code != 0:
        raise SystemExit(f"mapq {' '.join(map(str, args))}: exit code {code}")


def make_map(folder: Path, row: tuple[int, float, float, dict[str, Any]]) -> tuple[Path, Path]:
    """Simulate, segment and label one map; write it with and without what tells when and from where it was seen."""
    seed, noise, drift, world = row
    patches = segment(simulate(Settings(noise=noise, drift=drift, **world), seed))
    rule = Rule(plausible_below=max(LEAST_PLAUSIBLE, PLAUSIBLE_IN_NOISE * noise))
    label = label_points(patches.cloud.fields["disagreement"], rule)
    patches = replace(patches, cloud=patches.cloud.with_fields(suspicious=label))
    patches = label_from_field(patches, "suspicious", f"seed {seed}")[0]
    paths = folder / f"seed-{seed}.patches", folder / f"seed-{seed}-bare.patches"
    for path, each in zip(paths, (patches, forget(patches)), strict=True):
        write_patches(path, each)
    return paths


def forget(patches: Patches) -> Patches:
    """Take the fields away that say when and from where points were seen."""
    told = (SCAN, TIME, PASS, *TO_SENSOR)
    kept = {name: values for name, values in patches.cloud.fields.items() if name not in told}
    return replace(patches, cloud=replace(patches.cloud, fields=kept))


def forget_the_run() -> None:
    """Take out of the model what is of this run alone: the same seeds give the same bytes.

    That is the moment of training, and the digests of maps that nobody keeps and whose container may change.
    """
    model = read_model(str(MODEL))
    maps = [{k: v for k, v in row.items() if k != "sha256"} for row in model.training["maps"]]
    training = {k: v for k, v in model.training.items() if k != "created"} | {"maps": maps}
    write_model(str(MODEL), replace(model, training=training))


def main() -> None:
    """Write the model."""
    MODEL.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        maps = [path for row in MAPS for path in make_map(Path(folder), row)]
        options = ("--objective", "max-margin", "--class-weight", "none", "--max-false-alarms", MOST_FALSE_ALARMS)
        call("train", *maps, *options, "-o", MODEL, "-f")
    forget_the_run()
    print("wrote", MODEL)


if __name__ == "__main__":
    main()
