"""What `make coverage` runs uncompiled is there: an hour's run would end at a name that has changed."""

from __future__ import annotations

import ast
from pathlib import Path

ARGUMENTS = 2
"""Lines before the names of tests: an option of pytest and its value."""


def defined(path: Path) -> set[str]:
    """Return the tests of a file as pytest names them, parameters left out."""
    found = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}::{each.name}" for each in node.body if isinstance(each, ast.FunctionDef)}
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.add(node.name)
    return found


def test_every_test_that_runs_uncompiled_exists(project_root: Path) -> None:
    names = (project_root / "tests" / "uncompiled.txt").read_text().splitlines()[ARGUMENTS:]
    assert len(names) == len(set(names)) > 10
    for name in names:
        file, _, test = name.partition("::")
        assert (project_root / file).is_file(), name
        assert not test or test.partition("[")[0] in defined(project_root / file), name
