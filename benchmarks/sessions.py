"""One log in five sessions: gone on from four times, with and without forgetting, beside one run on everything.

Run it from the repository's root::

    python -m benchmarks.sessions [--quick] [--seconds S] [--threads 1] [--logs intel aces freiburg-101] [-o FOLDER]

Each session takes `--seconds`, the one run five times as long. Scans 5, 15, 25 ... are held out. Columns: beams kept,
nats by which forgetting changes the log likelihood, steps a second, memory; then scores, and on how many of 200 places
(100 anywhere that was seen, 100 within 0.1 m of a wall) the intervals of a run overlap with those of the one. With
`--logs drive` a simulated office is driven through eight times, with forgetting: what is kept must not grow.
"""

from __future__ import annotations

import gzip
import json
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from benchmarks import commands
from benchmarks.commands import log_path, made, prf, say
from prf.output.run import Run, read_run

SESSIONS = 5
HELD_OUT = "5::10"
CHAINS = 2
PLACES = 100
MAX_RANGE = {"intel": 40.0}
DRIVE, DRIVES, WORLD_SEED = "drive", 8, 3


def n_scans(log: Path) -> int:
    """Return how many laser scans a CARMEN log has."""
    with gzip.open(log, "rt", encoding="latin-1") as lines:
        return sum(line.startswith("FLASER") for line in lines)


def sampled(log: Path, output: Path, scans: str, seconds: float, seed: int, *words: str) -> dict[str, Any]:
    """Sample one run in a process of its own, over what is there; return what its files report."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    command = [sys.executable, "-m", "prf", "sample", "--laser", str(log), "--scans", scans, "--skip-scans", HELD_OUT]
    command += ["--time-budget", str(seconds), "--seed", str(seed), "--threads", "1", "--chains", str(CHAINS)]
    subprocess.run([*command, "-o", str(output), "--force", "--quiet", "--no-progress", *words], check=True)
    manifest, diagnosed = (json.loads((output / name).read_text()) for name in ("manifest.json", "diagnostics.json"))
    return {
        "beams": manifest["n_beams"],
        "nats": manifest.get("forgotten", {}).get("nats", 0.0),
        "steps_per_second": diagnosed["steps_per_second"],
        "memory_gb": max(before, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) / 1e6,
    }


def chain_of_sessions(log: Path, folder: Path, seconds: float, seed: int, forget: bool, first: list[str]) -> list[Any]:
    """Sample a log session by session; return a row each."""
    n, rows = n_scans(log), []
    for k in range(SESSIONS):
        words = first if k == 0 else ["--extend", str(folder / str(k - 1)), *(["--forget"] if forget else [])]
        scans = f"{n * k // SESSIONS}:{n * (k + 1) // SESSIONS}"
        rows.append(sampled(log, folder / str(k), scans, seconds, seed + k, *words))
        say(f"{folder.name}, session {k + 1}: {rows[-1]}")
    return rows


def endless(folder: Path, seconds: float, seed: int) -> list[dict[str, Any]]:
    """Drive through one simulated office again and again, each time gone on from and forgotten; return a row each."""
    made("simulate", folder / "world", size=[16, 12], seed=WORLD_SEED)
    rows = []
    for k in range(DRIVES):
        made("simulate", folder / f"drive-{k}", world=folder / "world" / "truth.geojson", seed=WORLD_SEED + 1 + k)
        words = [] if k == 0 else ["--extend", str(folder / str(k - 1)), "--forget"]
        log = folder / f"drive-{k}" / "laser.log.gz"
        rows.append(sampled(log, folder / str(k), ":", seconds, seed + k, *words))
        say(f"drive {k + 1}: {rows[-1]}")
    return rows


def places(one: Run, seed: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return places (200, 2) in metres: seen ones, and such near a wall of the best map."""
    rng, window = np.random.default_rng(seed), one.draws.window
    xy = rng.uniform(window[:2], window[2:], (50_000, 2))
    assert one.image is not None
    xy = xy[one.image.seen_at(xy)]
    near = shapely.dwithin(one.best_map.boundary, shapely.points(xy), 0.1)
    return np.concatenate([xy[:PLACES], xy[near][:PLACES]])


def overlaps(run: Run, one: Run, xy: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    """Return the share of places for which the intervals of two runs overlap."""
    mine, theirs = (each.query(xy, interval=True) for each in (run, one))
    return float(np.mean((mine.low <= theirs.high) & (theirs.low <= mine.high)))


def compare(log: Path, name: str, folder: Path, seconds: float, seed: int) -> dict[str, Any]:
    """Return what sessions, with and without forgetting, come to beside one run of the same time."""
    words = ["--max-range", str(MAX_RANGE[name])] if name in MAX_RANGE else []
    rows = {
        arm: chain_of_sessions(log, folder / arm, seconds, seed, arm == "forgetting", words)
        for arm in ("extended", "forgetting")
    }
    sampled(log, folder / "one", ":", SESSIONS * seconds, seed, *words)
    runs = {arm: folder / arm / str(SESSIONS - 1) for arm in rows} | {"one": folder / "one"}
    scores = {arm: prf("score", path, laser=log, scans=HELD_OUT, noise=0.05) for arm, path in runs.items()}
    one = read_run(runs["one"])
    xy = places(one, seed)
    shares = {arm: overlaps(read_run(path), one, xy) for arm, path in runs.items()}
    kept = ("beam_nll", "nll", "within_0.2m")
    return {
        "sessions": rows,
        "scores": {arm: {key: found[key] for key in kept} | {"overlap": shares[arm]} for arm, found in scores.items()},
    }


def main() -> int:
    """Print and write what came of each log."""
    asked = commands.parser(__doc__, 60.0)
    asked.add_argument("--logs", nargs="+", default=["intel", "aces", "freiburg-101"])
    options = commands.parse(asked)
    result: dict[str, Any] = {}
    for name in options.logs:
        if name == DRIVE:
            result[name] = endless(options.output / "sessions" / name, options.seconds, options.seed)
            continue
        log = log_path(options.data, name)
        if log is not None:
            result[name] = compare(log, name, options.output / "sessions" / name, options.seconds, options.seed)
            say(json.dumps(result[name]["scores"], indent=1))
    commands.write_table(options.output / "sessions.json", result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
