"""Maps as black polygons on white: the best one, draws side by side, draws of the prior as in figure 1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from prf.model.coloring import Coloring
from prf.output.pictures.posterior import draw_path, fill_map
from prf.results import RunData, names
from prf.shell.cli import pictures as style
from prf.shell.cli.pictures import Target
from prf.shell.errors import InputError, UsageError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from prf.model.window import Window

PANEL = 3.4  # inches of one of several maps, in the larger direction
PAGE_WIDTH = 12.0
LEAST_CELL = 1.9  # inches for a map and its caption: a narrow map still has room for the words below it
GAP, CAPTION, EDGE, TITLE = 0.25, 0.45, 0.25, 0.7
"""Inches between maps, below each, at the edges of the page, and for a title."""


def render_best(run: RunData, target: Target, *, path: bool = False, title: str | None = None) -> None:
    """Draw the best map, occupied area filled.

    `run`: with a best map. `path`: draw the sensor's path, if the run has beams. `title`: instead of the default one.
    """
    if run.best is None:
        raise run.missing(names.MAP)
    window = run.best.window
    size = style.counted(run.best.n_edges, "edge")
    score = (
        "" if math.isnan(run.best_log_posterior) else f"  ·  log posterior {style.number(run.best_log_posterior, 1)}"
    )
    small = f"{run.name}  ·  {size}{score}  ·  {style.window_words(window)}"
    page, axes = style.map_page(window, style.margins_of(window), title or "Best map", small)
    fill_map(axes, run.best)
    if path:
        draw_path(axes, run.path_xy)
    style.save(page, target)


def render_draws(run: RunData, target: Target, *, n_draws: int = 4, title: str | None = None) -> None:
    """Draw several draws side by side, spread evenly over chains and time.

    `run`: with at least one draw. `n_draws`: how many; fewer if the run has fewer. `title`: instead of the default one.
    """
    maps, captions = spread_draws(run, n_draws)
    small = f"{run.name}  ·  {len(maps)} of {style.counted(len(run.draws), 'draw')}"
    render_maps(maps, captions, target, title=title or "Draws from the posterior", subtitle=small)


def render_maps(
    maps: Sequence[Coloring],
    captions: Sequence[str],
    target: Target,
    *,
    title: str | None = None,
    subtitle: str = "",
) -> None:
    """Draw maps side by side as black polygons on white in a thin frame, captions below, each with its scale bar.

    `maps`: at least one; windows may differ. `captions`: one a map. `title`, `subtitle`: over the first map; none
    leaves no room for them.
    """
    if not maps:
        raise UsageError("no map to draw.")
    sizes = [style.drawn_size(coloring.window, PANEL, PANEL) for coloring in maps]
    cell = max(LEAST_CELL, *(width for width, _ in sizes))
    row = max(height for _, height in sizes) + CAPTION
    n_columns = columns_for(len(maps), cell)
    n_rows = -(-len(maps) // n_columns)
    top = TITLE if title else EDGE
    page = style.new_page(2 * EDGE + n_columns * (cell + GAP) - GAP, top + n_rows * row + 0.5 * EDGE)
    for i, (coloring, caption, size) in enumerate(zip(maps, captions, sizes, strict=True)):
        left = EDGE + (i % n_columns) * (cell + GAP)
        bottom = 0.5 * EDGE + (n_rows - 1 - i // n_columns) * row + CAPTION
        axes = style.add_axes(page, left, bottom, *size)
        _draw_panel(axes, coloring, caption, cell, size[0])
        if i == 0 and title:
            style.add_title(axes, title, subtitle)
    style.save(page, target)


def columns_for(n_maps: int, width: float) -> int:
    """Return how many maps of `width` inches are side by side: rows filled evenly within the width of the page."""
    most = max(1, min(n_maps, int(PAGE_WIDTH / width)))
    n_rows = -(-n_maps // most)
    return -(-n_maps // n_rows)


def spread_draws(run: RunData, n_draws: int) -> tuple[list[Coloring], list[str]]:
    """Return so many draws of a run, spread evenly over chains and time, and what to write below each."""
    chosen = spread(len(run.draws), n_draws)
    if not chosen:
        raise InputError(f"{run.name}: no draws yet. Resume with prf sample --resume.")
    captions = [f"chain {run.chain[i] + 1}, step {run.step[i]:,}" for i in chosen]
    return [run.draws[i] for i in chosen], captions


def spread(n_draws: int, n_chosen: int) -> list[int]:
    """Return up to `n_chosen` indices below `n_draws`, evenly spaced, the last draw among them."""
    n_chosen = min(n_draws, n_chosen)
    return [((i + 1) * n_draws) // n_chosen - 1 for i in range(n_chosen)]


def _draw_panel(axes: Axes, coloring: Coloring, caption: str, cell: float, width: float) -> None:
    """Draw one map, `width` inches wide in a cell of `cell` inches; a narrow one has its bar under the caption."""
    window: Window = coloring.window
    style.show_window(axes, window)
    style.bare_axes(axes)
    fill_map(axes, coloring)
    style.scale_bar(axes, window, width, below=0.2 if width > 0.7 * cell else 0.37)
    below: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    axes.annotate(
        caption,
        (0.0, 0.0),
        (0.0, -14.4),
        va="center_baseline",
        fontsize=9.5,
        color=style.INK,
        parse_math=False,
        **below,
    )
