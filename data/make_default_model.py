"""Train the model that ships with mapq, on simulated maps of different noise and drift: ``make model``, four minutes.

Clean maps are among them, and noisy sensors: a model that has seen neither calls every rough wall suspicious. The clean
ones have more than their share of what looks like an error and is none. Six of the maps are given without the fields
that say when and from where points were seen, as most maps of users are. Both kinds of labels count as often as they
are: on real maps that are consistent, a balanced model lets one conflict redden a street.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from dataclasses import replace
from pathlib import Path

from mapq.cli import app
from mapq.features.provenance import PASS, SCAN, TIME, TO_SENSOR
from mapq.io import read_patches, write_patches
from prf.shell.run import run_app

MODEL = Path(__file__).resolve().parent.parent / "mapq" / "models" / "default.json"

MAPS = (
    # seed, standard deviation of ranges in metres, drift in times the usual, whether points say when and whence
    (101, 0.010, 1.0, True),
    (102, 0.015, 1.0, False),
    (103, 0.020, 1.0, True),
    (104, 0.030, 1.0, False),
    (105, 0.050, 1.0, False),
    (106, 0.015, 0.6, True),
    (107, 0.030, 0.6, False),
    (108, 0.010, 1.5, False),
    (109, 0.050, 1.5, True),
    (110, 0.010, 0.0, True),
    (111, 0.030, 0.0, True),
    (112, 0.050, 0.0, False),
    (113, 0.015, 0.0, True),
    (114, 0.020, 0.0, True),
)
CLEAN_LOOK_ALIKES = 3.0
"""Times the usual, on maps without drift."""
LEAST_DISAGREEMENT, DISAGREEMENT_IN_NOISE = 0.05, 3.3
"""Metres, and standard deviations: passes closer than either cannot be told from one rough wall."""


def call(*args: object) -> None:
    """Run a verb quietly; its failure ends the script."""
    with contextlib.redirect_stdout(io.StringIO()):
        code = run_app(app, "mapq", [*map(str, args), "-q"])
    if code != 0:
        raise SystemExit(f"mapq {' '.join(map(str, args))}: exit code {code}")


def make_map(folder: Path, seed: int, noise: float, drift: float, told: bool) -> Path:
    """Simulate, segment and label one map."""
    cloud, patches = folder / f"{seed}.ply", folder / f"seed-{seed}.patches"
    disagreement = max(LEAST_DISAGREEMENT, DISAGREEMENT_IN_NOISE * noise)
    world = ("--seed", seed, "--noise", noise, "--drift", drift, "--disagreement", disagreement)
    if drift == 0.0:
        world += ("--look-alikes", CLEAN_LOOK_ALIKES)
    call("simulate", *world, "-o", cloud)
    call("segment", cloud, "-o", patches)
    call("label", patches, "--from-field", "truth")
    cloud.unlink()
    if not told:
        forget(patches)
    return patches


def forget(path: Path) -> None:
    """Take the fields away that say when and from where points were seen."""
    patches = read_patches(path)
    told = (SCAN, TIME, PASS, *TO_SENSOR)
    kept = {name: values for name, values in patches.cloud.fields.items() if name not in told}
    write_patches(path, replace(patches, cloud=replace(patches.cloud, fields=kept)))


def main() -> None:
    """Write the model."""
    MODEL.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        maps = [make_map(Path(folder), *row) for row in MAPS]
        call("train", *maps, "--objective", "max-margin", "--class-weight", "none", "-o", MODEL, "-f")
    print("wrote", MODEL)


if __name__ == "__main__":
    main()
