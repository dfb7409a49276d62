"""Files for tests of the verbs of mapq: labelled patches, a cloud, a model."""

from __future__ import annotations

import json
from pathlib import Path

from mapq.cli import app
from mapq.io import write_patches, write_ply
from mapq.io.models import write_model
from prf.shell.cli.run import run_app
from tests.mapq.labelled import draw_patches
from tests.mapq.results.test_result import make_model


def call(capsys, *args: object) -> tuple[int, str, str]:
    """Return exit code, standard output and standard error of `mapq` with `args`."""
    code = run_app(app, "mapq", [str(arg) for arg in args])
    out, err = capsys.readouterr()
    return code, out, err


def call_json(capsys, *args: object) -> dict:
    """Return the object that a successful call with --json prints."""
    code, out, _ = call(capsys, *args, "--json")
    assert code == 0
    return json.loads(out)


def save_patches(folder: Path, seed: int = 1, labelled: bool = True) -> Path:
    path = folder / f"walls{seed}.patches"
    write_patches(path, draw_patches(seed, labelled=labelled))
    return path


def save_cloud(folder: Path, seed: int = 1) -> Path:
    path = folder / f"walls{seed}.ply"
    write_ply(path, draw_patches(seed).cloud)
    return path


def save_model(folder: Path) -> Path:
    path = folder / "m.json"
    write_model(path, make_model())
    return path
