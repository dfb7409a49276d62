"""What all pictures of both tools share: colours, a page laid out in inches, metre axes, scale bar, captions, saving.

A page is laid out by hand, since the automatic layouts of matplotlib leave axes of equal aspect swimming in space.
Only objects are used, no pyplot: nothing here is global, and no display is looked for.
"""

from __future__ import annotations

import base64
import html
import io
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import IO, TYPE_CHECKING, Any, Protocol

from prf.shell.cli.files import open_output
from prf.shell.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class _Extent(Protocol):
    """A window: its bounds and its size, in metres."""

    @property
    def x_min(self) -> float: ...
    @property
    def x_max(self) -> float: ...
    @property
    def y_min(self) -> float: ...
    @property
    def y_max(self) -> float: ...
    @property
    def width(self) -> float: ...
    @property
    def height(self) -> float: ...


Target = str | os.PathLike[str] | IO[bytes]
"""Target of a picture: a path (atomic; ``-`` is standard output) or an open binary file (as PNG)."""

INK = "#1f2328"
"""Text and occupied area: near black, which prints softer than pure black."""
MUTED = "#6a737d"
FRAME = "#8b949e"
BETWEEN, LINE, CHARACTERS = "  ·  ", 11.0, 16.0
"""Between parts of the small print; points from line to line; characters in an inch, few enough for wide ones."""
OUTLINE = "#e8590c"
"""Outlines of a map: the orange that stands out on white, mid-grey and black alike."""
PATH = "#1971c2"
BEAM = "#4dabf7"
IMPACT = "#c92a2a"
DIFFERS = "#9c36b5"
UNSEEN = "#f6e7d8"
"""Cells that are unknown in a file."""
HATCH = "#b58a5f"
"""Of cells that no reading saw."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue, 0 to 255, of a colour such as ``#e8590c``."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


NO_LETTERS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
"""What fonts and XML cannot show: control characters but the end of a line, bytes of names that are not UTF-8."""
DPI = 160
FORMATS = ("png", "svg", "pdf")
LARGEST_WIDTH = 9.0
LARGEST_HEIGHT = 7.2  # inches of the drawn window; a page is a little larger
LARGEST_COPY = 70_000
"""Bytes of the picture of a card: a notebook keeps every card that it shows."""


@dataclass(frozen=True)
class Margins:
    """Space around the drawn window in inches."""

    left: float
    right: float = 0.3
    bottom: float = 0.75
    top: float = 0.75


def margins_of(window: _Extent, right: float = 0.3) -> Margins:
    """Return the margins of a page with one window: coordinates of many digits need more space at the left."""
    digits = len(f"{max(abs(window.y_min), abs(window.y_max)):.0f}")
    return Margins(left=0.7 + 0.07 * max(0, digits - 2), right=right)


def drawn_size(window: _Extent, width: float = LARGEST_WIDTH, height: float = LARGEST_HEIGHT) -> tuple[float, float]:
    """Return width and height in inches of the largest picture of `window` within the given ones, aspect kept.

    A corridor of extreme aspect still gets half an inch across.
    """
    scale = min(width / window.width, height / window.height)
    return max(0.5, window.width * scale), max(0.5, window.height * scale)


def new_page(width: float, height: float) -> Figure:
    """Return an empty white page of this many inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), facecolor="white")


def add_axes(page: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Return axes at a place given in inches from the lower left corner of the page."""
    page_width, page_height = page.get_size_inches()
    return page.add_axes((left / page_width, bottom / page_height, width / page_width, height / page_height))


def map_page(window: _Extent, margins: Margins, title: str, subtitle: str) -> tuple[Figure, Axes]:
    """Return a page with one window on metre axes, titled, with a scale bar below."""
    width, height = drawn_size(window)
    wide = max(width + margins.right, 4.8)  # room for a title above a narrow window
    subtitle = in_lines(subtitle, wide)
    top = margins.top + subtitle.count("\n") * LINE / 72.0
    page = new_page(margins.left + wide, margins.bottom + height + top)
    axes = add_axes(page, margins.left, margins.bottom, width, height)
    show_window(axes, window)
    metre_axes(axes, width, height)
    scale_bar(axes, window, width, below=0.5)
    add_title(axes, title, subtitle)
    return page, axes


def show_window(axes: Axes, window: _Extent) -> None:
    """Set the limits to the window, and frame it thinly."""
    axes.set_xlim(window.x_min, window.x_max)
    axes.set_ylim(window.y_min, window.y_max)
    axes.set_facecolor("white")
    for spine in axes.spines.values():
        spine.set(color=FRAME, linewidth=0.8, zorder=5)


def metre_axes(axes: Axes, width: float, height: float) -> None:
    """Label both axes in metres with plain numbers, as many as fit axes of this many inches."""
    from matplotlib.ticker import MaxNLocator

    axes.set_xlabel("x (m)", color=MUTED, fontsize=9)
    axes.set_ylabel("y (m)", color=MUTED, fontsize=9)
    axes.tick_params(colors=MUTED, labelsize=8, color=FRAME, width=0.8, length=3)
    axes.ticklabel_format(style="plain", useOffset=False)
    digits = len(f"{max(map(abs, axes.get_xlim())):.0f}")
    for axis, inches, needed in ((axes.xaxis, width, 0.5 + 0.07 * digits), (axes.yaxis, height, 0.35)):
        axis.set_major_locator(MaxNLocator(nbins=max(1, min(8, int(inches / needed))), steps=[1, 2, 5, 10]))


def bare_axes(axes: Axes) -> None:
    """Leave out ticks and labels."""
    axes.set_xticks([])
    axes.set_yticks([])


def round_length(limit: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is at most `limit`."""
    power = 10.0 ** math.floor(math.log10(limit) + 1e-9)
    return max(digit * power for digit in (1, 2, 5) if digit * power <= limit * (1 + 1e-9))


def scale_bar(axes: Axes, window: _Extent, width: float, below: float) -> None:
    """Draw a bar of round length under the right end of axes `width` inches wide, `below` inches down.

    There it hides nothing. It takes a fifth of the width, more where that would be too short to see.
    """
    from matplotlib.transforms import ScaledTranslation, blended_transform_factory

    length = round_length(window.width * min(0.6, max(0.2, 0.6 / width)))
    shift = ScaledTranslation(0.0, -below, axes.get_figure().dpi_scale_trans)  # type: ignore[union-attr]
    place = blended_transform_factory(axes.transData, axes.transAxes) + shift
    ends = [window.x_max - length, window.x_max]
    style: dict[str, Any] = {"color": INK, "transform": place, "clip_on": False}
    axes.plot(ends, [0.0, 0.0], linewidth=2.2, solid_capstyle="butt", **style)
    axes.text(ends[0], 0.0, f"{length:g} m  ", ha="right", va="center_baseline", fontsize=8.5, **style)


def in_lines(subtitle: str, width: float) -> str:
    """Return small print in lines of this width in inches, broken between its parts."""
    lines = [""]
    for part in subtitle.split(BETWEEN):
        longer = lines[-1] + BETWEEN * bool(lines[-1]) + part
        if lines[-1] and len(longer) > width * CHARACTERS:
            lines.append(part)
        else:
            lines[-1] = longer
    return "\n".join(lines)


def add_title(axes: Axes, title: str, subtitle: str) -> None:
    """Write a title and lines of small print over the left end of the axes."""
    over: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "baseline", "ha": "left"}
    lines = subtitle.split("\n")
    above = 8.0 + LINE * len(lines) + 4.0
    axes.annotate(
        title, (0.0, 1.0), (0.0, above), fontsize=12.5, fontweight="bold", color=INK, parse_math=False, **over
    )
    for i, line in enumerate(reversed(lines)):
        place = (0.0, 8.0 + LINE * i)
        axes.annotate(line, (0.0, 1.0), place, fontsize=8.5, color=MUTED, parse_math=False, **over)


def window_words(window: _Extent) -> str:
    """Return the size of a window in words, both sides to the same digit."""
    digits = 1 if min(window.width, window.height) >= 3.0 else 3
    return f"{window.width:.{digits}f} × {window.height:.{digits}f} m"


def number(value: float, digits: int) -> str:
    """Return a number with thousands separated and a minus sign that is as wide as a plus."""
    return f"{value:,.{digits}f}".replace("-", "−")


def counted(n: int, noun: str) -> str:
    """Return "1 draw" or "2,000 draws"."""
    return f"{n:,} {noun}" + ("" if n == 1 else "s")


def save(page: Figure, target: Target) -> None:
    """Write a page; the format is that of the file's suffix, PNG for streams."""
    _spell_out(page)
    if not isinstance(target, str | os.PathLike):
        page.savefig(target, format="png", dpi=DPI)
        return
    kind = picture_format(target)
    with open_output(target, binary=True) as stream:
        page.savefig(stream, format=kind, dpi=DPI)


def _spell_out(page: Figure) -> None:
    """Write what has no letters (`NO_LETTERS`) as escapes."""
    from matplotlib.text import Text

    for text in page.findobj(Text):
        assert isinstance(text, Text)
        text.set_text(NO_LETTERS.sub(lambda found: repr(found[0])[1:-1], text.get_text()))


def picture_format(path: str | os.PathLike[str]) -> str:
    """Return the format that the suffix of `path` names: png, svg or pdf; png without suffix (UsageError)."""
    suffix = PurePath(path).suffix.lower().lstrip(".")
    if suffix in FORMATS:
        return suffix
    if suffix:
        raise UsageError(f"{path}: no picture format .{suffix}. Choose from {', '.join(FORMATS)}.")
    return "png"


def card(title: str, facts: Mapping[str, str], png: bytes | None = None) -> str:
    """Return the HTML of a result for a notebook: a table of facts, and a small copy of a picture if there is one."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    picture = ""
    if png is not None:
        data = base64.b64encode(small_copy(png)).decode("ascii")
        picture = f"<img alt='{html.escape(title)}' style='max-width:100%' src='data:image/png;base64,{data}'>"
    return f"<div><b>{html.escape(title)}</b><table>{rows}</table>{picture}</div>"


def small_copy(png: bytes) -> bytes:
    """Return a picture in few colours, scaled down until it has at most `LARGEST_COPY`."""
    from PIL import Image  # matplotlib brings it

    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.thumbnail((960, 960))
    while True:
        buffer = io.BytesIO()
        picture.quantize(32, kmeans=1000, dither=Image.Dither.NONE).save(buffer, "png", optimize=True)
        if buffer.tell() <= LARGEST_COPY:
            return buffer.getvalue()
        less = min(0.75, LARGEST_COPY / buffer.tell())
        picture = picture.resize((int(picture.width * less), int(picture.height * less)), Image.Resampling.LANCZOS)
