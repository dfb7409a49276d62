"""Pictures in a terminal: half blocks in colours, lines in braille, or plain characters (docs/terminal.md)."""

from prf.shell.terminal.canvas import Canvas, Extent
from prf.shell.terminal.cells import Layer, Raster, lines_of
from prf.shell.terminal.greys import grey_raster, legend_of_greys
from prf.shell.terminal.layout import fitted, per_row, picture_rows, side_by_side, with_words
from prf.shell.terminal.scale import scale_bar
from prf.shell.terminal.screen import Screen, find_screen, put

__all__ = [
    "Canvas",
    "Extent",
    "Layer",
    "Raster",
    "Screen",
    "find_screen",
    "fitted",
    "grey_raster",
    "legend_of_greys",
    "lines_of",
    "per_row",
    "picture_rows",
    "put",
    "scale_bar",
    "side_by_side",
    "with_words",
]
