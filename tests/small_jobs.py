"""Small jobs of both tools, and what they gave, for processes of their own: compiled, or as plain Python."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
SAMPLED = ("draws.npz", "posterior.npz", "map.geojson")
"""Files of a RUN that depend on the seed and the input alone."""


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def call(tool: str, command: str) -> None:
    """Run a verb in this process."""
    import importlib

    from prf.shell.run import run_app

    app = importlib.import_module(f"{tool}.cli").app
    with contextlib.redirect_stdout(io.StringIO()):
        code = run_app(app, tool, [*command.split(), "-q"])
    assert code == 0, f"{tool} {command}: exit code {code}"


def sampled(folder: Path, options: str) -> dict[str, str]:
    """Return the digests of what ``prf sample`` gives for a few beams of the demo office."""
    log = ROOT / "data" / "demo-office.log.gz"
    call("prf", f"sample --laser {log} --every-scan 40 --every-beam 20 --seed 3 --resolution 1 {options} -o {folder}")
    return {name: digest(folder / name) for name in SAMPLED}


def short_chain(n_steps: int) -> dict[str, Any]:
    """Return where a chain on such beams stands after a few hundred steps, to the last bit."""
    from prf.configuration import Configuration
    from prf.layout import read_coloring
    from prf.sampler.chain import ChainSampler
    from prf.sampler.prepare import read_prepared

    log = str(ROOT / "data" / "demo-office.log.gz")
    config = Configuration.of(every_scan=40, every_beam=20, resolution=1.0, start="empty")
    settings = read_prepared(log, config).settings
    chain = ChainSampler(settings, np.random.default_rng(3), np.zeros(1, np.int64))
    chain.run_to(n_steps)
    chain.settle()
    coloring, graph = read_coloring(chain.chain.graph), chain.chain.graph
    state = hashlib.sha256()
    for array in (coloring.xy, coloring.edges, graph.sums, chain.chain.outcomes, chain.chain.image.black):
        state.update(np.ascontiguousarray(array).tobytes())
    return {"state": state.hexdigest(), "n_edges": coloring.n_edges, "accepted": int(chain.chain.outcomes[:, 2].sum())}


def classified(folder: Path) -> dict[str, Any]:
    """Return what ``mapq`` says of a small cloud: patches, labels, probabilities."""
    from mapq.io import read_cloud, write_ply
    from tests.mapq.labelled import draw_patches

    write_ply(folder / "walls.ply", draw_patches(1, n_walls=12).cloud)
    call("mapq", f"classify {folder / 'walls.ply'} --max-tilt 90 -o {folder / 'result.ply'}")
    found = read_cloud(str(folder / "result.ply"))
    rows = json.loads((folder / "result.json").read_text())["patches"]
    return {
        "patch": hashlib.sha256(found.fields["patch"].tobytes()).hexdigest(),
        "n_patches": len(rows),
        "label": [row["label"] for row in rows],
        "p": [row["p_suspicious"] for row in rows],
        "measures": [[row["area_m2"], row["rms_m"], row["difference"]] for row in rows],
    }


def in_child(expression: str, **environment: str) -> Any:
    """Return the value of an expression over this module's functions, from a process of its own."""
    code = f"import json; from pathlib import Path; from tests.small_jobs import *; print(json.dumps({expression}))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
