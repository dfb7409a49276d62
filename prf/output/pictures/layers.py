"""Things drawn into axes of a window: filled maps, outlines, occupancy images, beams, sensor paths."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring, occupied_polygons
from prf.results import agreement
from prf.shell.cli.pictures import BEAM, DIFFERS, HATCH, IMPACT, INK, MUTED, OUTLINE, PATH, UNSEEN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from prf.readings import PointTable, Readings
    from prf.results import PosteriorImage

MOST_BEAMS = 4000  # more beams than this make a solid patch: they are thinned evenly before drawing


def fill_map(axes: Axes, coloring: Coloring, colour: str = INK) -> None:
    """Fill the occupied area, holes left white."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path
    from shapely.geometry.polygon import orient

    parts = []
    for polygon in occupied_polygons(coloring).geoms:
        turned = orient(polygon)  # rings of opposite sense: the fill rule then leaves the holes open
        parts += [Path(np.asarray(ring.coords), closed=True) for ring in (turned.exterior, *turned.interiors)]
    if parts:
        outline = Path.make_compound_path(*parts)
        axes.add_patch(PathPatch(outline, facecolor=colour, edgecolor="none", linewidth=0.0, zorder=2))


def draw_outline(axes: Axes, coloring: Coloring, image: PosteriorImage | None = None, width: float = 1.0) -> None:
    """Draw the edges of a map, of an `image` those that touch what readings saw; the window's border is none."""
    from matplotlib.collections import LineCollection

    lines = coloring.xy[coloring.edges]
    if image is not None:
        lines = lines[image.sees(lines)]
    axes.add_collection(
        LineCollection(list(lines), colors=OUTLINE, linewidths=width, capstyle="round", zorder=3), autolim=False
    )


def draw_occupancy(axes: Axes, image: PosteriorImage, values: NDArray[np.float32]) -> AxesImage:
    """Draw probabilities on the cells of `image`: 0 white, 0.5 mid-grey, 1 black."""
    from matplotlib import colormaps

    drawn = axes.imshow(
        np.ma.masked_invalid(values),
        cmap=colormaps["gray_r"].with_extremes(bad=UNSEEN),
        vmin=0.0,
        vmax=1.0,
        extent=image.extent,
        origin="lower",
        aspect="auto",
        zorder=1,
    )
    return drawn


def draw_unseen(axes: Axes, image: PosteriorImage) -> None:
    """Hatch the cells that no reading saw: what is drawn there is the prior's."""
    import matplotlib as mpl

    if image.seen.all() or min(image.seen.shape) < 2:
        return
    x, y = (
        start + image.resolution * (np.arange(n) + 0.5)
        for start, n in zip(image.origin, image.seen.shape[::-1], strict=True)
    )
    with mpl.rc_context({"hatch.linewidth": 0.5}):
        drawn = axes.contourf(x, y, ~image.seen, levels=[0.5, 1.5], colors="none", hatches=["////"], zorder=1.2)
    drawn.set(edgecolor=HATCH, linewidth=0.0)


def draw_disagreement(axes: Axes, image: PosteriorImage) -> bool:
    """Tint the seen cells at which chains differ; return whether there are any."""
    from matplotlib.colors import to_rgba

    if image.disagreement is None:
        return False
    differs = image.seen & (image.disagreement > agreement.DIFFERS)
    tint = np.zeros((*differs.shape, 4))
    tint[differs] = to_rgba(DIFFERS, 0.5)
    axes.imshow(tint, extent=image.extent, origin="lower", aspect="auto", interpolation="nearest", zorder=1.3)
    return bool(differs.any())


def thinned(rows: NDArray[Any]) -> NDArray[Any]:
    """Return every k-th row, so that no more than :data:`MOST_BEAMS` are drawn."""
    return rows[:: max(1, -(-len(rows) // MOST_BEAMS))]


def draw_beams(axes: Axes, beams: Readings, width: float = 0.4, strength: float = 0.45) -> None:
    """Draw the beams that returned, from sensor to impact."""
    from matplotlib.collections import LineCollection

    hit = thinned(np.flatnonzero(beams.returned))
    lines = np.stack((beams.origin[hit], beams.select(hit).impacts()), axis=1)
    axes.add_collection(
        LineCollection(list(lines), colors=BEAM, linewidths=width, alpha=strength, zorder=1.5), autolim=False
    )


def draw_impacts(axes: Axes, beams: Readings) -> None:
    """Draw a small dot at the end of every beam that returned; the more there are, the smaller."""
    impacts = beams.impacts()
    size = float(np.clip(2.2 * (4000 / max(len(impacts), 1)) ** 0.5, 0.5, 3.0))
    axes.plot(*impacts.T, linestyle="none", marker="o", markersize=size, markeredgewidth=0.0, color=IMPACT, zorder=2.5)


def draw_cones(axes: Axes, cones: Readings, width: float = 0.5, strength: float = 0.45) -> None:
    """Draw an arc across the field of view at the distance of every sonar reading that returned."""
    from matplotlib.collections import LineCollection

    arcs = thinned(cones.arcs())
    axes.add_collection(
        LineCollection(list(arcs), colors=IMPACT, linewidths=width, alpha=strength, zorder=1.6), autolim=False
    )


def draw_points(axes: Axes, points: PointTable) -> None:
    """Draw a dot at every point observation, the lowest value white and the highest black; the more, the smaller."""
    size = float(np.clip(30.0 * (400 / max(len(points.value), 1)), 2.0, 30.0))
    x, y = points.xy.T
    axes.scatter(x, y, s=size, c=points.value, cmap="gray_r", edgecolors=MUTED, linewidths=0.1 * size**0.5, zorder=2.4)


def draw_path(axes: Axes, path: NDArray[np.float64]) -> None:
    """Draw positions of the sensor (n, 2), metres, joined in their order, the first one ringed."""
    if not len(path):
        return
    dots = 2.4 if len(path) < 200 else 1.2
    axes.plot(*path.T, color=PATH, linewidth=0.9, alpha=0.9, marker="o", markersize=dots, markeredgewidth=0.0, zorder=4)
    axes.plot(
        *path[:1].T, linestyle="none", marker="o", markersize=6.0, color="white", markeredgecolor=PATH, zorder=4.1
    )
