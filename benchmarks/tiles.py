"""A large window in tiles: what a round costs, two threads against one on one chain.

Run it from the repository's root::

    python -m benchmarks.tiles [--quick] [--parts shares speed map] [--seconds 600] [-o FOLDER]

On the log of the infinite corridor (232 x 198 m), scans 5, 15, 25 ... held out: see README.md beside this file.
"""

from __future__ import annotations

import argparse
import filecmp
import heapq
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import commands, panels
from benchmarks.commands import made, prf, say
from prf.configuration import Configuration
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.step import run
from prf.model.layout import grow
from prf.output.run import read_run
from prf.sampler.prepare import read_prepared
from prf.sampler.target import Target, make_chain, one_colour_map
from prf.sampler.tiles.rounds import PLAIN_SHARE, make_round, make_tile_data, narrowest, round_length
from prf.sampler.tiles.schedule import finish_round, work_tile

NAME = "infinite-corridor"
SECONDS = 600.0
HELD_OUT = "5::10"
BURN_IN_ROUNDS, ROUNDS = 6, 4
STEPS, QUICK_STEPS = 24_000_000, 3_000_000
PARTS = ("shares", "speed", "map")
WAYS: dict[str, dict[str, int]] = {"tiled": {"chains": 1}, "not tiled": {"chains": 2, "sampler.tiles": 0}}


def cpu(work: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """Return what `work` returns, and the CPU seconds of this thread that it took."""
    start = time.thread_time()
    return work(*arguments), time.thread_time() - start


def span(costs: list[float], threads: int) -> float:
    """Return when the last of several tasks ends, each taken by the first thread that is free, in their order."""
    free = [0.0] * threads
    for cost in costs:
        heapq.heapreplace(free, free[0] + cost)
    return max(free)


def shares(target: Target, n_rounds: int, seed: int) -> dict[str, float]:
    """CPU seconds of the parts of a round, tile by tile, beside as many steps of a chain without tiles."""
    chain, data = make_chain(target, one_colour_map(target)), make_tile_data(target)
    rng = np.random.default_rng(seed)
    length = round_length(target)
    least, steps = narrowest(target.window, target.execution.tiles), length - round(PLAIN_SHARE * length)
    rows = []
    for number in range(BURN_IN_ROUNDS + n_rounds):
        begun, begin = cpu(make_round, data, chain, target.execution.tiles, least, steps, rng)
        worked = [cpu(work_tile, data, begun, k) for k in range(len(begun.tiles))]
        chain, end = cpu(finish_round, data, chain, begun, [result for result, _ in worked])
        chain, plain = cpu(stepped, chain, rng, length - begun.steps * len(begun.tiles))
        costs = [cost for _, cost in worked]
        rows.append([begin, sum(costs), span(costs, 2), end, plain])
        say(f"round {number}: {chain.graph.counts[c.EDGES]} edges, {sum(rows[-1]) - rows[-1][2]:.2f} CPU s")
    begin, tiles, tiles_of_two, end, plain = np.mean(rows[BURN_IN_ROUNDS:], axis=0).tolist()
    chain, untiled = cpu(stepped, chain, rng, length // 8)
    whole = begin + tiles + end + plain
    return {
        "steps of a round": length,
        "tiles": target.execution.tiles,
        "begin, CPU s": begin,
        "tiles, CPU s": tiles,
        "end, CPU s": end,
        "steps on the whole window, CPU s": plain,
        "microseconds a step, tiled": 1e6 * whole / length,
        "microseconds a step, not tiled": 1e6 * untiled / (length // 8),
        "one thread, tiled over not tiled": 8 * untiled / whole,
        "two threads over one, from CPU seconds": whole / (begin + tiles_of_two + end + plain),
    }


def stepped(chain: Any, rng: np.random.Generator, steps: int) -> Any:
    """Run a chain some steps further, as between two rounds."""
    until = int(chain.graph.counts[c.STEP]) + steps
    while not run(chain, rng, until):
        chain = grow(chain)
    recompute_sums(chain)
    return chain


def speed(log: Path, folder: Path, steps: int, seed: int) -> dict[str, float]:
    """Wall seconds of one chain with one thread and with two; the draws must be the same."""
    seconds = {}
    for threads in (1, 2):
        how: dict[str, Any] = {"chains": 1, "steps": steps, "threads": threads, "seed": seed}
        found = made(
            "sample", folder / f"threads{threads}.run", laser=log, skip_scans=HELD_OUT, **commands.LASER_SETTINGS, **how
        )
        seconds[threads] = float(found["seconds"])
    assert_same(folder / "threads1.run", folder / "threads2.run")
    return {"one thread, s": seconds[1], "two threads, s": seconds[2], "speed-up": seconds[1] / seconds[2]}


def assert_same(one: Path, two: Path) -> None:
    """End the benchmark if two runs have not the same draws and image to the last bit."""
    for name in ("draws.npz", "posterior.npz"):
        if not filecmp.cmp(one / name, two / name, shallow=False):
            raise SystemExit(f"{one} and {two}: {name} differs")
    say(f"{one.name} and {two.name} hold the same draws and image")


def mapped(log: Path, folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """A map in a given time on all threads, one chain in tiles, beside chains without tiles; picture and scores."""
    rows: dict[str, Any] = {}
    for name in WAYS:
        target = folder / f"{name.replace(' ', '-')}.run"
        fixed: dict[str, Any] = {"skip_scans": HELD_OUT, "seed": options.seed, "threads": options.threads}
        found = made(
            "sample", target, laser=log, time_budget=options.seconds, **fixed, **WAYS[name], **commands.LASER_SETTINGS
        )
        scores = prf("score", target, laser=log, scans=HELD_OUT, noise=0.05, noise_relative=0.0, seed=options.seed)
        rows[name] = {"steps": found["steps"], "log_posterior": found["log_posterior"], **scores}
        picture = read_run(target)
        assert picture.image is not None
        assert picture.best is not None
        pages = [
            panels.image(picture.image, "posterior"),
            panels.filled(picture.best, f"best draw, {picture.best.n_edges} edges"),
        ]
        words = f"{options.seconds:g} s, held-out beam_nll {scores['beam_nll']:.2f}, auc {scores['auc']:.3f}"
        where = folder / f"{name.replace(' ', '-')}.png"
        panels.save_page(
            where, pages, picture.draws.window, columns=2, height=6.0, title=NAME, subtitle=f"{name}: {words}"
        )
    return rows


def main() -> None:
    """Run the parts that are asked for."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    options = commands.parse(asked)
    log = commands.log_path(options.data, NAME)
    if log is None:
        sys.exit(0)
    folder = options.output / "tiles"
    steps = QUICK_STEPS if options.quick else STEPS
    result: dict[str, Any] = {}
    if "shares" in options.parts:
        config = Configuration.of(skip_scans=HELD_OUT, chains=1, **commands.LASER)
        target = read_prepared([str(log)], config).target
        result["shares"] = shares(target, 1 if options.quick else ROUNDS, options.seed)
    if "speed" in options.parts:
        result["speed"] = speed(log, folder, steps, options.seed)
    if "map" in options.parts:
        result["map"] = mapped(log, folder, options)
    commands.write_table(folder / "tiles.json", result)
    for part, values in result.items():
        print(part, *(f"  {key}: {value}" for key, value in values.items()), sep="\n")


if __name__ == "__main__":
    main()
