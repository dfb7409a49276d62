from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from prf.shell.cli.manifest import describe_input, describe_process, versions
from prf.shell.errors import InputError


def test_input_is_named_by_its_digest(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    log.write_bytes(b"FLASER 0\n")
    assert describe_input(log) == {
        "path": str(log),
        "sha256": hashlib.sha256(b"FLASER 0\n").hexdigest(),
        "bytes": 9,
    }


def test_standard_input_has_no_digest() -> None:
    assert describe_input("-") == {"path": "-", "sha256": None, "bytes": None}


def test_missing_input_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent"):
        describe_input(tmp_path / "absent")


def test_versions_are_those_that_run() -> None:
    assert versions()["numpy"] == np.__version__
    assert set(versions()) >= {"python", "numpy", "numba", "prf"}


def test_process_lists_its_inputs(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    described = describe_process([tmp_path / "a"])
    assert [entry["bytes"] for entry in described["inputs"]] == [0]
    assert described["platform"]["machine"]
