"""Maps side by side on one scale of metres and one scale of grey: the layout of the paper's figure 4."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from prf.model.coloring import Coloring
from prf.model.window import Window
from prf.output.pictures.posterior import draw_beams, draw_occupancy, draw_outline, draw_path, fill_map
from prf.readings import Readings
from prf.results import PosteriorImage
from prf.shell.cli import pictures as style

GAP, EDGE, CAPTION, BAR = 0.3, 0.3, 0.5, 0.9
"""Inches between panels, at the edges of the page, below each panel, and for the bar of grey."""


@dataclasses.dataclass(frozen=True)
class Panel:
    """One picture: how it is drawn into axes, and its caption."""

    draw: Callable[[Any], object]
    caption: str


def image(values: PosteriorImage, caption: str, outline: Coloring | None = None) -> Panel:
    """Return a panel of probabilities, edges of a map over it."""

    def draw(axes: Any) -> None:
        draw_occupancy(axes, values, values.occupancy)
        if outline is not None:
            draw_outline(axes, outline, width=0.7)

    return Panel(draw, caption)


def filled(coloring: Coloring, caption: str) -> Panel:
    """Return a panel of one map."""
    return Panel(lambda axes: fill_map(axes, coloring), caption)


def impacts(beams: Readings, caption: str, rays: bool = False) -> Panel:
    """Return a panel of the points where beams ended, the sensor's path, and the beams themselves if asked."""

    def draw(axes: Any) -> None:
        if rays:
            draw_beams(axes, beams, width=0.3)
        points = beams.impacts()
        size = float(np.clip(60.0 / max(len(points), 1) ** 0.5, 0.7, 2.5))
        axes.plot(*points.T, linestyle="none", marker="o", markersize=size, markeredgewidth=0, color=style.INK)
        draw_path(axes, beams.sensor_path())

    return Panel(draw, caption)


def save_page(
    target: Path, panels: Sequence[Panel], window: Window, *, columns: int, height: float, title: str, subtitle: str
) -> None:
    """Draw panels of one window in rows of `columns`, each `height` inches tall, and the bar of grey at the right."""
    width = height * window.width / window.height
    n_rows = -(-len(panels) // columns)
    page_width = 2 * EDGE + columns * (width + GAP) - GAP + BAR
    page = style.new_page(page_width, 0.8 + n_rows * (height + CAPTION))
    for number, panel in enumerate(panels):
        left = EDGE + (number % columns) * (width + GAP)
        bottom = (n_rows - 1 - number // columns) * (height + CAPTION) + CAPTION
        axes = style.add_axes(page, left, bottom, width, height)
        panel.draw(axes)
        style.show_window(axes, window)
        style.bare_axes(axes)
        axes.set_title(panel.caption, y=0.0, pad=-14, loc="left", fontsize=9, color=style.INK)
        if number == 0:
            style.add_title(axes, title, subtitle)
        if number == len(panels) - 1:
            style.scale_bar(axes, window, width, below=0.34)
    _add_bar(page, page_width - BAR + 0.1, CAPTION, min(height, 2.0))
    target.parent.mkdir(parents=True, exist_ok=True)
    style.save(page, target)


def _add_bar(page: Any, left: float, bottom: float, height: float) -> None:
    """Add the bar of probabilities."""
    axes = style.add_axes(page, left, bottom, 0.14, height)
    axes.imshow(np.linspace(0.0, 1.0, 64)[:, None], cmap="gray_r", aspect="auto", origin="lower", extent=(0, 1, 0, 1))
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.set_yticks([0.0, 0.5, 1.0], labels=["0", "0.5", "1"])
    axes.yaxis.set_label_position("right")
    axes.set_ylabel("probability: occupied", color=style.MUTED, fontsize=8.5)
    axes.tick_params(colors=style.MUTED, labelsize=8, color=style.FRAME, width=0.8, length=3)
    for spine in axes.spines.values():
        spine.set(color=style.FRAME, linewidth=0.8)
