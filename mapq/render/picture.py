"""`Picture`: plan view and 3D view of a map, one above the other, as in figures 3 and 4 of the paper."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.render.colours import Scheme
from prf.shell.cli import pictures
from prf.shell.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_POINTS = 400_000
"""Points that a picture shows; of more, evenly spaced ones: the rest would fall on the same pixels."""
GAP = 0.45
"""Inches between the two views."""
AZIMUTH, ELEVATION = -60.0, 35.0
"""Degrees: direction of the viewer in the 3D view."""

Floats = NDArray[np.float64]


class Bounds(NamedTuple):
    """A window in the plane of a picture, in metres."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width(self) -> float:
        """Of the window."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Of the window."""
        return self.y_max - self.y_min

    @classmethod
    def around(cls, xy: Floats, margin: float = 0.02) -> Bounds:
        """Return the bounds of points (n, 2), widened by a share of their size; a point alone gets a metre."""
        low, high = xy.min(axis=0), xy.max(axis=0)
        pad = max(margin * float((high - low).max()), 0.5)
        return cls(*(low - pad).tolist(), *(high + pad).tolist())


class Picture(NamedTuple):
    """Points and their colours, with the words over them."""

    xyz: Floats  # (n, 3) world coordinates, metres, z up; points that are not finite are left out
    scheme: Scheme  # their colours
    title: str
    subtitle: str

    def draw(self, views: tuple[str, ...] = ("plan", "3d")) -> Figure:
        """Return a matplotlib figure of the views "plan" and "3d", or one of them, the first at the top."""
        finite = np.flatnonzero(np.isfinite(self.xyz).all(axis=1))
        shown = finite[:: max(1, -(-len(finite) // MAX_POINTS))]
        if len(shown) == 0:
            raise InputError("no point to draw: no coordinate is finite.")
        xyz, rgb, layer = self.xyz[shown], self.scheme.rgb[shown], self.scheme.layer[shown]
        flat = {"plan": (xyz[:, :2], xyz[:, 2]), "3d": axonometric(xyz)}
        page, places = _page([Bounds.around(flat[view][0]) for view in views])
        for view, axes in zip(views, places, strict=True):
            xy, height = flat[view]
            # In plan view red lies over blue whatever its height: what is suspicious must be seen.
            order = np.lexsort((height, layer)) if view == "plan" else np.argsort(height, kind="stable")
            _scatter(axes, xy[order], rgb[order])
            if view == "plan":
                width = float(axes.get_position().width * page.get_size_inches()[0])
                bounds = Bounds.around(xy)
                pictures.metre_axes(axes, width, bounds.height / bounds.width * width)
                pictures.scale_bar(axes, bounds, width, below=0.5)
            else:
                pictures.bare_axes(axes)
        _add_legend(places[0], self.scheme)
        pictures.add_title(places[0], self.title, self.subtitle)
        return page

    def png(self) -> bytes | None:
        """Return the plan view as PNG; None without a finite point."""
        if not np.isfinite(self.xyz).all(axis=1).any():
            return None
        buffer = io.BytesIO()
        pictures.save(self.draw(("plan",)), buffer)
        return buffer.getvalue()


def axonometric(xyz: Floats, azimuth: float = AZIMUTH, elevation: float = ELEVATION) -> tuple[Floats, Floats]:
    """Project points (n, 3) without perspective: place (n, 2) in metres, right and up, and nearness (n,) to the eye."""
    turn, rise = np.radians(azimuth), np.radians(elevation)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    towards = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    up = np.cross(towards, right)
    return xyz @ np.stack([right, up], axis=1), xyz @ towards


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


def _scatter(axes: Axes, xy: Floats, rgb: NDArray[np.float32]) -> None:
    """Draw points as dots that are small where they are many, as pixels even in a vector format."""
    size = float(np.clip(6.0e4 / max(1, len(xy)), 0.25, 4.0))
    axes.scatter(xy[:, 0], xy[:, 1], s=size, c=rgb, linewidths=0, marker="o", rasterized=True)


def _add_legend(axes: Axes, scheme: Scheme) -> None:
    """Name the colours at the right of the axes."""
    for row, (name, rgb) in enumerate(scheme.legend):
        down = -6.0 - 15.0 * row
        for text, left, colour, size in (("●", 12.0, rgb, None), (name, 24.0, pictures.INK, 8.5)):
            axes.annotate(
                text,
                (1.0, 1.0),
                (left, down),
                xycoords="axes fraction",
                textcoords="offset points",
                va="top",
                color=colour,
                fontsize=size,
            )
