"""Pixels and lines as characters: half blocks and braille in colours, or one character a cell without any."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.shell.terminal.screen import Screen

if TYPE_CHECKING:
    from rich.style import Style
    from rich.text import Text

UPPER, LOWER = "\N{UPPER HALF BLOCK}", "\N{LOWER HALF BLOCK}"
BRAILLE = 0x2800
"""The pattern without dots; each dot is a bit."""
BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bit of the dot in each row and column of a pattern."""

RGB = tuple[int, int, int]


class Layer(NamedTuple):
    """Lines or points over a raster.

    Attributes
    ----------
    dots : (4 rows, 2 columns) bool
        Those of braille patterns.
    rgb : tuple of int
        Their colour, 0 to 255.
    letter : str
        Stands for them in ASCII.
    """

    dots: NDArray[np.bool_]
    rgb: RGB
    letter: str


class Raster(NamedTuple):
    """A picture of so many rows and columns of cells.

    Attributes
    ----------
    rgb : (2 rows, columns, 3) float
        Colours of the pixels from the top, 0 to 255; nan where nothing is painted.
    letters : (rows, columns) str
        What stands for them without colours.
    layers : tuple of Layer
        Over them; the last one counts where several have dots.
    """

    rgb: NDArray[np.floating]
    letters: NDArray[np.str_]
    layers: tuple[Layer, ...] = ()


def lines_of(raster: Raster, screen: Screen) -> list[Text]:
    """Return the picture as lines of text, styled where the screen has colours."""
    from rich.text import Text

    cells = _coloured(raster, screen) if screen.colours is not None else _plain(raster, screen)
    lines = []
    for row in cells:
        line = Text(no_wrap=True)
        for characters, style in _runs(row):
            line.append(characters, style)
        lines.append(line)
    return lines


Cell = tuple[str, "Style | None"]


def _plain(raster: Raster, screen: Screen) -> list[list[Cell]]:
    letters = raster.letters.copy()
    for layer in raster.layers:
        patterns = _patterns(layer.dots)
        for row, column in np.argwhere(patterns > 0):
            letters[row, column] = chr(BRAILLE + patterns[row, column]) if screen.braille else layer.letter
    return [[(letter, None) for letter in row] for row in letters.tolist()]


def _coloured(raster: Raster, screen: Screen) -> list[list[Cell]]:
    known = np.isfinite(raster.rgb).all(axis=2)
    whole = np.where(known[:, :, None], np.clip(np.round(raster.rgb), 0, 255), -1).astype(np.int64).tolist()
    cells = [
        [_half_blocks(tuple(above), tuple(below), screen.blocks) for above, below in zip(*pair, strict=True)]
        for pair in zip(whole[::2], whole[1::2], strict=True)
    ]
    for layer in raster.layers:
        patterns = _patterns(layer.dots)
        for row, column in np.argwhere(patterns > 0).tolist():
            behind = _mixed(whole[2 * row][column], whole[2 * row + 1][column])
            letter = chr(BRAILLE + patterns[row, column]) if screen.braille else layer.letter
            cells[row][column] = (letter, _style(layer.rgb, behind))
    return cells


def _half_blocks(above: tuple[int, ...], below: tuple[int, ...], blocks: bool) -> Cell:
    """Return one cell of two pixels; negative ones are not painted."""
    if above == below:
        return " ", _style(None, None if above[0] < 0 else above)
    if not blocks:
        mixed = _mixed(list(above), list(below))
        return " ", _style(None, mixed)
    if above[0] < 0:
        return LOWER, _style(below, None)
    return UPPER, _style(above, None if below[0] < 0 else below)


def _mixed(above: list[int], below: list[int]) -> tuple[int, ...] | None:
    """Return the colour half way between two pixels, of those that are painted."""
    painted = [pixel for pixel in (above, below) if pixel[0] >= 0]
    if not painted:
        return None
    return tuple(sum(channel) // len(painted) for channel in zip(*painted, strict=True))


@functools.lru_cache(maxsize=65536)
def _style(front: tuple[int, ...] | None, behind: tuple[int, ...] | None) -> Style | None:
    from rich.color import Color
    from rich.style import Style

    if front is None and behind is None:
        return None
    return Style(
        color=None if front is None else Color.from_rgb(*front),
        bgcolor=None if behind is None else Color.from_rgb(*behind),
    )


def _patterns(dots: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the number (rows, columns) of the braille pattern of every cell, 0 for none."""
    rows, columns = dots.shape[0] // 4, dots.shape[1] // 2
    parts = dots.reshape(rows, 4, columns, 2)
    patterns: NDArray[np.int64] = np.einsum("ricj,ij->rc", parts.astype(np.int64), BITS)
    return patterns


def _runs(cells: list[Cell]) -> list[tuple[str, Style | None]]:
    """Return neighbours of one style as one."""
    runs: list[tuple[str, Style | None]] = []
    for letter, style in cells:
        if runs and runs[-1][1] is style:
            runs[-1] = (runs[-1][0] + letter, style)
        else:
            runs.append((letter, style))
    return runs
