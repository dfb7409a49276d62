"""docs/reference is what the command lines say of themselves, so that every verb and flag stands there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import mapq.configuration
from docs.make_reference import TOOLS, make_page
from prf.configuration import Configuration
from prf.shell.cli.settings import Tree, note_of
from tests.conftest import ROOT
from tests.docs.patches import apply_to, examples_of, files_of


@pytest.mark.parametrize("tool", TOOLS)
def test_reference_is_up_to_date(project_root: Path, tool: str) -> None:
    page = project_root / "docs" / "reference" / f"cli-{tool}.md"
    assert page.read_text() == make_page(tool, TOOLS[tool]), "run `make docs`"


@pytest.mark.parametrize("tool", TOOLS)
def test_every_flag_has_a_row(project_root: Path, tool: str) -> None:
    text = (project_root / "docs" / "reference" / f"cli-{tool}.md").read_text()
    for verb in TOOLS[tool].VERBS:
        section = text.partition(f"\n## {tool} {verb}\n")[2].partition("\n## ")[0]
        rows = section + text.partition("## Flags of every verb")[2].partition("\n## ")[0]
        for parameter in TOOLS[tool].app.get_command(None, verb).params:
            if parameter.param_type_name == "option":
                assert any(f"`{flag}" in rows or f" {flag}" in rows for flag in parameter.opts), (verb, parameter.opts)


# docs/configuration.md says of every key what the code says.


TREES = {"prf": Configuration, "mapq": mapq.configuration.Configuration}


def rows_of(tree: type[Tree], table: str) -> list[str]:
    """Return the rows of a table: key, unit, default and meaning."""
    model = tree.tables()[table]
    rows = []
    for name, field in model.model_fields.items():
        cells = (f"`{name}`", note_of(model, name, "unit") or "–", written(field.default), field.description)
        rows.append(f"| {' | '.join(map(str, cells))} |")
    return rows


def written(value: Any) -> str:
    """Return a default as TOML has it."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(written, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else "–" if value is None else repr(value)


@pytest.mark.parametrize("tool", TREES)
def test_every_key_is_there_as_the_code_has_it(tool: str, project_root: Path) -> None:
    lines = (project_root / "docs" / "configuration.md").read_text().splitlines()
    lines = lines[lines.index(f"# {tool}") if tool == "mapq" else 0 :]
    for table in TREES[tool].tables():
        start = lines.index(f"## [{table}]")
        end = next((i for i in range(start + 1, len(lines)) if lines[i].startswith("#")), len(lines))
        assert [line for line in lines[start:end] if line.startswith("| `")] == rows_of(TREES[tool], table), table


# The examples of CONTRIBUTING.md: each is applied to a copy of the tree, where its own test passes.


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
