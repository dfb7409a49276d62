"""Steps per second of the sampler and what they are made of, in one run: see README.md beside this file.

Run it from the repository's root::

    python -m benchmarks.step_rate [--json FILE] [--seed N]

A table goes to stdout, then the same figures as one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import measure, report, worlds

BURN_IN = 1_500_000
STEPS = 1_000_000
LARGE_BURN_IN = 3_000_000
LARGE_STEPS = 2_000_000
SNAPSHOTS = 12


def machine() -> dict[str, str]:
    """Return what the figures depend on besides the code."""
    cpu = platform.processor()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = lines[0].partition(":")[2].strip() if lines else cpu
    return {"cpu": cpu, "python": platform.python_version(), "numba": version("numba"), "numpy": version("numpy")}


def large_map(seed: int) -> tuple[str, Any, np.random.Generator]:
    """Return a chain on a map of more than 500 edges: a real building's posterior, or the prior where it is absent."""
    if worlds.BUILDING.exists():
        chain, rng = measure.burnt_in(worlds.target_of(worlds.BUILDING, every_scan=10), LARGE_BURN_IN, seed)
        return f"{worlds.BUILDING.name}, every 10th scan", chain, rng
    target, coloring = worlds.prior_settings()
    source = "the prior alone (no log of a large building here)"
    return source, worlds.start(target, coloring), np.random.default_rng(seed)


def measure_all(seed: int) -> dict[str, Any]:
    """Run everything."""
    target = worlds.target_of(worlds.OFFICE)
    assert target.laser is not None
    say(f"burning in: {BURN_IN} steps")
    chain, rng = measure.burnt_in(target, BURN_IN, seed)
    say("speed after burn-in")
    result: dict[str, Any] = {
        "schema": "prf.benchmark.step_rate/1",
        "machine": machine(),
        "seed": seed,
        "scale": target.scale,
        "window": list(target.window),
        "cell": target.cell_size(),
        "n_beams": target.laser.readings.n_beams,
        "burn_in": BURN_IN,
        "equilibrium": measure.equilibrium(chain, rng, STEPS),
    }
    starts = worlds.snapshots(chain, rng, SNAPSHOTS, BURN_IN // SNAPSHOTS // 2)
    result["share_touching"] = measure.share_touching(starts, 20_000)
    say("races against the twins")
    result["agreement"] = measure.agreement(worlds.copy(starts[0]), 400)
    result["twins"] = measure.twins(starts)
    say("stages")
    result["stages"] = measure.stages(starts, 20_000)
    say("image and draws")
    image = worlds.target_of(worlds.OFFICE, image=True)
    result["with_recording"] = measure.with_recording(worlds.copy(starts[-1]), image, 60)
    say("moves on a large map")
    source, large, large_rng = large_map(seed)
    result["rivals"] = {"source": source, **measure.rival_moves(large, large_rng, LARGE_STEPS)}
    return result


def say(words: str) -> None:
    """Tell what is going on."""
    print(words, file=sys.stderr, flush=True)


def main() -> int:
    """Measure, print, and fail where a twin did not do the same."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="write the JSON to this file as well")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    result = measure_all(arguments.seed)
    text = json.dumps(result)
    print(report.table(result))
    print()
    print(text)
    if arguments.json is not None:
        arguments.json.write_text(text + "\n")
    alike = all(result["twins"]["same_decisions"].values()) and result["agreement"]["same_touched_beams"]
    if not alike or result["agreement"]["largest_difference"] > 1e-9:
        print("error: a twin decided otherwise than the sampler: the ratios compare different things", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
