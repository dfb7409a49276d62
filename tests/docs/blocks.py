"""Blocks of commands in the pages, and what a page says of how tests run them.

A block is fenced as `sh` or `console`, or indented, with a command of `STARTS` in its first line. In a console block
lines after `$ ` are commands and the others what they print; `...` there stands for anything. A page may hold a comment

    <!-- In tests:
    with `prf sample`: --steps 10000
    not `pip`: packages are there
    exit 1 `mapq compare`: the page is about that
    -->

The first kind of line adds options to every command that begins so, in place of their values there; the second leaves
it out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

STARTS = ("prf", "mapq", "make", "python", "pip", "dask", "printf", "cat", "cp", "mkdir", "for")
COMMENT = re.compile(r"<!-- In tests:\n(.*?)-->", re.DOTALL)
RULE = re.compile(r"^(with|not|exit (?P<code>\d+)) `(?P<start>[^`]+)`: (?P<text>.+)$")


class Command(NamedTuple):
    """A command of a page, and what the page shows that it prints (None: nothing is said)."""

    place: str
    text: str
    shown: str | None


class Rules(NamedTuple):
    """What a page says of how tests run it: by the beginnings of commands."""

    added: dict[str, list[str]]
    left_out: dict[str, str]
    codes: dict[str, int]

    def is_left_out(self, command: str) -> bool:
        return any(begins(command, start) for start in self.left_out)

    def options_of(self, command: str) -> list[str]:
        return next((words for start, words in self.added.items() if begins(command, start)), [])

    def code_of(self, command: str) -> int:
        return next((code for start, code in self.codes.items() if begins(command, start)), 0)


def begins(command: str, start: str) -> bool:
    return command == start or command.startswith(start + " ")


def rules_of(text: str) -> Rules:
    rules = Rules({}, {}, {})
    for comment in COMMENT.findall(text):
        for line in comment.strip().splitlines():
            match = RULE.match(line)
            assert match, f"no rule: {line}"
            if match[1] == "with":
                rules.added[match["start"]] = match["text"].split()
            elif match[1] == "not":
                rules.left_out[match["start"]] = match["text"]
            else:
                rules.codes[match["start"]] = int(match["code"])
    return rules


def commands_of(page: Path, name: str) -> list[Command]:
    """Return the commands of a page in order; a line that ends on a backslash goes on in the next."""
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

    Of fractions up to 1 a distance of `FRACTION` is let pass: they are counted in draws of chains.
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
