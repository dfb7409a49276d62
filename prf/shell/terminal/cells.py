"""Pixels and lines as characters: half blocks and braille in colours, or one character a cell without any."""

from __future__ import annotations

import functools
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.shell.terminal.screen import Screen

if TYPE_CHECKING:
    from rich.color import Color
    from rich.style import Style
    from rich.text import Text

UPPER, LOWER = "\N{UPPER HALF BLOCK}", "\N{LOWER HALF BLOCK}"
BRAILLE = 0x2800
"""The pattern without dots; each dot is a bit."""
BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bit of the dot in each row and column of a pattern."""

WEIGHTS = np.array([0x10000, 0x100, 1])
"""By which red, green and blue make one number."""
NOTHING = -1
"""What stands in its place where nothing is painted."""

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
    if screen.colours is None:
        return _plain(raster, screen)
    return _coloured(raster, screen)


def _plain(raster: Raster, screen: Screen) -> list[Text]:
    from rich.text import Text

    letters = raster.letters.copy()
    for layer in raster.layers:
        _write(letters, layer, screen)
    return [Text("".join(row), no_wrap=True) for row in letters.tolist()]


def _write(letters: NDArray[np.str_], layer: Layer, screen: Screen) -> NDArray[np.bool_]:
    """Write the characters of a layer over others; return where there are any."""
    patterns = _patterns(layer.dots)
    drawn: NDArray[np.bool_] = patterns > 0
    if screen.braille:
        letters[drawn] = (BRAILLE + patterns[drawn]).astype(np.uint32).view("<U1")
    else:
        letters[drawn] = layer.letter
    return drawn


def _coloured(raster: Raster, screen: Screen) -> list[Text]:
    """Return half blocks and lines: as runs of equal colours, since every change of colour takes time and bytes."""
    above, below = _packed(raster.rgb[::2]), _packed(raster.rgb[1::2])
    mixed = _packed(_mean(raster.rgb[::2], raster.rgb[1::2]))
    if not screen.blocks:
        above = below = mixed
    letters = np.where(above == below, " ", np.where(above == NOTHING, LOWER, UPPER))
    front = np.where(above == below, NOTHING, np.where(above == NOTHING, below, above))
    behind = np.where((above == below) | (above != NOTHING), below, NOTHING)
    for layer in raster.layers:
        drawn = _write(letters, layer, screen)
        front[drawn], behind[drawn] = _pack(layer.rgb), mixed[drawn]
    return [_line(*row) for row in zip(letters, front, behind, strict=True)]


def _line(letters: NDArray[np.str_], front: NDArray[np.int64], behind: NDArray[np.int64]) -> Text:
    """Return a row of cells (columns,) as text, a span for every run of one style."""
    from rich.text import Span, Text

    starts = np.flatnonzero(np.diff(front, prepend=-2) | np.diff(behind, prepend=-2)).tolist()
    spans = [
        Span(start, end, style)
        for start, end in pairwise([*starts, len(letters)])
        if (style := _style(int(front[start]), int(behind[start]))) is not None
    ]
    return Text("".join(letters.tolist()), no_wrap=True, spans=spans)


def _packed(rgb: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return colours (rows, columns, 3) as one number each, `NOTHING` where they are nan."""
    known = np.isfinite(rgb).all(axis=2)
    whole = np.clip(np.round(np.where(known[:, :, None], rgb, 0.0)), 0, 255).astype(np.int64)
    packed: NDArray[np.int64] = np.where(known, whole @ WEIGHTS, NOTHING)
    return packed


def _pack(rgb: RGB) -> int:
    return int(np.array(rgb) @ WEIGHTS)


def _mean(above: NDArray[np.floating], below: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the colours half way between two pixels, of those that are painted."""
    known = np.isfinite(above), np.isfinite(below)
    return np.where(known[0], np.where(known[1], 0.5 * (above + below), above), below)


@functools.lru_cache(maxsize=65536)
def _style(front: int, behind: int) -> Style | None:
    from rich.style import Style

    if front == behind == NOTHING:
        return None
    return Style(color=_colour(front), bgcolor=_colour(behind))


def _colour(packed: int) -> Color | None:
    from rich.color import Color

    return None if packed == NOTHING else Color.from_rgb(*packed.to_bytes(3, "big"))


def _patterns(dots: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the number (rows, columns) of the braille pattern of every cell, 0 for none."""
    rows, columns = dots.shape[0] // 4, dots.shape[1] // 2
    parts = dots.reshape(rows, 4, columns, 2)
    patterns: NDArray[np.int64] = np.einsum("ricj,ij->rc", parts.astype(np.int64), BITS)
    return patterns
