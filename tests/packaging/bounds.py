"""The versions that the project names: bounds in pyproject.toml, the oldest and the newest that its tests ran with."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MINIMUM = Path(__file__).with_name("minimum.txt")
NEWEST = ROOT / "constraints.txt"
UNTESTED = {"all", "bench"}
"""Extras of ours that name other extras, or a rival of a gigabyte that only benchmarks use."""


def declared() -> dict[str, str]:
    """Return distribution to lower bound, of the dependencies and of the extras that tests need.

    Raises
    ------
    AssertionError
        If a requirement is anything but a lower bound.
    """
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(one for name in extras if name not in UNTESTED for one in extras[name])]
    parts = [re.fullmatch(r"([\w.-]+)>=([\d.]+)", one) for one in wanted]
    assert all(parts), wanted
    return {part[1]: part[2] for part in parts if part}


def pinned(path: Path) -> dict[str, str]:
    """Return distribution to the version that a constraints file pins it to."""
    lines = [line.partition("#")[0].strip() for line in path.read_text().splitlines()]
    return dict(line.split("==") for line in lines if line)
