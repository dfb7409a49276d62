"""Compile the kernels ahead: for container images, CI, and machines that must answer at once."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from prf.shell.cli.options import Json

EXAMPLES = ("prf warm", "prf warm --for laser --for maps", "PRF_CACHE_DIR=/opt/prf prf warm -q")

FILES = {
    "laser.csv": "scan,x,y,theta,range\n"
    + "".join(f"{scan},{5 + scan},7,{0.1 * k:.1f},{2 + k % 3}\n" for scan in range(3) for k in range(60)),
    "drive.log": "".join(
        f"FLASER 60 {' '.join(f'{2 / max(abs(math.cos(0.05 * k)), abs(math.sin(0.05 * k))):.3f}' for k in range(60))}"
        f" {5 + 0.1 * scan:.1f} 7 0 {5 + 0.1 * scan:.1f} 7 0 {scan} host {scan}\n"
        for scan in range(3)
    ),
    "sonar.csv": "x,y,theta,range,cone\n5.0,7.0,0.0,2.0,0.349\n",
    "values.csv": "x,y,value\n5.0,7.0,0\n6.0,7.0,1\n5.0,8.0,1\n6.0,8.0,0\n",
    "points.csv": "x,y\n5.0,7.0\n6.0,7.0\n",
}
FEW = "--steps 2000 --chains 2 --resolution 1 --seed 1"
COMMANDS = {
    "laser": (
        f"sample --laser laser.csv {FEW} --set thinning.beam_density=1 -o run",
        f"sample --extend run --laser laser.csv {FEW} -o longer",
    ),
    "sonar": (f"sample --sonar sonar.csv --window 3 5 8 9 {FEW} -o echoes",),
    "poses": (
        f"sample --laser laser.csv --pose-noise 0.05 0.01 {FEW} -o drive",
        f"sample --extend drive --laser laser.csv {FEW} -o farther",
        f"sample --laser drive.log --odometry wheels {FEW} -o loop",
    ),
    "walls": (f"sample --laser laser.csv --prior walls {FEW} -o walls",),
    "points": (f"sample --point-data values.csv {FEW} -o points",),
    "prior": (
        "prior --scale 1 --window 0 0 1 1 --draws 3 --method exact --seed 1 -o exact.geojsonl",
        "prior --scale 1 --window 0 0 1 1 --draws 3 --method mcmc --thin 50 --seed 1 -o mcmc.geojsonl",
    ),
    "maps": (
        f"sample --point-data values.csv {FEW} -o run",
        "query run --points points.csv --square 0.5",
        "query run --points points.csv",
        "query run --path points.csv --radius 0.2",
        "export run --format ros-map --resolution 1 -o ros",
        "grid --laser laser.csv -o grid.npz",
        "grid --laser laser.csv --set grid.method=log-odds -o log-odds.npz",
        "score run --laser laser.csv --seed 1",
        "score grid.npz --laser laser.csv --seed 1",
        "score run --sonar sonar.csv",
        "score grid.npz --sonar sonar.csv",
    ),
}
"""Kind of job to calls of `prf` that between them call every kernel it needs: those that extend a run, of regions."""


def warm(
    context: typer.Context,
    jobs: Annotated[
        list[str] | None,
        typer.Option("--for", metavar="JOB", help=f"{', '.join(COMMANDS)}; repeat for several.  [all]"),
    ] = None,
    json: Json = False,
) -> None:
    """Compile the kernels ahead: for container images, CI, and machines that must answer at once.

    Otherwise the first call of a verb compiles what it needs. laser, sonar and points are for sample and anneal, and
    share most; poses is for uncertain ones, walls for --prior walls; maps is query, score, grid and export. Kernels are
    kept for this version, this Python and this kind of processor in $PRF_CACHE_DIR, or else in ~/.cache/prf/kernels,
    where whoever runs prf must be able to write. A second call has nothing to do.
    """
    from prf.kernels._jit import CACHE
    from prf.sampler.tiles.schedule import small_round
    from prf.shell.jit.warming import Job, report
    from prf.shell.jit.warming import warm as run

    calls = {name: Job(lines, small_round if name == "laser" else lambda: None) for name, lines in COMMANDS.items()}
    report("prf", run(context.find_root().command, "prf", CACHE, calls, FILES, jobs or []), json)
