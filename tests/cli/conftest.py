"""One folder of small inputs for every verb, shared by the tests of the command lines."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.calls import make_samples, remove_outputs


@pytest.fixture(scope="package")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the inputs; tests leave it as it is, but for outputs named out*."""
    folder = tmp_path_factory.mktemp("samples")
    make_samples(folder)
    return folder


@pytest.fixture
def folder(samples: Path) -> Iterator[Path]:
    """Return the folder of the inputs, without outputs and with the patches that `mapq label` changes put back."""
    kept = (samples / "bare.patches").read_bytes()
    yield samples
    remove_outputs(samples)
    (samples / "bare.patches").write_bytes(kept)


@pytest.fixture
def copied(samples: Path, tmp_path: Path) -> Path:
    """Return a copy of the inputs that a test may change."""
    return Path(shutil.copytree(samples, tmp_path / "work"))
