"""How well the chains of one log agree after so many seconds, and two runs of it: see README.md beside this file.

Run it from the repository's root::

    python -m benchmarks.agreement [--seconds 90] [--logs office intel aces] [--seeds 1 2]

Of each log but the office, one scan in ten is used. For every seed it prints R-hat and effective samples of the log
likelihood, the worst effective samples of a seen colour that is watched, and on how much of the seen ground chains
agree: cells, drawn at random, whose colour has R-hat below 1.1 over the draws, or is the same in all chains. For the
first two seeds it also prints by how much their images differ on seen cells.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import commands
from benchmarks.commands import made
from prf.model.coloring import black_at_draws
from prf.model.layout import image_grid, pixel_centres
from prf.output.run import Run, read_run
from prf.results.convergence import diagnose

LOGS = ("office", "intel", "aces", "freiburg-101", "csail")
OFFICE = Path(__file__).resolve().parent.parent / "data" / "demo-office.log.gz"
SECONDS = 90.0
CELLS = 2000
"""Seen cells that are asked; each takes a few milliseconds."""
AGREES = 1.1
"""R-hat below which chains agree on a cell."""
FAR = 0.2
"""Difference of two images at a cell that counts as large."""


def agreeing_share(run: Run, seen: NDArray[np.bool_]) -> float:
    """Return the share of seen cells, of `CELLS` at random, on which the chains agree."""
    grid = image_grid(run.draws.window, run.manifest["configuration"]["resolution"])
    cells = np.flatnonzero(seen.ravel())
    chosen = np.random.default_rng(0).choice(cells, min(CELLS, len(cells)), replace=False)
    black = black_at_draws(run.draws, pixel_centres(grid)[chosen])
    n = min(np.bincount(run.chain))
    chains = [black[run.chain == number][-n:] for number in range(run.n_chains)]
    found = diagnose({str(k): np.stack([rows[:, k] for rows in chains]) for k in range(len(chosen))})
    agrees = [each.state == "constant" or (each.state == "varies" and each.rhat < AGREES) for each in found.values()]
    return float(np.mean(agrees))


def row_of(folder: Path) -> dict[str, Any]:
    """Return what one run came to."""
    run = read_run(folder)
    assert run.image is not None
    assert run.diagnostics is not None
    found = run.diagnostics["functionals"]
    likelihood = found["log_likelihood"]
    colours = [
        each["ess"]
        for name, each in found.items()
        if each["seen"] and each["state"] == "varies" and name.startswith("colour")
    ]
    return {
        "steps": int(run.step.max()),
        "converged": run.manifest["status"] == "converged",
        "seconds": run.manifest["seconds"],
        "rhat": likelihood["rhat"],
        "ess": likelihood["ess"],
        "worst_colour_ess": min(colours, default=float("nan")),
        "cells_agree": agreeing_share(run, run.image.seen),
        "log_likelihood": float(np.mean(run.functionals["log_likelihood"])),
    }


def differences(first: Path, second: Path) -> dict[str, float]:
    """Return by how much the images of two runs differ on seen cells: in the mean, and the share of large ones."""
    one, two = (read_run(folder).image for folder in (first, second))
    assert one is not None
    assert two is not None
    apart = np.abs(one.occupancy - two.occupancy)[one.seen]
    return {"image_mean": float(np.nanmean(apart)), "image_far": float(np.nanmean(apart > FAR))}


def shown(value: Any) -> str:
    """Return a value, with four digits if it has a fraction."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def main() -> None:
    """Print a line for every run, and one for every pair of seeds."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--logs", nargs="+", default=list(LOGS), help="the office, or public logs")
    asked.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    asked.add_argument("--until-agreed", action="store_true", help="stop when the chains agree, half an hour at most")
    options = commands.parse(asked)
    budget = None if options.until_agreed else options.seconds
    for name in options.logs:
        log, every = (OFFICE, None) if name == "office" else (commands.log_path(options.data, name), 10)
        if log is None:
            continue
        folders = [options.output / "agreement" / f"{name}-{seed}" for seed in options.seeds]
        for seed, folder in zip(options.seeds, folders, strict=True):
            how: dict[str, Any] = {"laser": log, "every_scan": every, "seed": seed, "threads": options.threads}
            made("sample", folder, time_budget=budget, **how)
            row = {"log": name, "seed": seed, **row_of(folder)}
            print("  ".join(f"{key} {shown(value)}" for key, value in row.items()), flush=True)
        if len(folders) > 1:
            apart = differences(*folders[:2])
            print(
                f"{name}, both seeds: " + "  ".join(f"{key} {shown(value)}" for key, value in apart.items()),
                flush=True,
            )


if __name__ == "__main__":
    main()
