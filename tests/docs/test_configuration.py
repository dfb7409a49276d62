"""docs/configuration.md says of every key what the code says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import mapq.configuration
from prf.configuration import Configuration
from prf.shell.cli.settings import Tree, note_of

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
