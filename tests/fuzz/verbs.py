"""The verbs of both tools on small inputs: which files each reads and writes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from mapq.io import write_ply
from mapq.io.models import write_model
from prf.coloring import write_geojsonl
from prf.occupancy import write_grid
from prf.run import write_run
from prf.window import Window
from tests.factories import make_run, random_draws
from tests.fuzz.calls import call
from tests.killed.verbs import make_scans
from tests.logs.samples import flaser
from tests.mapq.assess.test_result import make_model
from tests.mapq.labelled import draw_patches
from tests.test_occupancy import BEAM, build

LASER = "".join(flaser([2.0, 1.5, 3.0, 2.5, 81.83], (0.1 * n, 0.0, 0.1 * n), time=float(n)) for n in range(4))
SONAR = "x,y,theta,range,cone\n" + "".join(f"0.5,0.5,{0.5 * n},{1.0 + 0.1 * n},0.349\n" for n in range(6))
VALUES = "x,y,value\n" + "".join(f"{x},{y},{(x + y) % 2}\n" for x in range(3) for y in range(3))
ROOM = (
    '{"type": "Polygon", "coordinates": [[[-6, -6], [6, -6], [6, 6], [-6, 6], [-6, -6]], '
    "[[-4, -4], [-4, 4], [4, 4], [4, -4], [-4, -4]]]}"
)
FEW = ("--chains", "1", "--steps", "20", "--window", "-5", "-5", "5", "5", "--resolution", "1", "--seed", "1")


class Verb(NamedTuple):
    """A call of a verb in a folder of samples.

    Attributes
    ----------
    call : str
        Tool, verb and arguments; the names of files are those that :func:`make_samples` writes.
    reads : tuple of str
        Files among the arguments, each of which can be damaged.
    writes : tuple of str
        Files that a whole result has; a folder ends in "/".
    """

    call: str
    reads: tuple[str, ...]
    writes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Tool, verb and what tells it from other calls of the verb."""
        return " ".join(self.call.split()[:2]) + (f" {self.reads[0]}" if self.reads else "")

    def output(self) -> str:
        """Return the argument of -o."""
        words = self.call.split()
        return words[words.index("-o") + 1]


FEW_STEPS = " ".join(FEW)
VERBS = (
    Verb(f"prf sample --laser laser.log -o out.run {FEW_STEPS}", ("laser.log",), ("out.run/",)),
    Verb(
        f"prf sample --sonar sonar.csv --config set.toml -o out.run {FEW_STEPS}",
        ("sonar.csv", "set.toml"),
        ("out.run/",),
    ),
    Verb(f"prf sample --point-data values.csv -o out.run {FEW_STEPS}", ("values.csv",), ("out.run/",)),
    Verb(
        "prf anneal --laser laser.log -o out.geojson --chains 1 --steps 20 --window -5 -5 5 5 --seed 1",
        ("laser.log",),
        ("out.geojson",),
    ),
    Verb("prf grid --laser laser.log --sonar sonar.csv -o out.npz", ("laser.log", "sonar.csv"), ("out.npz",)),
    Verb("prf info laser.log", ("laser.log",)),
    Verb("prf info --point-data values.csv", ("values.csv",)),
    Verb("prf query grid.npz --points points.csv", ("grid.npz", "points.csv")),
    Verb("prf query run --path points.csv --radius 0.2", ("points.csv", "run")),
    Verb("prf inspect run", ("run",)),
    Verb("prf inspect room.geojson", ("room.geojson",)),
    Verb("prf inspect draws.geojsonl", ("draws.geojsonl",)),
    Verb("prf config check set.toml", ("set.toml",)),
    Verb("prf config show set.toml", ("set.toml",)),
    Verb("prf score room.geojson --laser laser.log", ("room.geojson", "laser.log")),
    Verb("prf score run --laser laser.log --truth room.geojson", ("run", "laser.log", "room.geojson")),
    Verb(
        "prf calibrate --map room.geojson --laser laser.log -o out.toml", ("room.geojson", "laser.log"), ("out.toml",)
    ),
    Verb("prf render draws.geojsonl -o out.png", ("draws.geojsonl",), ("out.png",)),
    Verb("prf render run -o out.svg", ("run",), ("out.svg",)),
    Verb("prf render grid.npz -o out.pdf", ("grid.npz",), ("out.pdf",)),
    Verb("prf export run --format ros-map -o out.yaml", ("run",), ("out.yaml", "out.pgm")),
    Verb("prf export room.geojson --format svg -o out.svg", ("room.geojson",), ("out.svg",)),
    Verb("prf export room.geojson --format dxf -o out.dxf", ("room.geojson",), ("out.dxf",)),
    Verb("prf export run --format netcdf -o out.nc", ("run",), ("out.nc",)),
    Verb("prf export run --format geojson -o out.geojson", ("run",), ("out.geojson",)),
    Verb(
        "prf simulate --world room.geojson --path points.csv --sonar -o out.sim",
        ("room.geojson", "points.csv"),
        ("out.sim/",),
    ),
    Verb("prf prior --scale 0.3 --window 0 0 5 5 --draws 2 --seed 1 -o out.geojsonl", (), ("out.geojsonl",)),
    Verb("mapq segment cloud.ply -o out.patches", ("cloud.ply",), ("out.patches",)),
    Verb("mapq label bare.patches --from-field truth", ("bare.patches",)),
    Verb("mapq label --agreement walls.patches walls.patches", ("walls.patches",)),
    Verb("mapq train walls.patches -o out.json", ("walls.patches",), ("out.json",)),
    Verb(
        "mapq classify walls.patches --model model.json -o out.ply",
        ("walls.patches", "model.json"),
        ("out.ply", "out.json"),
    ),
    Verb("mapq classify cloud.ply -o out.laz", ("cloud.ply",), ("out.laz", "out.json")),
    Verb("mapq classify cloud.ply -o out.ply --workers 1 --tile-points 10000", ("cloud.ply",), ("out.ply", "out.json")),
    Verb("mapq compare result.ply walls.patches", ("result.ply", "walls.patches")),
    Verb("mapq evaluate result.ply --truth-field truth", ("result.ply",)),
    Verb("mapq features walls.patches --csv", ("walls.patches",)),
    Verb("mapq report result.ply -o out.html", ("result.ply", "result.json"), ("out.html",)),
    Verb("mapq render cloud.ply -o out.png", ("cloud.ply",), ("out.png",)),
    Verb("mapq inspect cloud.ply", ("cloud.ply",)),
    Verb("mapq inspect model.json", ("model.json",)),
    Verb(
        "mapq perturb scans --poses odometry.txt --reference scans/poses.txt -o out.ply",
        ("odometry.txt", "scans"),
        ("out.ply", "out.json"),
    ),
    Verb("mapq simulate --size small --n-points 2000 --seed 1 -o out.ply", (), ("out.ply",)),
    Verb(
        "mapq simulate --size city --n-points 250000 --tile-points 1 --seed 1 -o out.city",
        (),
        ("out.city/",),
    ),
)


QUICK = ("prf grid", "prf info laser", "prf export room", "mapq inspect cloud", "mapq label bare")
"""Beginnings of the names of calls that are tried in every test; the others are, in the slow ones."""


def marked(cases: Iterable[Any]) -> list[Any]:
    """Return calls, or tuples that begin with a call, as parameters of a test, all but the quick ones marked slow."""
    found = []
    for case in cases:
        verb, *others = case if not isinstance(case, Verb) else (case,)
        name = ": ".join([verb.name, *others])
        marks = () if name.startswith(QUICK) else pytest.mark.slow
        found.append(pytest.param(verb, *others, id=name, marks=marks))
    return found


def make_samples(folder: Path) -> None:
    """Write whole inputs of every verb into `folder`."""
    texts = {
        "laser.log": LASER,
        "sonar.csv": SONAR,
        "values.csv": VALUES,
        "points.csv": "x,y\n0.5,0.5\n1,1.5\n",
        "room.geojson": ROOM,
        "set.toml": "[prior]\nscale = 0.2\n[sonar]\nmax_range = 3.0\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    write_run(folder / "run", make_run(n_draws=4, window=Window(-2.0, -2.0, 4.0, 2.0)))
    write_grid(folder / "grid.npz", build(BEAM))
    write_geojsonl(folder / "draws.geojsonl", random_draws(1, 2, scale=0.1))
    labelled = draw_patches(1)
    write_ply(str(folder / "cloud.ply"), labelled.cloud)
    from mapq.io import write_patches

    write_patches(folder / "walls.patches", labelled)
    write_patches(folder / "bare.patches", draw_patches(1, labelled=False))
    write_model(folder / "model.json", make_model())
    make_scans(folder)
    said = call("mapq classify walls.patches --model model.json -o result.ply", folder)
    assert said.code == 0, said.err


def standing(folder: Path) -> dict[str, int]:
    """Return all files below `folder` with their times of change, hidden ones among them."""
    return {str(path.relative_to(folder)): path.lstat().st_mtime_ns for path in _below(folder)}


def _below(folder: Path) -> Iterator[Path]:
    for place, _, names in os.walk(folder):
        yield Path(place)
        yield from (Path(place) / name for name in names)
