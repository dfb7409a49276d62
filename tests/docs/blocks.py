"""Blocks of commands in the pages.

A block is fenced as `sh` or `console`, or indented, and begins with a command of `STARTS`. In a console block, lines
after `$ ` are commands and the others what they print; `...` there stands for anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

STARTS = ("prf", "mapq", "make", "python", "pip", "dask", "printf", "cat", "cp", "mkdir", "for")


class Command(NamedTuple):
    """A command of a page, and what the page shows as its output (None: nothing)."""

    place: str
    text: str
    shown: str | None


def commands_of(page: Path, name: str) -> list[Command]:
    """Return the commands of a page in order; a backslash at the end of a line continues it."""
    found: list[Command] = []
    for number, kind, lines in _blocks(page.read_text().splitlines()):
        if kind == "console":
            found += _console(name, number, lines)
        elif lines and lines[0].split(" ")[0] in STARTS:
            joined = "\n".join(lines).replace("\\\n", " ").splitlines()
            found += [Command(f"{name}:{number}", line.strip(), None) for line in joined if line.strip()]
    return found


def _blocks(lines: list[str]) -> Iterator[tuple[int, str, list[str]]]:
    """Yield first line, kind (console, sh or indented) and lines of each block."""
    number = 0
    while number < len(lines):
        if lines[number].startswith("```"):
            end = next(k for k in range(number + 1, len(lines)) if lines[k].startswith("```"))
            kind = lines[number][3:].strip()
            if kind in ("sh", "console"):
                yield number + 2, kind, lines[number + 1 : end]
            number = end + 1
        elif lines[number].startswith("    ") and (number == 0 or not lines[number - 1].strip()):
            end = number
            while end < len(lines) and lines[end].startswith("    "):
                end += 1
            yield number + 1, "indented", [line[4:] for line in lines[number:end]]
            number = end
        else:
            number += 1


def _console(name: str, number: int, lines: list[str]) -> Iterator[Command]:
    texts = "\n".join(lines).replace("\\\n", " ")
    for part in re.split(r"^\$ ", texts, flags=re.MULTILINE)[1:]:
        text, _, shown = part.partition("\n")
        yield Command(f"{name}:{number}", text.strip(), shown.rstrip() or None)


FRACTION = 0.2
NUMBER = re.compile(r"(?<![A-Za-z_])-?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")


def differences(shown: str, printed: str, share: float) -> str | None:
    """Compare what a page shows with what was printed; None if words agree and numbers do within `share`.

    Fractions up to 1 may differ by `FRACTION`: they are shares of a few draws.
    """
    pattern, expected = "", []
    for piece in re.split(r"(\.\.\.)", shown):
        if piece == "...":
            pattern += ".*?"
            continue
        at = 0
        for match in NUMBER.finditer(piece):
            pattern += _words(piece[at : match.start()]) + f"({NUMBER.pattern})"
            expected.append(match[0])
            at = match.end()
        pattern += _words(piece[at:])
    match = re.fullmatch(r"\s*" + pattern + r"\s*", printed, flags=re.DOTALL)
    if match is None:
        return f"shown:\n{shown}\nprinted:\n{printed}"
    for one, other in zip(expected, match.groups(), strict=True):
        low, high = sorted(float(number.replace(",", "")) for number in (one, other))
        is_fraction = "." in one and low >= 0.0 and high <= 1.0
        if high - low > (FRACTION if is_fraction else share * max(abs(low), abs(high))):
            return f"shown {one}, printed {other} in:\n{printed}"
    return None


def _words(text: str) -> str:
    """Return a pattern of text in which blanks may be of any length."""
    return r"\s+".join(re.escape(word) for word in re.split(r"\s+", text))
