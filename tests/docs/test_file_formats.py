"""docs/file-formats.md has an entry for every schema that prf and mapq write; tables of codes have every code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mapq.simulate import Kind


@pytest.mark.parametrize("tool", ["prf", "mapq"])
def test_every_schema_of_the_code_has_an_entry(project_root: Path, tool: str) -> None:
    schema = rf"{tool}\.[a-z_.]+/\d+"
    sources = (project_root / tool).rglob("*.py")
    written = {name for file in sources for name in re.findall(rf'"({schema})"', file.read_text())}
    text = (project_root / "docs" / "file-formats.md").read_text()
    entries = set(re.findall(rf"^\|[^|]*\| `({schema})` \|", text, flags=re.MULTILINE))
    assert len(written) > 10
    assert written - entries == set(), "without a row | ... | `schema` | in a table of docs/file-formats.md"
    assert entries - written == set(), "of no file or object that the code writes"


def test_every_kind_of_a_simulated_point_is_in_its_table(project_root: Path) -> None:
    text = (project_root / "docs" / "simulator.md").read_text()
    assert {int(code) for code in re.findall(r"\| (\d+) \| [a-z]", text)} == set(Kind)
