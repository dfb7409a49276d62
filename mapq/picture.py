"""`Picture`: plan view and 3D view of points, one above the other, as in figures 3 and 4 of the paper.

Colours show labels, probabilities or patches. Blue and red stay apart for colour-blind readers.
"""

from __future__ import annotations

import io
from pathlib import PurePath
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.labels import NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from prf.shell.cli import pictures
from prf.shell.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Colour = Literal["label", "probability", "patch", "field"]
"""What the colour of a point shows."""
TITLES = {
    "label": "Plausible and suspicious patches",
    "probability": "Probability that a patch is suspicious",
    "patch": "Plane patches",
}
PLAUSIBLE_RGB = (0.10, 0.36, 0.72)
SUSPICIOUS_RGB = (0.84, 0.10, 0.11)
UNLABELLED_RGB = (0.55, 0.58, 0.60)
BACKGROUND_RGB = (0.83, 0.84, 0.85)
"""Points without a patch: there for orientation, not to be looked at."""
DOUBTFUL_RGB = (0.93, 0.90, 0.80)
"""Half way between plausible and suspicious."""

GOLDEN_RATIO = 0.6180339887498949
"""Its multiples spread hues so that patches of close numbers differ."""

MAX_POINTS = 400_000
"""Points that a picture shows; of more, evenly spaced ones: the rest would fall on the same pixels."""
OUTLYING = 0.02
"""Share of the points on each side that may lie outside the box: through windows sensors see far away."""
MOST_BOXED = 200_000
"""Points that this box is computed from."""
GAP = 0.45
"""Inches between the two views."""
AZIMUTH, ELEVATION = -60.0, 35.0
"""Degrees: direction of the viewer in the 3D view."""

Floats = NDArray[np.float64]


class Scheme(NamedTuple):
    """Colours of points and what they mean."""

    rgb: NDArray[np.float32]  # (n, 3)
    layer: NDArray[np.uint8]  # (n,) points of a higher layer are drawn over those of a lower one in plan view
    legend: tuple[tuple[str, tuple[float, float, float]], ...]


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
        is_patch = self.scheme.layer[shown] > 0
        if is_patch.any():  # of a bare cloud nobody knows what is stray
            low, high = box_of(self.xyz[shown[is_patch]], self.xyz[shown])
            shown = shown[((self.xyz[shown] >= low) & (self.xyz[shown] <= high)).all(axis=1)]
        xyz, rgb, layer = self.xyz[shown], self.scheme.rgb[shown], self.scheme.layer[shown]
        flat = {"plan": (xyz[:, :2], xyz[:, 2]), "3d": axonometric(xyz)}
        page, places, subtitle = _page([Bounds.around(flat[view][0]) for view in views], self.subtitle)
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
        pictures.add_title(places[0], self.title, subtitle)
        return page

    def png(self) -> bytes | None:
        """Return the plan view as PNG; None without a finite point."""
        if not np.isfinite(self.xyz).all(axis=1).any():
            return None
        buffer = io.BytesIO()
        pictures.save(self.draw(("plan",)), buffer)
        return buffer.getvalue()


def box_of(inside: Floats, all_points: Floats) -> tuple[Floats, Floats]:
    """Return the corners of a box around the points in patches, and all points but for `OUTLYING` on each side."""
    if len(all_points) == 0:
        return np.zeros(3), np.zeros(3)
    some = all_points[:: max(1, len(all_points) // MOST_BOXED)]
    low, high = np.quantile(some, (OUTLYING, 1.0 - OUTLYING), axis=0)
    if len(inside) == 0:
        return low, high
    return np.minimum(low, inside.min(axis=0)), np.maximum(high, inside.max(axis=0))


def picture_of_cloud(name: str, xyz: Floats) -> Picture:
    """Return the picture of points (n, 3), world coordinates in metres, of which nothing else is known."""
    rgb = np.tile(np.array(UNLABELLED_RGB, np.float32), (len(xyz), 1))
    words = f"{PurePath(name).name}  ·  {len(xyz):,} points"
    return Picture(xyz, Scheme(rgb, np.zeros(len(xyz), np.uint8), ()), "Point cloud", words)


def picture_of_points(
    name: str,
    xyz: Floats,
    patch: NDArray[np.int32],
    label: NDArray[np.uint8],
    probability: NDArray[np.floating] | None = None,
    *,
    colour: Colour | None = None,
    field: str = "",
    counts: tuple[int, int, int] | None = None,
    verdict: str = "",
) -> Picture:
    """Return the picture of a map called `name`.

    Parameters
    ----------
    name : str
    xyz : (n, 3) float64
        World coordinates in metres.
    patch : (n,) int32
    label : (n,) uint8
        Label of each point's patch; for colour ``field``: of the point, by that field.
    probability : (n,), optional
        That the patch is suspicious; for colour ``probability``.
    colour : str, optional
        None: labels where there are any, else patches.
    field : str
        Name of the field that colour ``field`` shows.
    counts : (int, int, int), optional
        Points, patches and suspicious patches of the map, if the points are a part of it.
    verdict : str
        Words on what is suspicious.
    """
    chosen: Colour = colour or ("label" if np.any(label != UNLABELLED) else "patch")
    if chosen == "patch":
        scheme = patch_colours(patch)
    elif chosen == "label":
        scheme = label_colours(label, patch)
    elif chosen == "field":
        scheme = label_colours(label, np.zeros(len(label), np.int32))
    elif probability is None:
        raise InputError(f"{name}: no field p_suspicious. Draw a result of mapq classify, or choose another colour.")
    else:
        scheme = probability_colours(probability, patch)
    inside = patch != NO_PATCH
    n_points, n_patches, n_suspicious = counts or (
        len(xyz),
        len(np.unique(patch[inside])),
        len(np.unique(patch[inside & (label == SUSPICIOUS)])),
    )
    drawn = "" if len(xyz) == n_points else f"{len(xyz):,} of "
    words = f"{PurePath(name).name}  ·  {drawn}{n_points:,} points  ·  {n_patches:,} patches"
    words += f"  ·  {n_suspicious:,} suspicious" if chosen == "label" else ""
    words += f"  ·  {verdict}" if verdict and chosen in ("label", "probability") else ""
    return Picture(xyz, scheme, TITLES.get(chosen, f"Field {field}"), words)


def label_colours(label: NDArray[np.uint8], patch: NDArray[np.int32]) -> Scheme:
    """Return the colours of points by the label (n,) of their patch (n,): blue, red, grey."""
    rgb = np.empty((len(label), 3), np.float32)
    rgb[:] = UNLABELLED_RGB
    rgb[label == PLAUSIBLE] = PLAUSIBLE_RGB
    rgb[label == SUSPICIOUS] = SUSPICIOUS_RGB
    rgb[patch == NO_PATCH] = BACKGROUND_RGB
    layer = np.where(patch == NO_PATCH, 0, np.where(label == SUSPICIOUS, 2, 1)).astype(np.uint8)
    legend = [("plausible", PLAUSIBLE_RGB), ("suspicious", SUSPICIOUS_RGB), ("no patch", BACKGROUND_RGB)]
    if np.any((patch != NO_PATCH) & (label != PLAUSIBLE) & (label != SUSPICIOUS)):
        legend.insert(2, ("unlabelled", UNLABELLED_RGB))
    return Scheme(rgb, layer, tuple(legend))


def probability_colours(probability: NDArray[np.floating], patch: NDArray[np.int32]) -> Scheme:
    """Return the colours of points by the probability (n,) that their patch is suspicious: blue over pale to red."""
    share = np.clip(np.nan_to_num(probability.astype(np.float32), nan=0.0), 0.0, 1.0)[:, None]
    ends = np.where(share < 0.5, np.array(PLAUSIBLE_RGB, np.float32), np.array(SUSPICIOUS_RGB, np.float32))
    sureness = np.abs(2.0 * share - 1.0)
    rgb = (sureness * ends + (1.0 - sureness) * np.array(DOUBTFUL_RGB, np.float32)).astype(np.float32)
    rgb[patch == NO_PATCH] = BACKGROUND_RGB
    layer = np.where(patch == NO_PATCH, 0, 1 + (share[:, 0] > 0.5)).astype(np.uint8)
    legend = (
        ("p 0, plausible", PLAUSIBLE_RGB),
        ("p 0.5", DOUBTFUL_RGB),
        ("p 1, suspicious", SUSPICIOUS_RGB),
        ("no patch", BACKGROUND_RGB),
    )
    return Scheme(rgb, layer, legend)


def patch_colours(patch: NDArray[np.int32]) -> Scheme:
    """Return one colour a patch, spread over the hues, so that neighbours differ."""
    hue = np.mod(patch.astype(np.float64) * GOLDEN_RATIO, 1.0)
    value = 0.55 + 0.35 * np.mod(patch.astype(np.float64) * GOLDEN_RATIO**2, 1.0)
    turns = hue[:, None] + np.array([0.0, 2.0 / 3.0, 1.0 / 3.0])
    wave = np.clip(np.abs(6.0 * np.mod(turns, 1.0) - 3.0) - 1.0, 0.0, 1.0)
    rgb = (value[:, None] * (0.15 + 0.85 * wave)).astype(np.float32)
    rgb[patch == NO_PATCH] = BACKGROUND_RGB
    return Scheme(rgb, (patch != NO_PATCH).astype(np.uint8), (("no patch", BACKGROUND_RGB),))


def axonometric(xyz: Floats, azimuth: float = AZIMUTH, elevation: float = ELEVATION) -> tuple[Floats, Floats]:
    """Project points (n, 3) without perspective: place (n, 2) in metres, right and up, and nearness (n,) to the eye."""
    turn, rise = np.radians(azimuth), np.radians(elevation)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    towards = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    up = np.cross(towards, right)
    return xyz @ np.stack([right, up], axis=1), xyz @ towards


def _page(bounds: list[Bounds], subtitle: str) -> tuple[Figure, list[Axes], str]:
    """Return a page with one window a view, the first at the top, and the subtitle in lines that fit it."""
    margins = pictures.Margins(left=0.9, right=1.35)
    sizes = [pictures.drawn_size(bound, pictures.LARGEST_WIDTH, 5.6) for bound in bounds]
    widest = max(max(width for width, _ in sizes), 4.0)
    gaps = (len(sizes) - 1) * (margins.bottom + GAP)
    subtitle = pictures.in_lines(subtitle, widest + margins.right)
    above = margins.top + subtitle.count("\n") * pictures.LINE / 72.0
    height = margins.bottom + sum(height for _, height in sizes) + gaps + above
    page = pictures.new_page(margins.left + widest + margins.right, height)
    places, top = [], height - above
    for bound, (wide, high) in zip(bounds, sizes, strict=True):
        axes = pictures.add_axes(page, margins.left, top - high, wide, high)
        pictures.show_window(axes, bound)
        places.append(axes)
        top -= high + margins.bottom + GAP
    return page, places, subtitle


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
