"""What the experiments on logs share: `prf` run as anyone runs it, their options, and where the public logs are."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from prf.output.run import read_run
from prf.results import names
from prf.results.convergence import diagnose
from prf.shell.cli.storage import jsonable

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data" / "prf"
OUTPUT = ROOT / "build" / "benchmarks"
QUICK_SECONDS = 30.0
SEED = 1

LASER = {"noise": 0.05, "noise_relative": 0.02}
"""Of corrected logs: their poses are wrong by centimetres and tenths of a degree, and the scanner's noise is less."""
LASER_SETTINGS = {"laser.noise": 0.05, "laser.noise_relative": 0.02}
"""The same for verbs that have no flags for it."""

WHOLE_WINDOW = ("n_edges", "total_length", "log_prior")
"""Functionals of a run in which ground that no reading saw has its share."""

Option = str | int | float | Path | list[float] | None
"""Value of an option; a list is an option with several values, None leaves the option out."""


def prf(verb: str, *words: str | Path, **options: Option) -> dict[str, Any]:
    """Run `prf VERB` with operands and flags (`words`) and options; return what it prints with --json.

    Its messages go to standard error; a failure ends the benchmark.
    """
    command = [sys.executable, "-m", "prf", verb, *map(str, words), *option_words(options), "--json", "--no-progress"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, cwd=ROOT, check=False)
    if done.returncode != 0:
        raise SystemExit(done.returncode)
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def option_words(options: Mapping[str, Option]) -> list[str]:
    """Return options as words: `every_scan` is --every-scan, and a name with a dot a setting (--set)."""
    words = []
    for name, value in options.items():
        if value is not None and "." in name:
            words += ["--set", f"{name}={value}"]
        elif value is not None:
            words += ["--" + name.replace("_", "-"), *map(str, value if isinstance(value, list) else [value])]
    return words


def made(verb: str, output: Path, **options: Option) -> dict[str, Any]:
    """Run a verb that writes `output`, over what is there."""
    output.parent.mkdir(parents=True, exist_ok=True)
    return prf(verb, "--force", output=output, **options)


def worst_rhat(folder: Path) -> float:
    """Return the largest R-hat of a run: log posterior, log likelihood, and the colour at probes that were seen."""
    run = read_run(folder, parts=(names.POSTERIOR,))
    assert run.image is not None
    seen = run.image.seen_at(run.probe_xy)
    columns = [values for name, values in run.functionals.items() if name not in WHOLE_WINDOW]
    columns += list(run.probe_black[:, seen].T.astype(np.float64))
    chains = [np.flatnonzero(run.chain == chain) for chain in np.unique(run.chain)]
    n_draws = min(map(len, chains), default=0)
    rows = np.array([chain[:n_draws] for chain in chains])
    found = diagnose({str(k): values[rows] for k, values in enumerate(columns)})
    return max((one.rhat for one in found.values() if one.state != "constant"), default=float("nan"))


def parser(doc: str | None, seconds: float | None = None) -> argparse.ArgumentParser:
    """Return a parser with the options of every experiment; `seconds`, if any, is the time of one run unless given."""
    found = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    found.add_argument("--quick", action="store_true", help="short runs, to see that all works")
    if seconds is not None:
        found.add_argument("--seconds", type=float, default=seconds, help="of sampling and of annealing, each run")
    found.add_argument("--threads", type=int, default=0, help="0: one a core")
    found.add_argument("--seed", type=int, default=SEED)
    found.add_argument("--data", type=Path, default=DATA, help="folder with the public logs, in carmen/")
    found.add_argument("-o", "--output", type=Path, default=OUTPUT, help="where pictures and tables go")
    return found


def parse(asked: argparse.ArgumentParser) -> argparse.Namespace:
    """Return the options, the time of a run cut short by --quick."""
    arguments = asked.parse_args()
    if arguments.quick and "seconds" in arguments:
        arguments.seconds = min(arguments.seconds, QUICK_SECONDS)
    arguments.output = arguments.output.resolve()
    return arguments


def log_path(data: Path, name: str) -> Path | None:
    """Return the corrected log of a building; None, with a line that says so, where it is absent."""
    path = data.resolve() / "carmen" / f"{name}-corrected.log.gz"
    if path.exists():
        return path
    say(f"{path}: not here, {name} is skipped")
    return None


def write_table(path: Path, result: Mapping[str, Any]) -> None:
    """Write a table as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(jsonable(result), indent=1) + "\n")
    say(f"{path}")


def say(words: str) -> None:
    """Print progress on standard error."""
    print(words, file=sys.stderr, flush=True)
