"""Measures all figures of benchmarks/README.md anew, part by part: `make bench-all`; most of a day.

What each part prints is in build/bench/DATE/PART.txt, with its command, revision and time. A part that fails is named;
those after it run all the same. `--only PART ...` are some; `--check` starts every part with --help alone.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.commands import DATA

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "build" / "bench"
INTEL = DATA / "carmen" / "intel-corrected.log.gz"
CACHE = FOLDER / "cache"
PARTS = (
    *("step_rate", "office_time", "agreement", "multimodal", f"intervals {INTEL} --window -10 -16 10 4"),
    *(
        "figure3",
        "figure4",
        "figure5",
        "scale_sweep",
        "scores --seconds 60",
        "plans",
        "plans --family rings",
        "density",
    ),
    *("score_time", "tiles", "real_sonar", "sonar", "bitmap", "returns", "sessions", "time_budget"),
    *("explore poses", "explore drive", "explore table", "segmentation", "graph_cut", "city_tiles run"),
    *("city_tiles tiles", "city_tiles drives", "city_tiles lost", "table2", "ablation", "context"),
    *(f"unseen prepare --cache {CACHE} --training", f"unseen score --cache {CACHE}", "scenes", "real_maps"),
    *("real_ranks", "trajectories", "edges", "causes", "causes --drives", "formats"),
)
"""Arguments of `python -m benchmarks.`, in the order of the table in README.md."""


def run(part: str, folder: Path) -> int:
    """Run a part and keep what it prints; return its exit code."""
    module, *arguments = part.split()
    path = folder / f"{'-'.join(word.strip('-') for word in part.split() if '/' not in word)}.txt"
    asked = ["git", "rev-parse", "--short", "HEAD"]
    revision = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()
    began, start = datetime.datetime.now(datetime.UTC), time.monotonic()
    with path.open("w") as stream:
        load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
        place = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {load}"
        stream.write(f"# python -m benchmarks.{part}\n# {began:%Y-%m-%d %H:%M} UTC, revision {revision}, {place}\n")
        stream.flush()
        command = [sys.executable, "-m", f"benchmarks.{module}", *arguments]
        code = subprocess.run(command, cwd=ROOT, stdout=stream, stderr=subprocess.STDOUT, check=False).returncode
        stream.write(f"# exit code {code}, {(time.monotonic() - start) / 60.0:.1f} minutes\n")
    print(f"{'done  ' if code == 0 else 'FAILED'} {part}: {path.relative_to(ROOT)}", flush=True)
    return code


def main() -> int:
    """Run the parts; 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="PART", help="these modules alone")
    parser.add_argument("--check", action="store_true", help="start every part with --help alone")
    asked = parser.parse_args()
    parts = [part for part in PARTS if asked.only is None or part.split()[0] in asked.only]
    if asked.check:
        parts = [f"{part} --help" for part in dict.fromkeys(part.split()[0] for part in parts)]
    folder = FOLDER / f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}"
    folder.mkdir(parents=True, exist_ok=True)
    CACHE.mkdir(exist_ok=True)
    failed = [part for part in parts if run(part, folder)]
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
