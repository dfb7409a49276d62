"""Checkpoints are read where they are whole, and refused where an array is missing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.window import Window
from prf.results import names
from prf.sampler import Ensemble
from prf.sampler.checkpoint import SCHEMA, Arrays, load_checkpoint, refuse_other_log, save_checkpoint
from prf.sampler.schedules import LadderPlan
from prf.sampler.target import Execution, Target
from prf.shell.cli.storage import describe_input, load_arrays, save_arrays, spawn_generators
from prf.shell.errors import InputError
from tests.driving import advance
from tests.reference.beams import Sensor
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 4.0, 4.0)
PLAN = LadderPlan(2, 0.0)


@pytest.fixture(scope="module")
def target() -> Target:
    world = draw_world(0.25, ROOM, Sensor(8.0), 2, 10, np.random.default_rng(3))
    return Target(ROOM, 0.25, world.data, execution=Execution(resolution=0.5))


@pytest.fixture(scope="module")
def stored(target: Target, tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    folder = tmp_path_factory.mktemp("stored")
    sampler = Ensemble(target, spawn_generators(7, 1), plan=PLAN)
    advance(sampler)
    save_checkpoint(folder, sampler, "this run")
    return load_arrays(folder / names.CHECKPOINT, SCHEMA)


def load(arrays: Arrays, target: Target, folder: Path) -> int:
    """Go on for a round from stored arrays, and return the step that this comes to."""
    save_arrays(folder / names.CHECKPOINT, SCHEMA, arrays)
    sampler = Ensemble(target, spawn_generators(7, 1), plan=PLAN)
    load_checkpoint(folder, sampler, "this run")
    advance(sampler)
    return sampler.step


def test_a_missing_array_is_reported(stored: Arrays, target: Target, tmp_path: Path) -> None:
    for name in ("chain0.graph.sums", "chain0.image.black", "chain0.ladder.powers"):
        with pytest.raises(InputError, match=r"checkpoint\.npz: damaged"):
            load({key: array for key, array in stored.items() if key != name}, target, tmp_path)


def test_a_whole_one_is_read(stored: Arrays, target: Target, tmp_path: Path) -> None:
    assert load(stored, target, tmp_path) > stored["chain0.graph.counts"][c.STEP]


def test_a_folder_is_the_log_of_a_run_while_its_files_are_the_same(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "a.mcap").write_bytes(b"some")
    run = SimpleNamespace(manifest={"inputs": [describe_input(bag)]})
    bag = bag.rename(tmp_path / "moved")
    refuse_other_log(run, "--laser", bag)
    (bag / "a.mcap").write_bytes(b"other")
    with pytest.raises(InputError, match="not the log that the run was made from"):
        refuse_other_log(run, "--laser", bag)
