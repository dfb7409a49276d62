"""What a stream can show: its size, its colours, its characters."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, NamedTuple, TextIO

from prf.shell import console

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

PIPE = (80, 24)
"""Columns and rows where there is no terminal to ask."""
Colours = Literal["standard", "256", "truecolor"]


class Screen(NamedTuple):
    """What a stream can show.

    Attributes
    ----------
    columns : int
    rows : int or None
        None: as many as it takes, as in a file.
    colours : str or None
        16, 256 or all of 24 bits; None for none.
    blocks : bool
        Whether block elements and box lines may be used, or ASCII alone.
    braille : bool
        Whether braille patterns may be used too.
    """

    columns: int
    rows: int | None
    colours: Colours | None
    blocks: bool
    braille: bool


def find_screen(stream: TextIO, width: int | None = None) -> Screen:
    """Return what `stream` can show.

    Colours are those that :func:`prf.shell.console.use_color` allows and rich finds the terminal to have. Without a
    terminal there are 80 columns, unless the environment has ``COLUMNS``, and ASCII only.

    Parameters
    ----------
    stream : text file
    width : int, optional
        Columns asked for; then the height is free.
    """
    size = _size_of(stream)
    is_terminal = console.is_terminal(stream)
    colours = _colours_of(stream) if console.use_color(stream) else None
    is_unicode = (stream.encoding or "").lower().replace("-", "").startswith("utf")
    blocks = is_unicode and (is_terminal or colours is not None)
    # The console of Linux has the block elements of the IBM PC in its fonts, and no braille.
    braille = blocks and os.environ.get("TERM") != "linux"
    rows = size[1] if is_terminal and width is None else None
    return Screen(width or size[0], rows, colours, blocks, braille)


def _size_of(stream: TextIO) -> tuple[int, int]:
    """Return columns and rows; the environment's COLUMNS and LINES win, as everywhere."""
    try:
        found: tuple[int, int] = os.get_terminal_size(stream.fileno())
    except (OSError, ValueError):
        found = PIPE
    asked = (os.environ.get(name, "") for name in ("COLUMNS", "LINES"))
    columns, rows = (
        int(text) if text.isdecimal() and int(text) else size for text, size in zip(asked, found, strict=True)
    )
    return columns or PIPE[0], rows or PIPE[1]


def _colours_of(stream: TextIO) -> Colours:
    """Return how many colours rich finds; at least 16 where colour is asked for."""
    from rich.console import Console

    found = Console(file=stream, force_terminal=True).color_system
    return found if found in ("256", "truecolor") else "standard"  # type: ignore[return-value] # rich has them as text


def make_console(stream: TextIO, screen: Screen) -> Console:
    """Return rich's console that writes what `screen` says and adds nothing of its own."""
    from rich.console import Console

    return Console(
        file=stream,
        color_system=screen.colours,
        force_terminal=screen.colours is not None or None,
        no_color=screen.colours is None,
        width=screen.columns,
        highlight=False,
        markup=False,
        emoji=False,
    )


def put(lines: Iterable[Text], stream: TextIO, screen: Screen) -> None:
    """Write lines to a stream: with the escapes of their colours, or without any escape where there are none."""
    if screen.colours is None:
        code = stream.encoding or "utf-8"
        stream.writelines(f"{line.plain.rstrip()}\n".encode(code, "replace").decode(code) for line in lines)
    else:
        target = make_console(stream, screen)
        for line in lines:
            target.print(line, no_wrap=True, overflow="ignore", crop=False)
    stream.flush()
