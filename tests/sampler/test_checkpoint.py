"""Checkpoints whose check sums are right and whose arrays are not: refused before a kernel follows what they say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.posterior import Settings
from prf.run import names
from prf.sampler import Sampler
from prf.sampler.chain_state import Arrays
from prf.sampler.checkpoint import SCHEMA, load_checkpoint, save_checkpoint
from prf.sampler.tempering_ladder import LadderPlan
from prf.shell.errors import InputError
from prf.shell.seeds import spawn_generators
from prf.shell.storage import load_arrays, save_arrays
from prf.window import Window
from tests.reference.beams import Sensor
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 4.0, 4.0)
PLAN = LadderPlan(2, 0.0)


@pytest.fixture(scope="module")
def settings() -> Settings:
    world = draw_world(0.25, ROOM, Sensor(8.0), 2, 10, np.random.default_rng(3))
    return Settings(ROOM, 0.25, world.data, resolution=0.5)


@pytest.fixture(scope="module")
def stored(settings: Settings, tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    folder = tmp_path_factory.mktemp("stored")
    with Sampler(settings, spawn_generators(7, 1), 1, plan=PLAN) as sampler:
        sampler.advance()
        save_checkpoint(folder, sampler, "this run")
    return load_arrays(folder / names.CHECKPOINT, SCHEMA)


def load(arrays: Arrays, settings: Settings, folder: Path) -> int:
    """Go on for a round from stored arrays, and return the step that this comes to."""
    save_arrays(folder / names.CHECKPOINT, SCHEMA, arrays)
    with Sampler(settings, spawn_generators(7, 1), 1, plan=PLAN) as sampler:
        load_checkpoint(folder, sampler, "this run")
        sampler.advance()
        return sampler.step


def with_entry(array: np.ndarray, place: tuple[int, ...], value: float) -> np.ndarray:
    changed = array.copy()
    changed[place] = value
    return changed


DAMAGE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "graph.edge_vertices": lambda array: with_entry(array, (0, 0), 10**9),
    "graph.vertex_edges": lambda array: array[:-1],
    "graph.members": lambda array: np.asfortranarray(array),
    "graph.positions": lambda array: with_entry(array, (0, 0), -2),
    "graph.counts": lambda array: with_entry(array, (c.FREE_EDGES,), 10**12),
    "graph.vertex_xy": lambda array: np.full_like(array, np.nan),
    "graph.edge_xy": lambda array: array + 1e-3,
    "graph.window": lambda array: 2.0 * array,
    "graph.edge_length": lambda array: array.astype(np.float32),
    "generator": lambda array: array[None],
}


@pytest.mark.parametrize("prefix", ["chain0.", "chain0.rung1."])
@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_told(stored: Arrays, settings: Settings, tmp_path: Path, name: str, prefix: str) -> None:
    assert stored[f"{prefix}graph.counts"][c.EDGES] > 0, "a map without a wall would hide some of it"
    with pytest.raises(InputError, match=r"checkpoint\.npz: damaged \(does not fit this run: ") as caught:
        load(stored | {prefix + name: DAMAGE[name](stored[prefix + name])}, settings, tmp_path)
    assert name.replace("vertex_xy", "edge_xy") in str(caught.value)


def test_what_is_missing_is_told(stored: Arrays, settings: Settings, tmp_path: Path) -> None:
    for name in ("chain0.graph.sums", "chain0.image.black", "chain0.ladder.powers"):
        with pytest.raises(InputError, match=r"checkpoint\.npz: damaged"):
            load({key: array for key, array in stored.items() if key != name}, settings, tmp_path)


def test_a_whole_one_is_read(stored: Arrays, settings: Settings, tmp_path: Path) -> None:
    assert load(stored, settings, tmp_path) > stored["chain0.graph.counts"][c.STEP]
