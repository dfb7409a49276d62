"""The notebooks of `make docs`: every command of a tutorial is a cell, and all cells run."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from docs.make_site import TUTORIALS, notebook_of
from tests.conftest import ROOT
from tests.docs.blocks import commands_of

NAMES = sorted(page.name for page in TUTORIALS.glob("*.md"))


@pytest.mark.parametrize("name", NAMES)
def test_every_command_of_a_tutorial_is_in_its_notebook(name: str) -> None:
    cells = [cell for cell in notebook_of(TUTORIALS / name)["cells"] if cell["cell_type"] == "code"]
    code = "\n".join(cell["source"] for cell in cells).replace("\\\n", " ").splitlines()
    assert [each.text for each in commands_of(TUTORIALS / name, name)] == [
        line.strip() for line in code if line and not line.startswith("%%bash")
    ]
    shown = "".join(output["text"] for cell in cells for output in cell["outputs"])
    assert "\n$ " not in shown


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_notebook_of_a_tutorial_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat, nbclient = (
        pytest.importorskip(module, reason="needs pip install '.[docs]'") for module in ("nbformat", "nbclient")
    )
    shutil.copytree(ROOT / "data", tmp_path / "data")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.from_dict(notebook_of(TUTORIALS / name))
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": str(tmp_path)}}).execute()
