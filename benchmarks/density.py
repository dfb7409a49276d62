"""What the density of a log costs: steps per second, memory and held-out score, with thinning and with every beam.

Run it from the repository's root::

    python -m benchmarks.density [--quick] [--sizes 5k 1.7M] [--seconds S] [-o FOLDER]

Scans and beams of freiburg-079 are taken at five densities. Speed is measured in this process, in CPU seconds of one
thread, by turns with a chain on the sparsest log; memory and scores are those of `prf sample` run as anyone runs it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import commands, worlds
from benchmarks.commands import say
from prf.configuration import Configuration
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.model.coloring import Coloring
from prf.model.layout import make_sites, read_coloring
from prf.readings import Readings, read_readings, thin
from prf.sampler.prepare import prepare
from prf.sampler.target import Target, make_chain

LOG = "freiburg-079"
HELD_OUT = "50::100"
SIZES: dict[str, dict[str, Any]] = {
    "5k": {"every_scan": 43, "every_beam": 8},
    "20k": {"every_scan": 21, "every_beam": 4},
    "80k": {"every_scan": 10, "every_beam": 2},
    "320k": {"every_scan": 5},
    "1.7M": {},
}
WAYS: dict[str, float | None] = {"thinned": None, "every beam": 0.0}
"""thinning.beam_density; None: the default."""
SECONDS = 60.0
BURN_IN = 1_500_000
SETTLE = 200_000
"""Steps from the common map on the beams of a case, before its speed is measured."""
ROUNDS = 7
STEPS = 20_000
"""Of a round."""
COLUMNS = ("beam_nll", "nll", "brier", "within_0.2m")


@dataclasses.dataclass(frozen=True)
class Log:
    """The log, and what all cases share."""

    path: Path
    readings: Readings
    window: tuple[float, float, float, float]
    max_range: float

    def target(self, size: str, density: float | None) -> tuple[Target, int]:
        """Return what is sampled from in a case, without its image, and how many beams there were to choose from."""
        chosen = thin(self.readings, skip_scans=HELD_OUT, **SIZES[size])
        flags = {"scale": worlds.SCALE, "window": self.window, "max_range": self.max_range, **commands.LASER}
        config = Configuration.of(**flags, **({} if density is None else {"beam_density": density}))
        prepared = prepare(config, chosen)
        assert prepared.target.laser is not None
        n = prepared.target.laser.readings.n_beams + prepared.n_beams_thinned
        return prepared.target.with_execution(resolution=None), n


def open_log(path: Path) -> Log:
    """Read the log; window and maximum range are those of the whole of it."""
    readings = read_readings(str(path))
    config = prepare(Configuration.of(), readings).config
    assert config.prior.window is not None
    assert config.laser.max_range is not None
    return Log(path, readings, config.prior.window, config.laser.max_range)


def common_map(log: Log, steps: int, seed: int) -> Coloring:
    """Return the map from which every case starts: burnt in on thinned beams, every sensor of the log in white."""
    target, _ = log.target("1.7M", None)
    chain = worlds.start(target)
    sensors = np.unique(log.readings.origin, axis=0)
    chain = chain._replace(sensors=make_sites(chain.edge_index.grid, sensors))
    return read_coloring(worlds.advance(chain, np.random.default_rng(seed), steps).graph)


def settled(target: Target, coloring: Coloring, steps: int, seed: int) -> tuple[Chain, np.random.Generator]:
    """Return a chain of a case at equilibrium, and its generator."""
    rng = np.random.default_rng(seed)
    chain = worlds.advance(make_chain(target, coloring), rng, steps)
    recompute_sums(chain)
    return chain, rng


def speed(
    case: tuple[Chain, np.random.Generator], sparse: tuple[Chain, np.random.Generator], steps: int
) -> dict[str, Any]:
    """Return steps per CPU second of a chain, and how many times slower than on the sparsest log, by turns."""
    seconds: list[list[float]] = [[], []]
    pairs = [case, sparse]
    for _ in range(ROUNDS):
        for i, (chain, rng) in enumerate(pairs):
            spent, moved = worlds.cpu(lambda: worlds.advance(chain, rng, steps))  # noqa: B023
            pairs[i] = (moved, rng)
            seconds[i].append(spent)
    slower = [own / other for own, other in zip(*seconds, strict=True)]
    return {
        "steps_per_second": steps / statistics.median(seconds[0]),
        "slower": statistics.median(slower),
        "slower_range": [min(slower), max(slower)],
        "edges": int(pairs[0][0].graph.counts[c.EDGES]),
    }


def sampled(log: Log, size: str, density: float | None, folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Run `prf sample` in a process of its own; return its peak memory in GB, and what `prf score` makes of it."""
    flags: dict[str, commands.Option] = {
        **commands.LASER_SETTINGS,
        **SIZES[size],
        "laser": log.path,
        "skip_scans": HELD_OUT,
        "scale": worlds.SCALE,
        "seed": options.seed,
        "threads": options.threads,
        "time_budget": options.seconds,
        "output": folder,
        "thinning.beam_density": density,
    }
    words = commands.option_words(flags)
    command = [sys.executable, "-m", "prf", "sample", *words, "--force", "--json", "--no-progress"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=commands.ROOT) as child:
        assert child.stdout is not None
        reported = child.stdout.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != 0:
        raise SystemExit(child.returncode)
    scores = commands.prf("score", folder, laser=log.path, scans=HELD_OUT, seed=options.seed)
    # Linux counts in kB.
    return {"peak_gb": usage.ru_maxrss / 1e6, "sampling": json.loads(reported), "score": scores}


def table(rows: list[dict[str, Any]]) -> str:
    """Return the figures as Markdown."""
    head = ["beams", "way", "used", "steps per CPU second", "slower", "edges", "peak GB", *COLUMNS]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        low, high = row["slower_range"]
        cells = [f"{row['beams']:,}", row["way"], f"{row['used']:,}", f"{row['steps_per_second']:,.0f}"]
        cells += [f"{row['slower']:.2f} ({low:.2f} to {high:.2f})", str(row["edges"])]
        run = row["run"]
        cells += (
            ["–"] * 5 if run is None else [f"{run['peak_gb']:.2f}", *(f"{run['score'][key]:.3f}" for key in COLUMNS)]
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def measure(log: Log, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Run all cases."""
    say(f"burning in a common map: {options.burn_in} steps")
    coloring = common_map(log, options.burn_in, options.seed)
    sparsest, _ = log.target("5k", 0.0)
    sparse = settled(sparsest, coloring, options.settle, options.seed)
    rows = []
    for way, density in WAYS.items():
        for size in options.sizes:
            say(f"{size}, {way}")
            target, n = log.target(size, density)
            assert target.laser is not None
            row: dict[str, Any] = {"size": size, "way": way, "beams": n, "used": target.laser.readings.n_beams}
            row |= speed(settled(target, coloring, options.settle, options.seed), sparse, STEPS)
            folder = options.output / "density" / f"{size}-{way.replace(' ', '-')}"
            row["run"] = sampled(log, size, density, folder, options) if options.seconds > 0.0 else None
            rows.append(row)
            print(table(rows[-1:]), flush=True)
    return rows


def main() -> int:
    """Measure, and write tables."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--sizes", nargs="+", choices=list(SIZES), default=list(SIZES))
    options = commands.parse(asked)
    options.burn_in, options.settle = (BURN_IN // 10, SETTLE // 10) if options.quick else (BURN_IN, SETTLE)
    path = commands.log_path(options.data, LOG)
    if path is None:
        return 0
    rows = measure(open_log(path), options)
    print(table(rows))
    how = {"log": LOG, "held_out": HELD_OUT, "seconds": options.seconds, "laser": commands.LASER, "seed": options.seed}
    commands.write_table(options.output / "density.json", {"schema": "prf.benchmark.density/1", **how, "rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
