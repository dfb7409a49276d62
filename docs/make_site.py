"""Builds the searchable site of the documentation in build/site, and tutorials as notebooks in it: `make docs`.

Pages are staged in build/pages as they lie in the repository, so that their links are the same on a code host and here.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
PAGES = ROOT / "build" / "pages"
TUTORIALS = ROOT / "docs" / "tutorials"
STAGED = ("*.md", "LICENSE", "CITATION.cff", "docs/images/*", "docs/examples/*", "docs/tutorials/*")
FENCE = re.compile(r"^```(console|sh)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)


def notebook_of(page: Path) -> dict[str, Any]:
    """Return a tutorial as a notebook: its commands as cells of a shell, with the output that the page shows."""
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    cells = [{**cell, "id": f"cell-{number}"} for number, cell in enumerate(_cells(page.read_text()))]
    return {"nbformat": 4, "nbformat_minor": 5, "metadata": {"kernelspec": kernel}, "cells": cells}


def _cells(text: str) -> Iterator[dict[str, Any]]:
    at = 0
    for block in FENCE.finditer(text):
        yield _words(text[at : block.start()])
        at = block.end()
        parts = re.split(r"^\$ ", block[2], flags=re.MULTILINE)[1:] if block[1] == "console" else [block[2]]
        commands, shown = zip(*(_parted(part) if block[1] == "console" else (part, "") for part in parts), strict=True)
        code, printed = "".join(commands).strip(), "".join(shown)
        strict = "" if "echo $?" in code else " -e"  # a command is to fail there
        outputs = [{"output_type": "stream", "name": "stdout", "text": printed}] if printed else []
        yield {
            "cell_type": "code",
            "execution_count": None,
            "metadata": {},
            "source": f"%%bash{strict}\n{code}",
            "outputs": outputs,
        }
    yield _words(text[at:])


def _parted(part: str) -> tuple[str, str]:
    """Return a command, which a backslash continues, and what the page shows as its output."""
    lines = part.splitlines(keepends=True)
    n = next((k for k, line in enumerate(lines) if not line.endswith("\\\n")), len(lines) - 1) + 1
    return "".join(lines[:n]), "".join(lines[n:])


def _words(text: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "metadata": {}, "source": text.strip()}


def stage() -> None:
    """Copy what is tracked of the pages and what they show, and write the notebooks beside their tutorials."""
    shutil.rmtree(PAGES, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "--", *STAGED], cwd=ROOT, check=True, capture_output=True, text=True)
    for name in filter(lambda name: not name.startswith("tests/"), listed.stdout.splitlines()):
        (PAGES / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, PAGES / name)
    for page in TUTORIALS.glob("*.md"):
        copy = PAGES / page.relative_to(ROOT)
        copy.with_suffix(".ipynb").write_text(json.dumps(notebook_of(page), indent=1))
        title, _, rest = page.read_text().partition("\n")
        copy.write_text(f"{title}\n\n[This page as a notebook]({page.stem}.ipynb)\n{rest}")


def main() -> None:
    """Build the site; stop where a link leads nowhere."""
    stage()
    command = [sys.executable, "-m", "mkdocs", "build", "--config-file", str(Path(__file__).parent / "mkdocs.yml")]
    code = subprocess.run(command, check=False).returncode
    if code:
        sys.exit(code)
    print("python -m http.server -d build/site    serves it: the search needs a server")


if __name__ == "__main__":
    main()
