"""Measures all figures of benchmarks/README.md anew, part by part: `make bench-all`; most of a day.

What each part prints is in build/bench/REVISION/PART.txt, with its command, date and load. A part that fails is named;
those after it run all the same. Stopped and called again, it goes on with the part where it was. `--only PART ...` are
some; `--check` starts every part with --help alone.
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
        "figure5 --seconds 60",
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
    *("real_ranks", "trajectories --worlds 22 24 26 28 --seconds 120 --threads 1"),
    *("edges", "edges --tuned", "causes", "causes --drives", "formats"),
)
"""Arguments of `python -m benchmarks.`, in the order of the table in README.md."""


def run(part: str, folder: Path) -> str:
    """Run a part and keep what it prints, unless a folder of committed code has it whole; return how it went."""
    module, *arguments = part.split()
    path = folder / f"{'-'.join(word.strip('-') for word in part.split() if '/' not in word)}.txt"
    if path.exists() and not folder.name.endswith("-dirty") and "\n# exit code 0," in path.read_text():
        return "kept"
    began, start = datetime.datetime.now(datetime.UTC), time.monotonic()
    with path.open("w") as stream:
        load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
        place = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {load}"
        stream.write(f"# python -m benchmarks.{part}\n# {began:%Y-%m-%d %H:%M} UTC, {place}\n")
        stream.flush()
        command = [sys.executable, "-m", f"benchmarks.{module}", *arguments]
        code = subprocess.run(command, cwd=ROOT, stdout=stream, stderr=subprocess.STDOUT, check=False).returncode
        stream.write(f"# exit code {code}, {(time.monotonic() - start) / 60.0:.1f} minutes\n")
    return "done" if code == 0 else "FAILED"


def main() -> int:
    """Run the parts; 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="PART", help="these modules alone")
    parser.add_argument("--check", action="store_true", help="start every part with --help alone")
    asked = parser.parse_args()
    parts = [part for part in PARTS if asked.only is None or part.split()[0] in asked.only]
    if asked.check:
        parts = [f"{part} --help" for part in dict.fromkeys(part.split()[0] for part in parts)]
    revision = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    folder = FOLDER / (revision.stdout.strip() or "unknown")
    folder.mkdir(parents=True, exist_ok=True)
    CACHE.mkdir(exist_ok=True)
    print(f"in {folder.relative_to(ROOT)}:", flush=True)
    states = []
    for number, part in enumerate(parts, 1):
        states.append(run(part, folder))
        print(f"{number:2} of {len(parts)}  {states[-1]:<6}  {part}", flush=True)
    return int("FAILED" in states)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("stopped; called again it goes on with this part")
