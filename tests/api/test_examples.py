"""docs/examples run as they stand, and what docs/python-api.md shows is cut from them."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "docs" / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(
    example: Path, data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data").symlink_to(data_dir)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(example), run_name="__main__")
    said = capsys.readouterr()
    assert said.out.count("\n") >= 2
    assert "error" not in said.err.lower()


def test_the_page_shows_what_runs(project_root: Path) -> None:
    page = (project_root / "docs" / "python-api.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    sources = [path.read_text() for path in EXAMPLES]
    assert len(blocks) >= 6
    assert [block for block in blocks if not any(block.strip() in source for source in sources)] == []
    for path in EXAMPLES:
        assert f"](examples/{path.name})" in page


def test_the_page_names_everything(project_root: Path) -> None:
    import mapq
    import prf

    page = (project_root / "docs" / "python-api.md").read_text()
    missing = [f"{tool.__name__}.{name}" for tool in (prf, mapq) for name in tool.__all__]
    assert [name for name in missing if f"`{name}" not in page] == []
