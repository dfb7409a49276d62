"""Checkpoints are read where they are whole, and refused where an array is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.window import Window
from prf.results import names
from prf.sampler import Sampler
from prf.sampler.checkpoint import SCHEMA, Arrays, load_checkpoint, save_checkpoint
from prf.sampler.posterior import Settings
from prf.sampler.tempering import LadderPlan
from prf.shell.cli.provenance import spawn_generators
from prf.shell.cli.storage import load_arrays, save_arrays
from prf.shell.errors import InputError
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


def test_a_missing_array_is_reported(stored: Arrays, settings: Settings, tmp_path: Path) -> None:
    for name in ("chain0.graph.sums", "chain0.image.black", "chain0.ladder.powers"):
        with pytest.raises(InputError, match=r"checkpoint\.npz: damaged"):
            load({key: array for key, array in stored.items() if key != name}, settings, tmp_path)


def test_a_whole_one_is_read(stored: Arrays, settings: Settings, tmp_path: Path) -> None:
    assert load(stored, settings, tmp_path) > stored["chain0.graph.counts"][c.STEP]
