"""The GRID file: back as it was, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from prf.occupancy import SCHEMA, is_grid, read_grid, write_grid
from prf.shell.errors import InputError
from prf.shell.storage import load_arrays, save_arrays
from tests.occupancy.test_build import BEAM, build


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_grid(tmp_path / "room.grid.npz", build(BEAM))
    return tmp_path / "room.grid.npz"


def test_a_grid_is_read_as_it_was_written(file: Path) -> None:
    grid, found = build(BEAM), read_grid(file)
    for name in ("occupancy", "hits", "misses", "origin"):
        np.testing.assert_array_equal(getattr(found, name), getattr(grid, name))
        assert getattr(found, name).dtype == getattr(grid, name).dtype
    assert found.resolution == grid.resolution
    assert found.settings["method"] == "count"
    assert found.settings["window"] == [0.0, 0.0, 5.0, 4.0]
    assert found.settings["scans"] is None


def test_grids_are_recognised(file: Path, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("PX")
    assert is_grid(file)
    assert not is_grid(tmp_path / "text")
    assert not is_grid(tmp_path)
    assert not is_grid(tmp_path / "absent")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"occupancy": None}, "occupancy is missing"),
        ({"occupancy": np.full((40, 50), 1.5, np.float32)}, "probabilities"),
        ({"occupancy": np.full((40, 50), np.nan, np.float32)}, "probabilities"),
        ({"hits": np.zeros((1, 1), np.int32)}, "array hits has shape"),
        ({"resolution": np.float64(0.0)}, "resolution"),
        ({"origin": np.array([np.inf, 0.0])}, "origin"),
        ({"settings": np.str_("{")}, "settings"),
        ({"process": np.str_("3")}, "process"),
    ],
)
def test_damaged_grids_are_refused(file: Path, changes: dict[str, object], words: str) -> None:
    arrays = {**load_arrays(file, SCHEMA), **changes}
    save_arrays(file, SCHEMA, {name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(InputError, match=words):
        read_grid(file)


def test_other_versions_are_refused(file: Path) -> None:
    save_arrays(file, "prf.grid/2", load_arrays(file, SCHEMA))
    with pytest.raises(InputError, match="version 2"):
        read_grid(file)
