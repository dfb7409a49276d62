"""Applies the examples of CONTRIBUTING.md: blocks fenced as diff, without line numbers."""

from __future__ import annotations

import re
from pathlib import Path


def examples_of(page: str) -> dict[str, str]:
    """Return the example under each heading."""
    found = {}
    for section in re.split(r"^### ", page, flags=re.MULTILINE)[1:]:
        title, _, text = section.partition("\n")
        if "```diff\n" in text:
            found[title] = text.partition("```diff\n")[2].partition("\n```")[0]
    return found


def files_of(diff: str) -> list[str]:
    return re.findall(r"^--- (\S+)$", diff, flags=re.MULTILINE)


def apply_to(root: Path, diff: str) -> None:
    """Replace in each file what a part shows as there by what it shows as to be; each must stand there once."""
    for name, body in re.findall(r"^--- (\S+)\n(.*?)(?=^--- |\Z)", diff + "\n", flags=re.MULTILINE | re.DOTALL):
        path = root / name
        text = path.read_text() if path.exists() else ""
        for part in re.split(r"^@@\n", body, flags=re.MULTILINE)[1:]:
            lines = part.splitlines()
            old = "".join(line[1:] + "\n" for line in lines if line[:1] in " -")
            new = "".join(line[1:] + "\n" for line in lines if line[:1] in " +")
            if path.exists():
                old, new = old.removesuffix("\n"), new.removesuffix("\n")
                assert text.count(old) == 1, f"{name}: {text.count(old)} times: {old}"
            text = text.replace(old, new) if path.exists() else new
        path.write_text(text)
