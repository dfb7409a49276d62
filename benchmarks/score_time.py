"""Held-out score against time on a dense log, with thinning and with every beam: see README.md.

Run it from the repository's root::

    python -m benchmarks.score_time [--quick] [--log intel] [--scans others tenth] [--seconds 180] [-o FOLDER]

A run is sampled for a while, scored, and resumed, by the public commands; its time is what sampling took in all.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from benchmarks import commands
from benchmarks.commands import prf, say
from benchmarks.scores import HELD_OUT, MAX_RANGE, SCALE, SETS, cell

SECONDS = 180.0
SHARES = (0.1, 0.3, 1.0)
"""Of the time, at which the run is scored."""
WAYS: dict[str, dict[str, float]] = {"thinned": {}, "every beam": {"thinning.beam_density": 0.0}}
COLUMNS = ("rhat", "beam_nll", "nll", "nll_seen", "brier", "auc", "within_0.2m", "rmse")


def scored(path: Path, log: Path, name: str, seed: int) -> dict[str, Any]:
    """Return the scores of a run on the held-out scans, and its worst R-hat."""
    found = prf("score", path, laser=log, scans=HELD_OUT, max_range=MAX_RANGE[name], seed=seed)
    return {"rhat": commands.worst_rhat(path), **found}


def curve(log: Path, scans: str, way: str, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Return the scores of one run at growing times."""
    folder = options.output / "score_time" / f"{options.log}-{scans}-{way.replace(' ', '-')}"
    how = {**SETS[scans], **commands.LASER_SETTINGS, "scale": SCALE, "max_range": MAX_RANGE[options.log]}
    rows: list[dict[str, Any]] = []
    spent = 0.0
    for share in SHARES:
        wanted = share * options.seconds - spent
        common: dict[str, commands.Option] = {"threads": options.threads, "time_budget": max(wanted, 0.0)}
        if not rows:
            folder.parent.mkdir(parents=True, exist_ok=True)
            start = {**how, **common, "laser": log, "seed": options.seed, "output": folder}
            run = prf("sample", "--force", **start, **WAYS[way])
        else:
            run = prf("sample", resume=folder, **common)
        spent += run["seconds"]
        found = scored(folder, log, options.log, options.seed)
        row = {
            "map": way,
            "beams": run["n_beams"],
            "seconds": spent,
            "steps": run["steps"],
            "chains": run["chains"],
        }
        rows.append({**row, **{key: found[key] for key in COLUMNS}})
        say(f"{way}, {spent:.0f} s: beam_nll {found['beam_nll']:.3f}")
    return rows


def table(title: str, rows: list[dict[str, Any]]) -> str:
    """Return the figures as Markdown."""
    head = [title, "beams", "seconds", "steps a chain", *COLUMNS]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        cells = [f"{row[key]:,.0f}" for key in ("beams", "seconds", "steps")]
        lines.append("| " + " | ".join([row["map"], *cells, *(cell(key, row[key]) for key in COLUMNS)]) + " |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Sample, score, resume."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--log", choices=list(MAX_RANGE), default="intel")
    asked.add_argument("--scans", nargs="+", choices=list(SETS), default=["others"])
    asked.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    options = commands.parse(asked)
    log = commands.log_path(options.data, options.log)
    if log is None:
        return 0
    for scans in options.scans:
        rows = [row for way in options.ways for row in curve(log, scans, way, options)]
        print(table(f"{options.log}, {scans}", rows), flush=True)
        how = {"log": options.log, "scans": scans, "laser": commands.LASER, "scale": SCALE, "seed": options.seed}
        target = options.output / "score_time" / f"{options.log}-{scans}.json"
        commands.write_table(target, {"schema": "prf.benchmark.score_time/1", **how, "rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
