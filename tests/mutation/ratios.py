"""Hastings ratios of single moves, on chains that the intact sources made once: quick enough for a check a mistake."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np

from tests.reference.hastings import CASES, NAMES, TOLERANCE, Findings, make_lab, states, try_move

SEED = 20050726
STATES = 2
"""Of each case."""


def write_states(path: Path) -> None:
    """Make the chains, with the intact sources, and keep them in a file of this run."""
    rng = np.random.default_rng(SEED)
    labs = [make_lab(settings, rng) for settings in CASES]
    path.write_bytes(pickle.dumps([(lab, list(states(lab, STATES, rng))) for lab in labs]))


def faults(path: Path, moves: tuple[str, ...]) -> list[str]:
    """Return what is wrong with the ratios of some moves, by name; ends at the first move with a fault."""
    worlds = pickle.loads(path.read_bytes())
    for name in moves:
        rng = np.random.default_rng(SEED)
        found = Findings()
        for lab, chains in worlds:
            for chain in chains:
                try_move(lab, NAMES.index(name), copy.deepcopy(chain), rng, found)
                if _wrong(found):
                    return [f"{name}: {_wrong(found)}"]
        if found.valid == 0:
            return [f"{name}: never valid"]
    return []


def _wrong(found: Findings) -> str:
    if found.problems:
        return found.problems[0]
    if not found.reference_error < TOLERANCE:
        return f"ratio off the reference's by {found.reference_error:.2g}"
    if not found.antisymmetry_error < TOLERANCE:
        return f"ratio off that of the way back by {found.antisymmetry_error:.2g}"
    return ""
