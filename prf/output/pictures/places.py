"""Where to look next, over the posterior: arrows at the best places, with their gains, and the way to the first."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prf.output.pictures.posterior import draw_occupancy, draw_outline, draw_path, draw_unseen, small_print
from prf.results import RunData, names
from prf.results.explore import Exploration
from prf.shell.cli import pictures as style
from prf.shell.cli.pictures import Target

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIRST, OTHERS, ASKED = "#1b7f3b", "#5aa469", "#7048e8"
"""Colours of the best place, of the others, and of what is asked about."""
LENGTH = 26.0
"""Of an arrow, points."""


def render_places(
    run: RunData, found: Exploration, target: Target, asked: NDArray[np.float64] | None, radius: float
) -> None:
    """Draw the best places of `found` over the posterior of a run.

    `target`: where to write the picture. `asked` (k, 2): corners of the path or the region that is asked about, metres;
    None: all of the window. `radius`: of the disc that follows the path, metres.
    """
    run = run.placed()
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    window = run.draws.window
    small = f"{small_print(run)}  ·  nats that one scan is expected to settle"
    page, axes = style.map_page(window, style.margins_of(window), "Where to look next", small)
    draw_occupancy(axes, run.image, run.image.occupancy)
    draw_unseen(axes, run.image)
    if run.best is not None:
        draw_outline(axes, run.best, run.image, 0.7)
    draw_path(axes, run.path_xy)
    if asked is not None:
        _draw_asked(axes, asked, radius)
    style.show_window(axes, window)
    draw_places(axes, found)
    style.save(page, target)


def _draw_asked(axes: Axes, asked: NDArray[np.float64], radius: float) -> None:
    """Draw the ground that a disc needs on a path, or the outline of a region."""
    import shapely
    from matplotlib.patches import Polygon

    if len(asked) > 3 and (asked[0] == asked[-1]).all():
        axes.add_patch(Polygon(asked, closed=True, facecolor="none", edgecolor=ASKED, linewidth=1.6, zorder=4.2))
        return
    ground = shapely.LineString(np.vstack([asked, asked[-1:]])).buffer(radius)
    axes.add_patch(Polygon(np.array(ground.exterior.coords), facecolor=ASKED, alpha=0.3, linewidth=0.0, zorder=3.8))
    axes.plot(*asked.T, color=ASKED, linewidth=1.4, zorder=4.2)


def draw_places(axes: Axes, found: Exploration) -> None:
    """Draw an arrow along the heading of each of the best places, its gain beside it, and the way to the first."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.6, foreground="white")]
    for rank, number in enumerate(found.shown()):
        colour = OTHERS if rank else FIRST
        if rank == 0:
            axes.plot(*found.ways[number].T, color=FIRST, linewidth=1.3, linestyle=(0, (4, 2)), zorder=4.3)
        place, theta = found.xy[number], found.theta[number]
        ahead = np.array([np.cos(theta), np.sin(theta)])
        axes.annotate(
            "",
            place,
            tuple(LENGTH * ahead),
            textcoords="offset points",
            arrowprops={
                "arrowstyle": "<|-",
                "color": colour,
                "linewidth": 2.4,
                "mutation_scale": 15,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=4.5,
        )
        axes.plot(*place, marker="o", markersize=7.0, color=colour, markeredgecolor="white", zorder=4.6)
        gain = found.gain[number]
        axes.annotate(
            f"{gain:.0f}" if gain >= 10.0 else f"{gain:.2g}",
            place,
            tuple(-(11.0 + 5.0 * abs(ahead[0])) * ahead),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=9.5 if rank else 11.0,
            fontweight="bold",
            color=colour,
            path_effects=halo,
            zorder=4.7,
        )
