"""The scale parameter p of the prior, small to large, on the lobby of figure 4: see README.md beside this file.

Run it from the repository's root::

    python -m benchmarks.scale_sweep [--quick] [--scales 0.05 0.1 0.2] [-o FOLDER]

The paper took p = 0.1 per metre: larger, walls grow jagged to follow errors of the data; smaller, structure is
smoothed over. One picture with all posteriors and best draws, and a table of sizes and of scores on scans kept out.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import commands, figure4, panels
from benchmarks.commands import made, prf, say
from prf.model.window import Window
from prf.output.run import Run, read_run

STEPS, QUICK_STEPS = 20_000_000, 500_000
"""Of each chain: alike for all scales, since the clock would give a large map fewer."""
SCALES = tuple(round(float(scale), 3) for scale in np.geomspace(0.02, 0.5, 7))
HELD_OUT = "2::4"
"""Scans midway between those that the maps are made from."""
DETAIL = Window(-6.0, -2.0, 6.0, 4.0)
HEIGHT = 1.7
"""Inches of one picture in the row."""
COLUMNS = ("scale", "n_edges", "length_m", "beam_nll", "nll", "brier", "auc", "within_0.2m", "rmse", "seconds")


def at_scale(log: Path, scale: float, options: argparse.Namespace) -> tuple[dict[str, Any], Run]:
    """Sample at one scale and score; return the row of the table and the run."""
    folder = options.output / f"p{scale:g}.run"
    say(f"p = {scale:g}: {options.steps:,} steps a chain")
    how: dict[str, Any] = {"seed": options.seed, "threads": options.threads, "steps": options.steps}
    sampled = made("sample", folder, laser=log, scale=scale, **figure4.LOBBY_READINGS, **commands.LASER_SETTINGS, **how)
    held_out: dict[str, Any] = {"scans": HELD_OUT, "max_range": figure4.LOBBY_READINGS["max_range"]}
    scores = prf("score", folder, laser=log, seed=options.seed, **held_out)
    run = read_run(folder)
    edges, length = (float(run.functionals[name].mean()) for name in ("n_edges", "total_length"))
    sizes = {"n_edges": edges, "length_m": length, "edges_per_metre": edges / length, "seconds": sampled["seconds"]}
    return {"scale": scale, **sizes, **scores}, run


def picture(rows: list[dict[str, Any]], runs: list[Run], target: Path, window: Window, title: str) -> None:
    """Draw posteriors over best draws, one column a scale."""
    posteriors, maps = [], []
    for row, run in zip(rows, runs, strict=True):
        assert run.image is not None
        assert run.best is not None
        posteriors.append(panels.image(run.image, f"p = {row['scale']:g}: {row['n_edges']:.0f} edges"))
        maps.append(panels.filled(run.best, f"best draw, {run.best.n_edges} edges"))
    panels.save_page(
        target,
        posteriors + maps,
        window,
        columns=len(runs),
        height=HEIGHT,
        title=title,
        subtitle=f"{figure4.LOBBY}  ·  {rows[0]['n_train']:,} beams  ·  {figure4.words(runs[0])}",
    )


def table(rows: list[dict[str, Any]]) -> str:
    """Return the figures as Markdown."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    lines += ["| " + " | ".join(f"{row[name]:.4g}" for name in COLUMNS) + " |" for row in rows]
    return "\n".join(lines)


def main() -> int:
    """Sweep."""
    asked = commands.parser(__doc__)
    asked.add_argument("--scales", nargs="+", type=float, default=list(SCALES), metavar="P")
    asked.add_argument("--steps", type=int, default=STEPS, help="of each chain")
    options = commands.parse(asked)
    if options.quick:
        options.steps = min(options.steps, QUICK_STEPS)
    options.output = options.output / "scale_sweep"
    log = commands.log_path(options.data, figure4.LOBBY)
    if log is None:
        return 0
    rows, runs = [], []
    for scale in options.scales:
        row, run = at_scale(log, scale, options)
        assert run.laser is not None
        rows.append({**row, "n_train": len(run.laser.range)})
        runs.append(run)
    title = "Posterior by the scale parameter of the prior"
    picture(rows, runs, options.output / "scale_sweep.png", runs[0].draws.window, title)
    picture(rows, runs, options.output / "scale_sweep-detail.png", DETAIL, title + ": a detail")
    result = {"schema": "prf.benchmark.scale_sweep/1", "steps": options.steps, "held_out": HELD_OUT, "rows": rows}
    commands.write_table(options.output / "scale_sweep.json", result)
    print(table(rows))
    for name, sign in (("beam_nll", 1.0), ("within_0.2m", -1.0)):
        best = rows[int(np.argmin([sign * row[name] for row in rows]))]
        print(f"best {name} at p = {best['scale']:g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
