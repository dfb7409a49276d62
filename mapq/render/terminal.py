"""Maps as text for a terminal: plausible blue and suspicious red, or a character for each (docs/terminal.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mapq.render.colours import Scheme
from mapq.render.source import Picture
from mapq.render.views import Bounds, axonometric
from prf.shell.terminal import Canvas, Raster, Screen, picture_rows, with_words

if TYPE_CHECKING:
    from rich.text import Text

MARGIN = 0.0
PAPER = 255.0
"""What is painted where no point lies, as on the other pictures."""
ASCII_LETTERS = {"plausible": "o", "suspicious": "#", "doubtful": "+", "unlabelled": "?", "no patch": "."}
BLOCK_LETTERS = {"plausible": "░", "suspicious": "█", "doubtful": "▒", "unlabelled": "?", "no patch": "·"}
PATCH_LETTERS = "abcdefghijklmnopqrstuvwxyz"
"""Of patches where each has its own colour; those of near ones differ as a rule, as their colours do."""


def picture_lines(
    picture: Picture, screen: Screen, *, title: str | None = None, view: tuple[float, float] | None = None
) -> list[Text]:
    """Return the plan view of a map for a terminal, or its view in 3D.

    Of the points in one pixel the most suspicious one is seen, in 3D the nearest.

    Parameters
    ----------
    picture : Picture
    screen : Screen
    title : str, optional
        Instead of the picture's.
    view : (float, float), optional
        Azimuth and elevation in degrees: 3D.
    """
    finite = np.isfinite(picture.xyz).all(axis=1)
    xyz, scheme = picture.xyz[finite], picture.scheme
    rgb, rank = scheme.rgb[finite], scheme.layer[finite].astype(np.float64)
    xy = xyz[:, :2]
    if view is not None:
        xy, rank = axonometric(xyz, *view)
    bounds = Bounds.around(xy, MARGIN) if len(xy) else Bounds(0.0, 0.0, 1.0, 1.0)
    canvas = Canvas.fit(bounds, screen.columns, picture_rows(screen))
    image, seen = _painted(canvas, xy, rgb, rank)
    painted = np.where(np.isfinite(image), 255.0 * image, PAPER)
    raster = Raster(painted, _letters(image, seen, scheme, screen))
    return with_words(raster, canvas, screen, title or picture.title, picture.subtitle, _legend(scheme, screen))


def _painted(
    canvas: Canvas, xy: NDArray[np.float64], rgb: NDArray[np.float32], rank: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the colours (2 rows, columns, 3) of the points of highest rank in the pixels, and that rank; nan: none."""
    image, seen = np.full((*canvas.shape, 3), np.nan), np.full(canvas.shape, -np.inf)
    row, column = canvas.places(xy)
    inside = np.flatnonzero(row >= 0)
    order = inside[np.argsort(rank[inside], kind="stable")]
    image[row[order], column[order]] = rgb[order]
    seen[row[order], column[order]] = rank[order]
    return image, seen


def _letters(image: NDArray[np.float64], seen: NDArray[np.float64], scheme: Scheme, screen: Screen) -> NDArray[np.str_]:
    """Return a character for every two pixels: that of the one of higher rank."""
    below = seen[1::2] > seen[::2]
    colour = np.where(below[:, :, None], image[1::2], image[::2])
    known = np.isfinite(colour[:, :, 0])
    named = np.array([entry[1] for entry in scheme.legend])
    letters = np.array([_letter(entry[0], screen) for entry in scheme.legend])
    apart = np.abs(np.where(known[:, :, None], colour, 0.0)[:, :, None, :] - named).sum(axis=3)
    found = letters[apart.argmin(axis=2)]
    if _is_by_patch(scheme):
        number = (np.nan_to_num(colour) @ np.array([977.0, 563.0, 311.0])).astype(np.int64) % len(PATCH_LETTERS)
        found = np.where(apart.min(axis=2) < 1e-3, found, np.array(list(PATCH_LETTERS))[number])
    return np.where(known, found, " ")


def _is_by_patch(scheme: Scheme) -> bool:
    """Return whether the legend leaves the colours of patches out, since each has its own."""
    return len(scheme.legend) == 1


def _letter(name: str, screen: Screen) -> str:
    letters = BLOCK_LETTERS if screen.blocks else ASCII_LETTERS
    return letters[name.removeprefix("surely ")]


def _legend(scheme: Scheme, screen: Screen) -> str:
    """Return what the characters mean, or the colours in words."""
    if screen.colours is None:
        return "   ".join(f"{_letter(name, screen)} {name}" for name, _ in scheme.legend)
    return "" if _is_by_patch(scheme) else "blue plausible   red suspicious"
