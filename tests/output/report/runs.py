"""Runs whose chains move slowly, as chains do: each map stays for some draws."""

from __future__ import annotations

import dataclasses
import gzip
from base64 import b64decode

import numpy as np

from prf.model.coloring import Draws
from prf.model.window import Window
from prf.output.run import Run
from tests.factories import make_run

WINDOW = Window(-3.25, 9_994.5, 4.7531, 10_001.0)
"""Not of whole millimetres, and far from the origin."""


def slow_run(seed: int = 1, n_draws: int = 160) -> Run:
    """Return a run of three chains, one longer than the others, as the draws were recorded: in turn."""
    run = make_run(seed, 24, WINDOW, resolution=0.25)
    rng = np.random.default_rng(seed)
    chain = np.append(np.arange(n_draws - 10) % 3, np.zeros(10)).astype(np.int32)
    shown = np.empty(n_draws, np.int64)
    for each in range(3):
        rows = np.flatnonzero(chain == each)
        shown[rows] = 8 * each + np.cumsum(rng.random(len(rows)) < 0.4) % (10 + 2 * each)
    draws = Draws.from_colorings([run.draws[i % 24] for i in shown])
    functionals = {"n_edges": draws.n_edges.astype(np.float64), "log_posterior": rng.normal(size=n_draws)}
    return dataclasses.replace(
        run,
        manifest={**run.manifest, "inputs": [{"path": "/logs/<b>hall.log.gz", "sha256": "0"}]},
        draws=draws,
        chain=chain,
        step=1000 * np.arange(n_draws, dtype=np.int64),
        functionals=functionals,
        probe_black=rng.random((n_draws, 3)) < 0.5,
    )


def unpacked(text: str) -> np.ndarray:
    """Return the whole numbers of a packed text."""
    planes = np.frombuffer(gzip.decompress(b64decode(text)), np.uint8)
    return np.ascontiguousarray(planes.reshape(4, -1).T).view("<i4").ravel()
