"""docs/reference is what the command lines say of themselves, so that every verb and flag stands there."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.make_reference import TOOLS, make_page


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
