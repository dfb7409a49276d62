"""Links within a page or into another lead to a heading that is there, named as code hosts name it."""

from __future__ import annotations

import re
from pathlib import Path

from tests.docs.test_commands import pages

LINK = re.compile(r"\]\(([^)#\s]*)#([^)]+)\)")


def anchors_of(page: Path) -> set[str]:
    """Return the anchors of the headings: lower case, punctuation left out, blanks as hyphens."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    found = set()
    for heading in re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        found.add(re.sub(r"[^\w\- ]", "", words).strip().replace(" ", "-"))
    return found


def test_links_lead_to_headings(project_root: Path) -> None:
    broken = []
    for page in pages(project_root):
        for target, anchor in LINK.findall(page.read_text()):
            if "://" not in target and anchor not in anchors_of(page.parent / target if target else page):
                broken.append(f"{page.relative_to(project_root)} -> {target}#{anchor}")
    assert broken == []


def test_every_page_is_in_the_index(project_root: Path) -> None:
    docs = project_root / "docs"
    index = (docs / "README.md").read_text()
    for page in sorted(docs.rglob("*.md")):
        name = page.relative_to(docs).as_posix()
        assert name == "README.md" or name.startswith("adr/") or f"]({name}" in index, f"docs/README.md: {name}"
