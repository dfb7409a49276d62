"""Calls of both tools in this process, and one small call of every verb on files that :func:`make_samples` writes."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mapq.cloud import PointCloud
from mapq.io import write_patches, write_ply
from mapq.io.models import write_model
from prf.model.window import Window
from prf.results import write_run
from prf.results.occupancy import write_grid
from prf.shell.cli.run import run_app
from tests.factories import make_room_run, make_run, random_draws, write_draws
from tests.mapq.factories import wall
from tests.mapq.labelled import draw_patches
from tests.mapq.perturb.scenes import look, pose_at
from tests.mapq.results.test_result import make_model
from tests.readings.samples import flaser
from tests.results.test_occupancy import BEAM, build
from tests.shell.test_pose_files import rows


class Outcome(NamedTuple):
    """Exit code, standard output and standard error of a call."""

    code: int
    out: str
    err: str


def call(line: str, folder: Path, *more: str, stdin: bytes = b"") -> Outcome:
    """Call a tool with `folder` as working directory."""
    tool, *args = [*line.split(), *more]
    app = importlib.import_module(f"{tool}.cli").app
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()
    before, sys.stdin = sys.stdin, io.TextIOWrapper(io.BytesIO(stdin))
    try:
        with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = run_app(app, tool, args)
    finally:
        sys.stdin = before
    if out.closed:
        return Outcome(code, "", err.getvalue())
    out.flush()
    return Outcome(code, out.buffer.getvalue().decode(errors="replace"), err.getvalue())


def prf(*words: object) -> int:
    """Call `prf` in the present folder and return its exit code; what it prints is left to pytest."""
    return run_app(importlib.import_module("prf.cli").app, "prf", [*map(str, words)])


def mapq(*words: object) -> int:
    """Call `mapq` likewise."""
    return run_app(importlib.import_module("mapq.cli").app, "mapq", [*map(str, words)])


class Verb(NamedTuple):
    """A call of a verb in the folder of samples.

    Attributes
    ----------
    call : str
        Tool, verb and arguments.
    reads : tuple of str
        Files among the arguments.
    writes : tuple of str
        Files of a complete result; a folder ends in "/".
    """

    call: str
    reads: tuple[str, ...]
    writes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Tool and verb."""
        return " ".join(self.call.split()[:2])

    @property
    def title(self) -> str:
        """Tool, verb and its first input, unique among :data:`VERBS`."""
        return " ".join([self.name, *self.reads[:1], *(word for word in self.call.split() if word == "--workers")])


FEW = "--chains 1 --steps 20 --window -5 -5 5 5 --seed 1"
VERBS = (
    Verb(f"prf sample --laser laser.log -o out.run {FEW} --resolution 1", ("laser.log",), ("out.run/",)),
    Verb(f"prf sample --sonar sonar.csv --config set.toml -o out.run {FEW}", ("sonar.csv", "set.toml"), ("out.run/",)),
    Verb(f"prf sample --point-data values.csv -o out.run {FEW}", ("values.csv",), ("out.run/",)),
    Verb(f"prf anneal --laser laser.log -o out.geojson {FEW}", ("laser.log",), ("out.geojson",)),
    Verb("prf grid --laser laser.log --sonar sonar.csv -o out.npz", ("laser.log", "sonar.csv"), ("out.npz",)),
    Verb("prf info laser.log", ("laser.log",)),
    Verb("prf query grid.npz --points points.csv", ("grid.npz", "points.csv")),
    Verb("prf query run --path points.csv --radius 0.2", ("points.csv", "run/draws.npz")),
    Verb("prf explore room -o out.csv --picture out.png", ("room/draws.npz",), ("out.csv", "out.png")),
    Verb("prf inspect run", ("run/manifest.json",)),
    Verb("prf inspect draws.geojsonl", ("draws.geojsonl",)),
    Verb("prf config show set.toml", ("set.toml",)),
    Verb("prf score room.geojson --laser laser.log", ("room.geojson", "laser.log")),
    Verb(
        "prf calibrate --map room.geojson --laser laser.log -o out.toml", ("room.geojson", "laser.log"), ("out.toml",)
    ),
    Verb("prf render draws.geojsonl -o out.png", ("draws.geojsonl",), ("out.png",)),
    Verb("prf render run -o out.svg", ("run/manifest.json",), ("out.svg",)),
    Verb("prf report run -o out.html", ("run/draws.npz",), ("out.html",)),
    Verb("prf export run --format ros-map -o out.yaml", ("run/draws.npz",), ("out.yaml", "out.pgm")),
    Verb("prf export room.geojson --format dxf -o out.dxf", ("room.geojson",), ("out.dxf",)),
    Verb(
        "prf simulate --world room.geojson --path points.csv --sonar -o out.sim",
        ("room.geojson", "points.csv"),
        ("out.sim/",),
    ),
    Verb("prf prior --scale 0.3 --window 0 0 5 5 --draws 2 --seed 1 -o out.geojsonl", (), ("out.geojsonl",)),
    Verb("mapq segment cloud.ply -o out.patches", ("cloud.ply",), ("out.patches",)),
    Verb("mapq label bare.patches --from-field truth", ("bare.patches",)),
    Verb("mapq train walls.patches -o out.json", ("walls.patches",), ("out.json",)),
    Verb(
        "mapq classify walls.patches --model model.json -o out.ply",
        ("walls.patches", "model.json"),
        ("out.ply", "out.json"),
    ),
    Verb("mapq classify cloud.ply -o out.ply --workers 1 --tile-points 10000", ("cloud.ply",), ("out.ply", "out.json")),
    Verb(
        "mapq classify scans --poses odometry.txt -o out.ply",
        ("odometry.txt", "scans/3.ply"),
        ("out.ply", "out.json"),
    ),
    Verb("mapq compare result.ply walls.patches", ("result.ply", "walls.patches")),
    Verb("mapq evaluate result.ply --truth-field truth", ("result.ply",)),
    Verb("mapq features walls.patches --csv", ("walls.patches",)),
    Verb("mapq report result.ply -o out.html", ("result.ply", "result.json"), ("out.html",)),
    Verb("mapq render cloud.ply -o out.png", ("cloud.ply",), ("out.png",)),
    Verb("mapq inspect cloud.ply", ("cloud.ply",)),
    Verb("mapq inspect model.json", ("model.json",)),
    Verb(
        "mapq perturb scans --poses odometry.txt --reference scans/poses.txt -o out.ply",
        ("odometry.txt", "scans/3.ply"),
        ("out.ply", "out.json"),
    ),
    Verb("mapq simulate --size small --n-points 2000 --seed 1 -o out.ply", (), ("out.ply",)),
    Verb("mapq config show mapq.toml", ("mapq.toml",)),
    Verb("prf warm --for points", ()),
    Verb("mapq warm --for classify", ()),
)
ONE_EACH = {verb.name: verb for verb in reversed(VERBS)}
"""Tool and verb to one call of it."""
OUTSIDE = 81.83
"""A laser's mark of no return."""
TEXTS = {
    "laser.log": "".join(
        flaser([2.0, 1.5, 3.0, 2.5, OUTSIDE], (0.1 * n, 0.0, 0.1 * n), time=float(n)) for n in range(4)
    ),
    "sonar.csv": "x,y,theta,range,cone\n" + "".join(f"0.5,0.5,{0.5 * n},{1.0 + 0.1 * n},0.349\n" for n in range(6)),
    "values.csv": "x,y,value\n" + "".join(f"{x},{y},{(x + y) % 2}\n" for x in range(3) for y in range(3)),
    "points.csv": "x,y\n0.5,0.5\n1,1.5\n",
    "room.geojson": json.dumps(
        {
            "type": "Polygon",
            "coordinates": [
                [[-6, -6], [6, -6], [6, 6], [-6, 6], [-6, -6]],
                [[-4, -4], [-4, 4], [4, 4], [4, -4], [-4, -4]],
            ],
        }
    ),
    "set.toml": "[prior]\nscale = 0.2\n[sonar]\nmax_range = 3.0\n",
    "bad.toml": "[sonar]\nnose = 0\n",
    "mapq.toml": "[segment]\nneighbours = 12\n",
}


def make_samples(folder: Path) -> None:
    """Write the inputs of every call of :data:`VERBS` into `folder`."""
    for name, text in TEXTS.items():
        (folder / name).write_text(text)
    write_run(folder / "run", make_run(n_draws=4, window=Window(-2.0, -2.0, 4.0, 2.0)))
    write_run(folder / "room", make_room_run())
    write_grid(folder / "grid.npz", build(BEAM))
    write_draws(folder / "draws.geojsonl", random_draws(1, 2, scale=0.1))
    labelled = draw_patches(1)
    write_ply(str(folder / "cloud.ply"), labelled.cloud)
    write_patches(folder / "walls.patches", labelled)
    write_patches(folder / "bare.patches", draw_patches(1, labelled=False))
    write_model(folder / "model.json", make_model())
    _make_scans(folder)
    done = call("mapq classify walls.patches --model model.json -o result.ply -q", folder)
    assert done.code == 0, done.err


def _make_scans(folder: Path) -> None:
    """Write scans of a long wall with their poses, and odometry that is wrong in its second half."""
    poses = np.array([pose_at(3.0 + 1.5 * scan, -5.0, 5.0 * scan) for scan in range(8)])
    scans = folder / "scans"
    scans.mkdir()
    for number, pose in enumerate(poses):
        seen = look([wall((0.0, 0.0), (18.0, 0.0))], pose, number, 40.0)
        local = (seen - pose[:3, 3]) @ pose[:3, :3]
        write_ply(str(scans / f"{number}.ply"), PointCloud.from_world(local.astype(np.float32)))
    (scans / "poses.txt").write_text(rows(poses[:, :3].reshape(-1, 12)))
    poses[4:, 1, 3] += 0.5
    (folder / "odometry.txt").write_text(rows(poses[:, :3].reshape(-1, 12)))


def content(folder: Path) -> dict[str, bytes]:
    """Return all files and folders below a folder, hidden ones among them."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


def remove_outputs(folder: Path) -> None:
    """Remove what the calls of :data:`VERBS` wrote."""
    for path in folder.glob("out*"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
