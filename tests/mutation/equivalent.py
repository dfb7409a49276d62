"""The mistakes that change no number, each with the reason why."""

from __future__ import annotations

import tomllib
from pathlib import Path

LIST = Path(__file__).with_name("equivalent.toml")


def read_equivalent(module: str) -> dict[str, str]:
    """Return mistake to reason, for one module.

    The file has tables ``[[module]]`` with ``reason`` and ``mistakes``, spelled as ``python -m tests.mutation`` prints
    them.
    """
    with LIST.open("rb") as file:
        tables = tomllib.load(file)
    return {mistake: table["reason"] for table in tables.get(module, []) for mistake in table["mistakes"]}
