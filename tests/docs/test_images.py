"""Pictures of the pages are small, and each is shown somewhere."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.docs.test_commands import pages

MOST_BYTES = 200_000


def test_pictures_are_small_and_shown(project_root: Path) -> None:
    text = "".join(page.read_text() for page in pages(project_root))
    for picture in sorted((project_root / "docs" / "images").iterdir()):
        assert picture.stat().st_size <= MOST_BYTES, picture.name
        assert f"images/{picture.name})" in text, f"{picture.name} is on no page"


def test_routes_of_the_picture_are_those_of_the_tutorial(project_root: Path) -> None:
    source = ast.parse((project_root / "docs" / "make_figures.py").read_text())
    routes = next(node.value for node in source.body if isinstance(node, ast.Assign) and node.targets[0].id == "ROUTES")
    tutorial = (project_root / "docs" / "tutorials" / "prf.md").read_text()
    for corners, _ in ast.literal_eval(routes).values():
        assert "".join(rf"\n{x},{y}" for x, y in corners) in tutorial
