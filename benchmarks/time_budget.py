"""How well `prf sample --time-budget` keeps its time, on a quiet machine and beside processes that take all its cores.

Run it from the repository's root::

    python -m benchmarks.time_budget [--seconds S] [--busy N ...]

Kernels are compiled before. The time is that by the wall clock from the line that says what is sampled to the end of
the process: starts, sampling, checks, and writing the run with its picture. A log of the shared data follows the
demo's where it is there.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import commands
from benchmarks.worlds import OFFICE

SPIN = "while True: pass"


def seconds_taken(log: Path, budget: float, folder: Path, words: list[str]) -> float:
    """Return the seconds from the line that says what is sampled to the end."""
    command = [sys.executable, "-m", "prf", "sample", "--laser", str(log), "--time-budget", str(budget), *words]
    command += ["-o", str(folder), "--force", "--seed", str(commands.SEED), "--no-progress"]
    begun = None
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if begun is None and "window" in line and "chains" in line:
                begun = time.monotonic()
    if process.returncode != 0 or begun is None:
        raise SystemExit(process.returncode or 1)
    return time.monotonic() - begun


def main() -> int:
    """Print a table."""
    asked = commands.parser(__doc__, 30.0)
    asked.add_argument("--busy", type=int, nargs="+", default=[0, 4], help="processes beside the sampler")
    options = commands.parse(asked)
    logs: list[tuple[str, Path, list[str]]] = [("demo office", OFFICE, [])]
    intel = commands.log_path(options.data, "intel")
    if intel is not None:
        logs.append(("Intel, all scans", intel, ["--max-range", "40"]))
    subprocess.run([sys.executable, "-m", "prf", "warm", "-q"], check=True)
    print("| log | processes beside | budget, s | taken, s |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, log, words in logs:
            for busy in options.busy:
                others = [subprocess.Popen([sys.executable, "-c", SPIN]) for _ in range(busy)]
                try:
                    taken = seconds_taken(log, options.seconds, Path(folder) / "run", words)
                finally:
                    for other in others:
                        other.kill()
                print(f"| {name} | {busy} | {options.seconds:g} | {taken:.1f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
