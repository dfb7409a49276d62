"""``python -m tests.packaging build``: wheel and source archive of the last commit in dist/; the wheel alone is called.

``python -m tests.packaging jobs``: install the wheel, nothing else, and run the main jobs of both tools with it, once
with the newest versions of the dependencies, once with the oldest that pyproject.toml allows. Then what the Dockerfile
of docs/examples runs, in a virtual environment.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.conftest import ROOT
from tests.packaging.container import fault_of_container
from tests.packaging.test_packaging import MINIMUM, build

LOG = "demo-office.log.gz"
TOWN = "demo-town.ply.gz"
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
    "prf export run --format dxf -o run.dxf",
    f"prf anneal --laser {LOG} --every-scan 10 --every-beam 12 --steps 2000 --chains 1 --seed 1 -o best.geojson",
    f"prf grid --laser {LOG} --every-scan 10 -o grid.npz",
    f"mapq segment {TOWN} -o town.patches",
    "mapq features town.patches --csv",
    "mapq label town.patches --from-field truth",
    "mapq classify town.patches -o town.ply",
    "mapq classify town.patches -o own.laz",
    "mapq evaluate town.ply --truth-field truth",
    "mapq render town.ply -o town.png",
    "mapq report town.ply -o town.html",
)
"""Reading, sampling, segmenting, classifying and pictures: what the core must do without any extra."""


CALLS = (
    "prf --version",
    "prf --help",
    "mapq --help",
    f"mapq inspect {TOWN}",
    "mapq inspect empty.laz",
)
"""What is called of a wheel that was just built; the last one needs a reader of the core, and is refused."""
DIST = ROOT / "dist"


class Missing(NamedTuple):
    """A command that needs an extra, and the extra."""

    command: str
    extra: str


NO_EXTRA = 2
"""Exit code of whatever needs an extra that is not installed."""
MISSING = (
    Missing("prf export run --format netcdf -o run.nc", "netcdf"),
    Missing(f"mapq classify {TOWN} --scheduler tcp://127.0.0.1:9 -o far.ply", "distributed"),
    Missing("mapq inspect empty.e57", "e57"),
    Missing("mapq train town.patches -o model.json", "train"),
)


class Environment(NamedTuple):
    """A virtual environment in `folder`, which also holds ``home`` and ``work``, far from this tree."""

    folder: Path

    def run(self, command: str) -> subprocess.CompletedProcess[str]:
        """Run a command line with the programs of the environment."""
        environment = {
            "PATH": os.pathsep.join([str(self.folder / "venv" / "bin"), "/usr/bin", "/bin"]),
            "HOME": str(self.folder / "home"),
            "LANG": os.environ.get("LANG", "C.UTF-8"),
        }
        program, *arguments = command.split()
        path = shutil.which(program, path=environment["PATH"])
        assert path is not None, f"{program} is not installed"
        work = self.folder / "work"
        return subprocess.run(
            [path, *arguments], cwd=work, env=environment, capture_output=True, text=True, check=False
        )

    def fault_of(self, command: str) -> str | None:
        """Return why a job of the core failed, None if it did not."""
        done = self.run(command)
        return None if done.returncode == 0 else f"exit code {done.returncode}: {done.stderr.strip()}"

    def fault_of_missing(self, case: Missing) -> str | None:
        """Return what is wrong with the answer to a command whose extra is missing."""
        done = self.run(case.command)
        lines = done.stderr.splitlines()
        errors = [line for line in lines if line.startswith("error: ")]
        if (
            done.returncode == NO_EXTRA
            and errors == lines[-1:]
            and f"pip install '.[{case.extra}]'; elsewhere: " in lines[-1]
        ):
            return None
        return f"exit code {done.returncode}, not one error that names the extra {case.extra}: {done.stderr.strip()}"


def install(folder: Path, python: str, wheel: Path, constraints: Path | None) -> Environment:
    """Make an environment with the wheel and what it needs, and small data to work on."""
    folder.mkdir()
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    limits = [] if constraints is None else ["-c", str(constraints)]
    pip = [folder / "venv" / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "--no-input"]
    subprocess.run([*pip, "install", "--quiet", "--only-binary", ":all:", *limits, str(wheel)], check=True)
    subprocess.run([*pip, "check"], check=True)
    for name in ("home", "work"):
        (folder / name).mkdir()
    for name in (LOG, TOWN):
        shutil.copy(ROOT / "data" / name, folder / "work")
    (folder / "work" / "points.csv").write_text("x,y\n5.0,7.0\n6.0,7.0\n")
    (folder / "work" / "empty.e57").write_bytes(b"ASTM-E57" + bytes(40))
    (folder / "work" / "empty.laz").write_bytes(b"LASF" + bytes(400))
    return Environment(folder)


def build_release(python: str) -> int:
    """Build the last commit into dist/, install the wheel in an empty environment, and call it; 1 if that fails."""
    shutil.rmtree(DIST, ignore_errors=True)
    with tempfile.TemporaryDirectory() as name:
        source = Path(name) / "source"
        source.mkdir()
        archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True)
        subprocess.run(["tar", "-x", "-C", source], input=archive.stdout, check=True)
        built = [build(target, DIST, source) for target in ("wheel", "sdist")]
        environment = install(Path(name) / "new", python, built[0], None)
        faults = [(command, environment.fault_of(command)) for command in CALLS[:-1]]
        refused = environment.run(CALLS[-1])
        is_read = refused.returncode == 3 and "damaged" in refused.stderr
        faults.append((CALLS[-1], None if is_read else f"not read as LAZ: {refused.stderr.strip()}"))
    for command, fault in faults:
        print(f"wheel alone: {fault or 'as it should be'}: {command}", flush=True)
    print("".join(f"built {path.relative_to(ROOT)}, {path.stat().st_size:,} B\n" for path in built), end="")
    return int(any(fault for _, fault in faults))


def main() -> int:
    """Print a line a command; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("build", "jobs"))
    parser.add_argument("--python", default=sys.executable, help="interpreter of the environments")
    asked, n_faults = parser.parse_args(), 0
    if asked.what == "build":
        return build_release(asked.python)
    with tempfile.TemporaryDirectory() as name:
        wheel = build("wheel", Path(name) / "dist")
        for versions, constraints in (("newest", None), ("oldest", MINIMUM)):
            environment = install(Path(name) / versions, asked.python, wheel, constraints)
            outcomes = [(command, environment.fault_of(command)) for command in JOBS]
            outcomes += [(case.command, environment.fault_of_missing(case)) for case in MISSING]
            for command, fault in outcomes:
                print(f"{versions}: {fault or 'as it should be'}: {command}", flush=True)
                n_faults += fault is not None
        fault = fault_of_container(Path(name) / "container", asked.python)
        print(f"container: {fault or 'as it should be'}: RUN lines of the Dockerfile, without a network", flush=True)
    return int(n_faults > 0 or fault is not None)


if __name__ == "__main__":
    sys.exit(main())
