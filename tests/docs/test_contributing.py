"""The examples of CONTRIBUTING.md: each is applied to a copy of the tree, where its own test passes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.patches import apply_to, examples_of, files_of

EXAMPLES = examples_of((ROOT / "CONTRIBUTING.md").read_text())
MOST_FILES = 3
"""That an example may touch, its test among them."""


def test_examples_are_there() -> None:
    assert set(EXAMPLES) == {"A feature of patches", "A reader of clouds", "A sensor", "A move"}


@pytest.mark.parametrize("title", EXAMPLES)
def test_examples_touch_few_files(title: str) -> None:
    files = files_of(EXAMPLES[title])
    assert len(files) <= MOST_FILES
    assert sum(name.startswith("tests/") for name in files) == 1


@pytest.mark.slow
@pytest.mark.parametrize("title", EXAMPLES)
def test_an_example_can_be_followed(copied_project: Path, title: str) -> None:
    apply_to(copied_project, EXAMPLES[title])
    test = next(name for name in files_of(EXAMPLES[title]) if name.startswith("tests/"))
    # As plain Python: nothing has to be compiled for a copy that is used once.
    there = {**os.environ, "PYTHONPATH": str(copied_project), "NUMBA_DISABLE_JIT": "1"}
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]
    done = subprocess.run(words, cwd=copied_project, env=there, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
    with_ruff = [sys.executable, "-m", "ruff", "check", "--select", "F,I,D1", *files_of(EXAMPLES[title])]
    done = subprocess.run(with_ruff, cwd=copied_project, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
