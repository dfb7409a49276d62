"""docs/file-formats.md has an entry for every schema that prf writes."""

from __future__ import annotations

import re
from pathlib import Path


def test_every_schema_of_the_code_has_an_entry(project_root: Path) -> None:
    sources = (project_root / "prf").rglob("*.py")
    written = {name for file in sources for name in re.findall(r'"(prf\.[a-z_.]+/\d+)"', file.read_text())}
    text = (project_root / "docs" / "file-formats.md").read_text()
    entries = set(re.findall(r"^\|[^|]*\| `(prf\.[a-z_.]+/\d+)` \|", text, flags=re.MULTILINE))
    assert len(written) > 10
    assert written - entries == set(), "without a row | ... | `schema` | in a table of docs/file-formats.md"
    assert entries - written == set(), "of no file or object that the code writes"
