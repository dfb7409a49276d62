"""An environment with the wheel alone, and the main jobs of both tools in it as a user's shell would run them."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from tests.packaging.archives import ROOT

LOG = "demo-office.log.gz"
TOWN = "demo-town.ply.gz"
LONGEST = 1800.0
"""Seconds that a command may take, its kernels compiled on the way, before it counts as hung."""
JOBS = (
    "prf --version",
    f"prf info {LOG}",
    f"prf sample --laser {LOG} --every-scan 10 --every-beam 12 --chains 2 --steps 2000 --resolution 1 --seed 1 -o run",
    "prf query run --points points.csv",
    "prf render run -o run.png",
    "prf inspect run",
    f"prf score run --laser {LOG} --every-scan 10 --seed 1",
    "prf export run --format geojson -o run.geojson",
    "prf export run --format svg -o run.svg",
    f"prf anneal --laser {LOG} --every-scan 10 --every-beam 12 --steps 2000 --chains 1 --seed 1 -o best.geojson",
    f"prf grid --laser {LOG} --every-scan 10 -o grid.npz",
    f"mapq segment {TOWN} -o town.patches",
    "mapq features town.patches --csv",
    "mapq label town.patches --from-field truth",
    "mapq train town.patches -o model.json",
    "mapq classify town.patches -o town.ply",
    "mapq classify town.patches --model model.json -o own.laz",
    "mapq evaluate town.ply --truth-field truth",
    "mapq render town.ply -o town.png",
    "mapq inspect model.json",
)
"""Reading, sampling, segmenting, classifying, training and pictures: what the core must do without any extra."""


class Missing(NamedTuple):
    """A command that needs an extra: its exit code without it, and the extra."""

    command: str
    code: int
    extra: str


MISSING = (
    Missing("prf export run --format dxf -o run.dxf", 2, "dxf"),
    Missing("prf export run --format netcdf -o run.nc", 2, "netcdf"),
    Missing(f"prf sample --laser {LOG} --steps 10 --scheduler tcp://127.0.0.1:9 -o far", 2, "distributed"),
    Missing("mapq report town.ply -o town.html", 2, "report"),
    Missing("mapq label town.patches", 2, "report"),
    Missing(f"mapq classify {TOWN} --scheduler tcp://127.0.0.1:9 -o far.ply", 2, "distributed"),
    Missing("mapq inspect empty.e57", 3, "e57"),
)


class Bare(NamedTuple):
    """An environment, and a folder to work in that is far from this tree.

    Attributes
    ----------
    folder : Path
        Holds ``venv``, ``home`` and ``work``.
    """

    folder: Path

    def run(self, command: str) -> subprocess.CompletedProcess[str]:
        """Run a command line with the environment's programs and nothing of this process's but its language."""
        environment = {
            "PATH": os.pathsep.join([str(self.folder / "venv" / "bin"), "/usr/bin", "/bin"]),
            "HOME": str(self.folder / "home"),
            "LANG": os.environ.get("LANG", "C.UTF-8"),
        }
        program, *arguments = command.split()
        path = shutil.which(program, path=environment["PATH"])
        assert path is not None, f"{program} is not installed"
        return subprocess.run(
            [path, *arguments],
            cwd=self.folder / "work",
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=LONGEST,
        )


def make_bare(folder: Path, python: str, wheel: Path, constraints: Path | None) -> Bare:
    """Make an environment of `python` in `folder` that holds the wheel and what it needs, and small data to work on.

    Raises
    ------
    subprocess.CalledProcessError
        If the versions that `constraints` allows cannot be installed.
    """
    venv = folder / "venv"
    subprocess.run([python, "-m", "venv", venv], check=True)
    limits = [] if constraints is None else ["-c", str(constraints)]
    pip = [venv / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "--no-input"]
    subprocess.run([*pip, "install", "--quiet", "--only-binary", ":all:", *limits, str(wheel)], check=True)
    subprocess.run([*pip, "check"], check=True)
    (folder / "home").mkdir()
    work = folder / "work"
    work.mkdir()
    for name in (LOG, TOWN):
        shutil.copy(ROOT / "data" / name, work)
    (work / "points.csv").write_text("x,y\n5.0,7.0\n6.0,7.0\n")
    (work / "empty.e57").write_bytes(b"ASTM-E57" + bytes(40))
    return Bare(folder)


def fault_of_job(bare: Bare, command: str) -> str | None:
    """Return why a job of the core failed, None if it did not."""
    done = bare.run(command)
    return None if done.returncode == 0 else f"exit code {done.returncode}: {done.stderr.strip()}"


def fault_of_missing(bare: Bare, case: Missing) -> str | None:
    """Return what is wrong with the answer to a command whose extra is not there: one error that names it."""
    done = bare.run(case.command)
    lines = done.stderr.splitlines()
    if done.returncode != case.code:
        return f"exit code {done.returncode} instead of {case.code}: {done.stderr.strip()}"
    errors = [line for line in lines if line.startswith("error: ")]
    if errors != lines[-1:] or f"prf-mapq[{case.extra}]" not in lines[-1]:
        return f"not one error that names the extra {case.extra}: {done.stderr.strip()}"
    return None
