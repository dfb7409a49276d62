"""What a value of a settings file may be: each kind reads what TOML gives, or says in words what it must be."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

LARGEST_WHOLE = 2**53
"""Beyond it floats leave some out, and arrays of numpy take none of much larger ones."""


class Kind(Protocol):
    """A kind of values."""

    def read(self, value: Any) -> Any:
        """Return the value in our types; raise ValueError with words that go on after "must be" for any other."""


def is_number(value: Any) -> bool:
    """Return whether a value is a finite number; a truth value is none."""
    try:
        return not isinstance(value, bool) and math.isfinite(value)
    except (TypeError, OverflowError):
        return False


@dataclass(frozen=True)
class Number:
    """A finite number."""

    def read(self, value: Any) -> float:
        """Return it as a float."""
        if not is_number(value):
            raise ValueError("a finite number")
        return float(value)


@dataclass(frozen=True)
class Whole:
    """A whole number; 16.0 is one."""

    def read(self, value: Any) -> int:
        """Return it as an int."""
        if not is_number(value) or value != int(value) or abs(value) > LARGEST_WHOLE:
            raise ValueError("a whole number")
        return int(value)


@dataclass(frozen=True)
class Flag:
    """A truth value."""

    def read(self, value: Any) -> bool:
        """Return it as it is."""
        if not isinstance(value, bool):
            raise ValueError("true or false")
        return value


@dataclass(frozen=True)
class Array:
    """An array of `length` finite numbers."""

    length: int

    def read(self, value: Any) -> tuple[float, ...]:
        """Return it as a tuple of floats."""
        if not (isinstance(value, list | tuple) and len(value) == self.length and all(map(is_number, value))):
            raise ValueError(f"an array of {self.length} finite numbers")
        return tuple(map(float, value))


@dataclass(frozen=True)
class Word:
    """One of some words."""

    choices: tuple[str, ...]

    def read(self, value: Any) -> str:
        """Return the word."""
        if value not in self.choices:
            raise ValueError(" or ".join(map(repr, self.choices)))
        return str(value)


@dataclass(frozen=True)
class Words:
    """An array of words; of those of `choices`, unless there are none to choose from."""

    choices: tuple[str, ...] = ()

    def read(self, value: Any) -> tuple[str, ...]:
        """Return them as a tuple."""
        words: list[Any] = list(value) if isinstance(value, list | tuple) else [None]
        if not all(isinstance(word, str) and (not self.choices or word in self.choices) for word in words):
            raise ValueError(f"an array of words{' from ' if self.choices else ''}{', '.join(self.choices)}")
        return tuple(words)


def instead(name: str, known: Iterable[str]) -> str:
    """Return what may have been meant by a name that is none of `known`."""
    names = list(known)
    close = difflib.get_close_matches(name.replace("-", "_").lower(), names, n=1)
    close = close or difflib.get_close_matches(name.lower(), names, n=1)
    return f"Did you mean {close[0]}?" if close else f"Known are {', '.join(names)}."
