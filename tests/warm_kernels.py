"""Call every kernel that Python calls, once and on little data: ``python -m tests.warm_kernels``.

`make test` runs it before pytest, so that the workers of pytest-xdist find machine code instead of compiling the same
code side by side. The loop of the sampler alone takes as long to compile as everything else, so all that calls it has
a process of its own: ``python -m tests.warm_kernels chain`` or ``rest``. No kernel that takes long is called by both.
The tests themselves are collected meanwhile, which leaves their bytecode to both workers.
Prints one JSON object: cache hits and misses of each kernel that was called from Python.
"""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import mapq.cli
import prf.cli
from mapq.commands import warm as mapq_warm
from prf.commands import warm as prf_warm
from prf.kernels.readings.cones import N_POSE
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at
from prf.model.window import Window
from prf.results import write_run
from prf.results.score.scene import features_seen, scene_of_coloring
from prf.sampler.target import Execution, Target, make_chain
from prf.sampler.tiles.schedule import small_round
from prf.shell.cli.run import run_app
from tests.factories import make_run
from tests.reference.recompute import recompute_impacts

DATA = Path(__file__).resolve().parent.parent / "data"
LOG, TOWN = DATA / "demo-office.log.gz", DATA / "demo-town.ply.gz"
CHAIN = (
    *(f"prf {line}" for job in ("prior", "sonar", "points", "poses") for line in prf_warm.COMMANDS[job]),
    f"prf sample --laser {LOG} --every-scan 10 --every-beam 12 --set thinning.beam_density=0.1 --chains 2 --steps 2000"
    " --resolution 1 --seed 1 -o run",
)
REST = (
    *(f"prf {line}" for line in prf_warm.COMMANDS["walls"]),
    *(f"mapq {line}" for line in mapq_warm.COMMANDS["classify"]),
    f"mapq segment {TOWN} -o demo.patches",
    "mapq features demo.patches --json",
    "mapq classify demo.patches -o demo.ply",
    *(f"prf {line}" for line in prf_warm.COMMANDS["maps"] if not line.startswith("sample")),
)


def run_commands(commands: tuple[str, ...]) -> None:
    """Run commands in a folder of their own, and discard their results."""
    apps = {"prf": prf.cli.app, "mapq": mapq.cli.app}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        for name, text in prf_warm.FILES.items():
            Path(name).write_text(text)
        for command in commands:
            tool, *words = command.split()
            if words[1] == "run" and not Path("run").exists():
                write_run("run", make_run(n_draws=4, window=Window(0.0, 0.0, 24.0, 16.0)))
            code = run_app(apps[tool], tool, [*words, "-q"])
            if code != 0:
                raise SystemExit(f"{command}: exit code {code}")


def call_with_chain() -> None:
    """Call what no verb calls, on a chain: a round of tiles, which verbs begin only after many steps."""
    coloring = exact_draws(1.0, Window(0.0, 0.0, 1.0, 1.0), 1, np.random.default_rng(1))[0]
    recompute_impacts(make_chain(Target(coloring.window, 1.0, execution=Execution(resolution=0.2)), coloring))
    small_round()


def call_on_maps() -> None:
    """Call what no verb calls, on maps alone."""
    draws = Draws.from_colorings([Coloring.empty(Window(0.0, 0.0, 1.0, 1.0))])
    black_areas(draws)
    black_at(draws[0], [[0.5, 0.5]])
    features_seen(scene_of_coloring(draws[0], 3.5), np.empty((0, N_POSE)), 3.5)


def cache_counts() -> dict[str, tuple[int, int]]:
    """Return (hits, misses) of each kernel that was called from Python, by its full name."""
    counts = {}
    for name, module in sorted(sys.modules.items()):
        if name.startswith(("prf.kernels.", "mapq.kernels.")):
            for kernel in vars(module).values():
                stats = getattr(kernel, "stats", None)
                if stats is not None and kernel.__module__ == name and kernel.signatures:
                    hits, misses = sum(stats.cache_hits.values()), sum(stats.cache_misses.values())
                    if hits or misses:
                        counts[f"{name}.{kernel.__name__}"] = (hits, misses)
    return counts


def warm(part: str) -> dict[str, tuple[int, int]]:
    """Call the kernels of one part in this process."""
    run_commands({"chain": CHAIN, "rest": REST}[part])
    {"chain": call_with_chain, "rest": call_on_maps}[part]()
    return cache_counts()


def warm_side_by_side() -> dict[str, tuple[int, int]]:
    """Call the kernels of each part in a process of its own."""
    commands = [[sys.executable, "-m", "tests.warm_kernels", part] for part in ("chain", "rest")]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE) for command in commands]
    subprocess.run([sys.executable, "-m", "pytest", "--collect-only", "-q"], stdout=subprocess.DEVNULL, check=False)
    printed = [process.communicate()[0] for process in processes]
    if any(process.returncode for process in processes):
        raise SystemExit("error: commands failed, see above")
    return {name: counts for text in printed for name, counts in json.loads(text).items()}


if __name__ == "__main__":
    print(json.dumps(warm(sys.argv[1]) if sys.argv[1:] else warm_side_by_side(), indent=1))
