"""Hastings ratios and draws of single moves, on few chains, which the intact sources made: a check a mistake."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np

from tests.reference.hastings import (
    CASES,
    NAMES,
    SMALL_TRIES,
    Findings,
    attempt,
    make_lab,
    small_states,
    states,
    tries,
    try_move,
)

SEED = 20050726
STATES = 2
"""Of each case."""
ROUNDING = 1e-7
"""By which ratios may differ: reached by no mistake, and not by the rounding of nearly parallel walls."""
REPEATS = 3
"""Of each state."""


def write_states(path: Path) -> None:
    """Make the chains, with the intact sources, and keep them in a file of this run."""
    rng = np.random.default_rng(SEED)
    labs = [make_lab(settings, rng) for settings in CASES]
    found = [(lab, list(states(lab, STATES, rng)), list(small_states(lab, rng))) for lab in labs]
    path.write_bytes(pickle.dumps(found))


def load_states(path: Path) -> list[Any]:
    """Return the chains of the file of this run: of each case its settings, states and smallest maps."""
    found: list[Any] = pickle.loads(path.read_bytes())
    return found


def faults(worlds: list[Any], moves: tuple[str, ...]) -> list[str]:
    """Return what is wrong with the ratios of some moves, by name; ends at the first move with a fault."""
    for name in moves:
        rng = np.random.default_rng(SEED)
        found = Findings()
        for lab, large, small in worlds:
            for chain, most in (*((chain, None) for chain in large), *((chain, SMALL_TRIES) for chain in small)):
                for _ in range(REPEATS):
                    try_move(lab, NAMES.index(name), chain, rng, found, most)
                    if _wrong(found):
                        return [f"{name}: {_wrong(found)}"]
        if found.valid == 0:
            return [f"{name}: never valid"]
    return []


def draw_faults(worlds: list[Any], move: str) -> list[str]:
    """Return where a move draws with another density than the reference says, or one way of two; for a few ways."""
    from tests.kernels.test_proposal_draws import BRANCHES, NEAR, densities, idle_choices

    kind, rng = NAMES.index(move), np.random.default_rng(SEED)
    n = 0
    for lab, large, _ in worlds:
        for start in large[:1]:
            end = copy.deepcopy(start)
            for _ in range(tries(kind)):
                if attempt(end, kind, rng)[3] > -math.inf:
                    n += 1
                    if idle_choices(lab, kind, start, end):
                        return [f"{move}: a choice that changes nothing"]
                    found, expected = densities(lab, kind, start, end) if kind in BRANCHES else (0.0, 0.0)
                    if not abs(found - expected) <= NEAR * expected:
                        return [f"{move}: density {found:.6g} for {expected:.6g}"]
                    break
    return [] if n else [f"{move}: never valid"]


def _wrong(found: Findings) -> str:
    if found.problems:
        return found.problems[0]
    if not found.reference_error < ROUNDING:
        return f"ratio off the reference's by {found.reference_error:.2g}"
    if not found.antisymmetry_error < ROUNDING:
        return f"ratio off that of the way back by {found.antisymmetry_error:.2g}"
    return ""
