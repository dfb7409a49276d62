"""A page with the plan view and the 3D view of a map, one above the other, as in figures 3 and 4 of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mapq.render.colours import Scheme
from mapq.render.views import AZIMUTH, ELEVATION, Bounds, axonometric
from prf.shell import pictures
from prf.shell.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS = 400_000
"""Points that a picture shows; of more, evenly spaced ones: the rest would fall on the same pixels."""

GAP = 0.45
"""Inches between the two views."""


def render_views(
    xyz: NDArray[np.float64],
    scheme: Scheme,
    target: pictures.Target,
    *,
    title: str,
    subtitle: str,
    views: tuple[str, ...] = ("plan", "3d"),
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
) -> None:
    """Draw the points of a map.

    Parameters
    ----------
    xyz : (n, 3) float64
        Metres, z up; points that are not finite are left out.
    scheme : Scheme
        Their colours.
    target : path or binary file
        The suffix chooses PNG, SVG or PDF.
    title, subtitle : str
    views : tuple of str
        ``plan``, ``3d``, or both: the plan view stands above.
    azimuth, elevation : float
        Degrees: from where the 3D view looks.

    Raises
    ------
    InputError
        If no point is finite.
    """
    chosen = _choose(xyz)
    if len(chosen) == 0:
        raise InputError("no point to draw: no coordinate is finite.")
    shown = xyz[chosen]
    colours = Scheme(scheme.rgb[chosen], scheme.layer[chosen], scheme.legend)
    flat = {"plan": (shown[:, :2], shown[:, 2]), "3d": axonometric(shown, azimuth, elevation)}
    page, places = _page([Bounds.around(flat[view][0]) for view in views])
    for view, axes in zip(views, places, strict=True):
        xy, height = flat[view]
        # In plan view red lies over blue whatever its height: what is suspicious must be seen.
        order = np.lexsort((height, colours.layer)) if view == "plan" else np.argsort(height, kind="stable")
        _scatter(axes, xy[order], colours.rgb[order])
    if "plan" in views:
        width = float(places[views.index("plan")].get_position().width * page.get_size_inches()[0])
        plan = Bounds.around(shown[:, :2])
        pictures.metre_axes(places[views.index("plan")], width, plan.height / plan.width * width)
        pictures.scale_bar(places[views.index("plan")], plan, width, below=0.5)
    if "3d" in views:
        pictures.bare_axes(places[views.index("3d")])
    _add_legend(places[0], scheme)
    pictures.add_title(places[0], title, subtitle)
    pictures.save(page, target)


def _choose(xyz: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the numbers of the points to show."""
    finite = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    return finite[:: max(1, -(-len(finite) // MOST_POINTS))]


def _page(bounds: list[Bounds]) -> tuple[Figure, list[Axes]]:
    """Return a page with one window a view, the first at the top."""
    margins = pictures.Margins(left=0.9, right=1.35)
    sizes = [pictures.drawn_size(bound, pictures.LARGEST_WIDTH, 5.6) for bound in bounds]
    widest = max(max(width for width, _ in sizes), 4.0)
    gaps = (len(sizes) - 1) * (margins.bottom + GAP)
    height = margins.bottom + sum(height for _, height in sizes) + gaps + margins.top
    page = pictures.new_page(margins.left + widest + margins.right, height)
    places, top = [], height - margins.top
    for bound, (wide, high) in zip(bounds, sizes, strict=True):
        axes = pictures.add_axes(page, margins.left, top - high, wide, high)
        pictures.show_window(axes, bound)
        places.append(axes)
        top -= high + margins.bottom + GAP
    return page, places


def _scatter(axes: Axes, xy: NDArray[np.float64], rgb: NDArray[np.float32]) -> None:
    """Draw points as dots that are small where they are many, as pixels even in a vector format."""
    size = float(np.clip(6.0e4 / max(1, len(xy)), 0.25, 4.0))
    axes.scatter(xy[:, 0], xy[:, 1], s=size, c=rgb, linewidths=0, marker="o", rasterized=True)


def _add_legend(axes: Axes, scheme: Scheme) -> None:
    """Name the colours at the right of the axes."""
    for row, (name, rgb) in enumerate(scheme.legend):
        place = (12.0, -6.0 - 15.0 * row)
        axes.annotate("●", (1.0, 1.0), place, xycoords="axes fraction", textcoords="offset points", color=rgb, va="top")
        axes.annotate(
            name,
            (1.0, 1.0),
            (place[0] + 12.0, place[1]),
            xycoords="axes fraction",
            textcoords="offset points",
            fontsize=8.5,
            color=pictures.INK,
            va="top",
        )
