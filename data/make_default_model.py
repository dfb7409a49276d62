"""Train the model that ships with mapq, on simulated maps of different noise and drift: ``make model``, three minutes.

Clean maps are among them, and noisy sensors: a model that has seen neither calls every rough wall suspicious. Both
kinds of labels count as often as they are: on real maps that are consistent, a balanced model lets one conflict redden
a street.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from pathlib import Path

from mapq.cli import app
from prf.shell.run import run_app

MODEL = Path(__file__).resolve().parent.parent / "mapq" / "models" / "default.json"

MAPS = (
    # seed, standard deviation of ranges in metres, drift in times the usual
    (101, 0.010, 1.0),
    (102, 0.015, 1.0),
    (103, 0.020, 1.0),
    (104, 0.030, 1.0),
    (105, 0.050, 1.0),
    (106, 0.015, 0.6),
    (107, 0.030, 0.6),
    (108, 0.010, 1.5),
    (109, 0.050, 1.5),
    (110, 0.010, 0.0),
    (111, 0.030, 0.0),
    (112, 0.050, 0.0),
)
LEAST_DISAGREEMENT, DISAGREEMENT_IN_NOISE = 0.05, 3.3
"""Metres, and standard deviations: passes closer than either cannot be told from one rough wall."""


def call(*args: object) -> None:
    """Run a verb quietly; its failure ends the script."""
    with contextlib.redirect_stdout(io.StringIO()):
        code = run_app(app, "mapq", [*map(str, args), "-q"])
    if code != 0:
        raise SystemExit(f"mapq {' '.join(map(str, args))}: exit code {code}")


def make_map(folder: Path, seed: int, noise: float, drift: float) -> Path:
    """Simulate, segment and label one map."""
    cloud, patches = folder / f"{seed}.ply", folder / f"seed-{seed}.patches"
    disagreement = max(LEAST_DISAGREEMENT, DISAGREEMENT_IN_NOISE * noise)
    world = ("--seed", seed, "--noise", noise, "--drift", drift, "--disagreement", disagreement)
    call("simulate", *world, "-o", cloud)
    call("segment", cloud, "-o", patches)
    call("label", patches, "--from-field", "truth")
    cloud.unlink()
    return patches


def main() -> None:
    """Write the model."""
    MODEL.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        maps = [make_map(Path(folder), *row) for row in MAPS]
        call("train", *maps, "--class-weight", "none", "-o", MODEL, "-f")
    print("wrote", MODEL)


if __name__ == "__main__":
    main()
