"""Pictures with their words: a title above, scale and legend below, several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from prf.shell.terminal.canvas import Canvas
from prf.shell.terminal.cells import Raster, lines_of
from prf.shell.terminal.scale import scale_bar
from prf.shell.terminal.screen import Screen

if TYPE_CHECKING:
    from rich.text import Text

WORD_ROWS = 5
"""Title, small print, scale, legend and the prompt: a picture on a terminal leaves them room."""
GAP = 2
"""Columns between pictures side by side."""
PLAIN = {ord("·"): "-", ord("×"): "x", ord("…"): "..."}
"""What stands for signs of titles in ASCII."""
NARROWEST = 36
"""Columns of one of several pictures."""


def picture_rows(screen: Screen) -> int | None:
    """Return the rows that a picture with its words may take of a screen."""
    return None if screen.rows is None else max(4, screen.rows - WORD_ROWS)


def with_words(
    raster: Raster, canvas: Canvas, screen: Screen, title: str = "", small: str = "", legend: str = ""
) -> list[Text]:
    """Return the lines of a picture, with a title and small print above and scale and legend below."""
    from rich.text import Text

    parts = [part for part in (scale_bar(canvas, screen), legend) if part]
    rows = ["   ".join(parts)] if len("   ".join(parts)) <= screen.columns else parts
    above = [Text(title, "bold")] if title else []
    above += [Text(small, "dim")] if small else []
    return fitted(above, screen) + lines_of(raster, screen) + fitted([Text(row, "dim") for row in rows], screen)


def fitted(lines: Sequence[Text], screen: Screen) -> list[Text]:
    """Return words in the characters of a screen, cut where they would be too wide."""
    if not screen.blocks:
        lines = [type(line)(line.plain.translate(PLAIN)) for line in lines]
    for line in lines:
        line.truncate(screen.columns, overflow="ellipsis" if screen.blocks else "crop")
    return list(lines)


def per_row(n_pictures: int, screen: Screen) -> tuple[int, Screen]:
    """Return how many pictures stand side by side, and the screen of each: rows filled evenly."""
    most = max(1, min(n_pictures, (screen.columns + GAP) // (NARROWEST + GAP)))
    n_rows = -(-n_pictures // most)
    n_columns = -(-n_pictures // n_rows)
    return n_columns, screen._replace(columns=(screen.columns + GAP) // n_columns - GAP, rows=None)


def side_by_side(pictures: Sequence[list[Text]], n_columns: int, width: int) -> list[Text]:
    """Return pictures, each of `width` columns, so many beside one another, row below row."""
    from rich.text import Text

    lines: list[Text] = []
    for first in range(0, len(pictures), n_columns):
        row = pictures[first : first + n_columns]
        for number in range(max(map(len, row))):
            line = Text(no_wrap=True)
            for picture in row:
                part = picture[number] if number < len(picture) else Text()
                line.append_text(part)
                line.append(" " * (width + GAP - part.cell_len if picture is not row[-1] else 0))
            lines.append(line)
        if first + n_columns < len(pictures):
            lines.append(Text())
    return lines
