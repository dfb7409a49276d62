"""What the benchmarks run on, and chains taken from it."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from prf.configuration import Configuration
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.kernels.step import run
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring
from prf.model.layout import grow
from prf.model.window import Window
from prf.readings import read_readings, thin
from prf.sampler.prepare import prepare
from prf.sampler.target import Target, make_chain

ROOT = Path(__file__).resolve().parents[1]
OFFICE = ROOT / "data" / "demo-office.log.gz"
BUILDING = ROOT.parent / "shared" / "data" / "prf" / "carmen" / "intel-corrected.log.gz"
SCALE = 0.1

MOVES = {
    c.TRIANGLE_BIRTH: "(a) triangle birth",
    c.TRIANGLE_DEATH: "(a) triangle death",
    c.BOUNDARY_BIRTH: "(b) boundary birth",
    c.BOUNDARY_DEATH: "(b) boundary death",
    c.CORNER_BIRTH: "(c) corner birth",
    c.CORNER_DEATH: "(c) corner death",
    c.SPLIT: "(d) split",
    c.MERGE: "(d) merge",
    c.MOVE_INTERIOR: "(e) move interior vertex",
    c.MOVE_BOUNDARY: "(f) move boundary vertex",
    c.PAST_CORNER: "(g) past a corner",
    c.RECOLOR: "(h) recolour",
    c.LOCAL_RECOLOR: "(i) local recolour",
    c.SLIDE: "(j) slide",
    c.CUT_WALL: "cut wall",
    c.MEND_WALL: "mend wall",
    c.JOIN_WALL: "join to wall",
    c.PART_WALL: "part from wall",
    c.DOCK: "join to side",
    c.UNDOCK: "part from side",
    c.NOTCH: "notch",
    c.FILL: "fill notch",
}

Loop = Callable[[Chain, np.random.Generator, int], bool]


def target_of(log: Path, every_scan: int = 1, image: bool = False, **changes: Any) -> Target:
    """Return what `prf sample --laser LOG` samples from, with or without its image, but for `changes`."""
    readings = thin(read_readings(str(log)), every_scan=every_scan)
    target = prepare(Configuration.of(scale=SCALE), readings).target
    return dataclasses.replace(target, **changes).with_execution(
        resolution=target.execution.resolution if image else None
    )


def prior_settings() -> tuple[Target, Coloring]:
    """Return a bare prior and a map of some 630 edges drawn from it: a stand-in for the large building."""
    window = Window(0.0, 0.0, 100.0, 100.0)
    target = Target(window, SCALE)
    return target, exact_draws(SCALE, window, 1, np.random.default_rng(1))[0]


def start(target: Target, coloring: Coloring | None = None) -> Chain:
    """Return a chain at `coloring`, or at the empty map."""
    return make_chain(target, Coloring.empty(target.window) if coloring is None else coloring)


def advance(chain: Chain, rng: np.random.Generator, n_steps: int, loop: Loop = run) -> Chain:
    """Return the chain `n_steps` on, given more room where it asks for it."""
    until = int(chain.graph.counts[c.STEP]) + n_steps
    while not loop(chain, rng, until):
        chain = grow(chain)
    return chain


def snapshots(chain: Chain, rng: np.random.Generator, n: int, spacing: int) -> list[Chain]:
    """Return `n` copies of the chain taken `spacing` steps apart, sums and lists laid out anew."""
    taken = []
    for _ in range(n):
        chain = advance(chain, rng, spacing)
        recompute_sums(chain)
        taken.append(copy(chain))
    return taken


def copy(value: Any) -> Any:
    """Return a copy of a chain that shares no array with it, its outcomes as they stand."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, tuple):
        return type(value)(*(copy(part) for part in value))
    return value


def cpu(function: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU seconds that a call takes in this thread, and its result."""
    before = time.thread_time()
    result = function()
    return time.thread_time() - before, result
