"""A bar of round length under a picture."""

from __future__ import annotations

import math

from prf.shell.terminal.canvas import Canvas
from prf.shell.terminal.screen import Screen

LONGEST = 0.3
"""Share of the width that the bar takes at most, unless that is very little."""
LITTLE = 8
"""Cells."""


def scale_bar(canvas: Canvas, screen: Screen) -> str:
    """Return a bar of 1, 2 or 5 times a power of ten metres, with its length."""
    most = max(LITTLE, LONGEST * canvas.columns) * canvas.pixel
    decade = 10.0 ** math.floor(math.log10(most))
    length = max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= most)
    cells = max(2, round(length / canvas.pixel))
    left, line, right = "├─┤" if screen.blocks else "|-|"
    return f"{left}{line * (cells - 2)}{right} {length:g} m"
