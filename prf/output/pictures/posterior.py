"""The posterior as an image of probabilities, and the readings (figures 4 (f) and (d) of Paskin & Thrun 2005).

Below them what is drawn into axes of a window: filled maps, outlines, occupancy images, beams, sensor paths.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring, occupied_polygons
from prf.model.window import Window
from prf.readings import Readings
from prf.results import PosteriorImage, RunData, names
from prf.results.run import LEAST_DIFFERENCE
from prf.shell.cli import pictures as style
from prf.shell.cli.pictures import BEAM, DIFFERS, HATCH, IMPACT, INK, MUTED, OUTLINE, PATH, UNSEEN, Target

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from prf.readings import PointTable, Readings
    from prf.results import PosteriorImage


LEAST_BAR, MOST_BAR = 1.5, 3.6  # inches of the colour bar: room for its label, and no taller than reads well


def render_posterior(
    run: RunData,
    target: Target,
    *,
    squares: bool = False,
    outline: bool = True,
    path: bool = True,
    title: str | None = None,
) -> None:
    """Draw how probably each point is occupied: white free, mid-grey unknown, black occupied; unseen cells hatched.

    `run`: with an image. `target`: where to write the picture. `squares`: show how probably each cell is not completely
    white instead of the colour at its centre (section 1.3.3). `outline`: draw the edges of the best map over it.
    `path`: draw the sensor's path. `title`: instead of the default one. Seen cells at which chains differ are tinted
    (docs/convergence.md).
    """
    run = run.placed()
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    window = run.draws.window
    what = "Posterior of squares that are not free" if squares else "Posterior over polygonal maps"
    has_outline, has_path = run.best is not None and outline, path and len(run.path_xy) > 0
    legend = ["orange: best map"] * has_outline + ["blue: way driven"] * has_path
    small = style.BETWEEN.join([small_print(run), *legend])
    page, axes = style.map_page(window, style.margins_of(window, right=1.35), title or what, small)
    values = run.image.square_occupancy if squares else run.image.occupancy
    drawn = draw_occupancy(axes, run.image, values)
    draw_unseen(axes, run.image)
    style.show_window(axes, window)
    words = "not free" if squares else "occupied"
    if draw_disagreement(axes, run.image):
        words += "\nviolet: chains differ"
    if run.best is not None and outline:
        draw_outline(axes, run.best, run.image)
    if path:
        draw_path(axes, run.path_xy)
    _add_colour_bar(page, drawn, window, words)
    style.save(page, target)


def plot_posterior(run: RunData, axes: Axes | None = None) -> Axes:
    """Draw what :func:`render_posterior` does into axes of the caller, in metres; None: those of a new figure."""
    from matplotlib import pyplot

    if run.image is None:
        raise run.missing(names.POSTERIOR)
    axes = pyplot.subplots()[1] if axes is None else axes
    draw_occupancy(axes, run.image, run.image.occupancy)
    draw_unseen(axes, run.image)
    draw_disagreement(axes, run.image)
    if run.best is not None:
        draw_outline(axes, run.best, run.image)
    style.show_window(axes, run.draws.window)
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    return axes


def render_cells(image: PosteriorImage, target: Target, *, title: str, words: str = "") -> None:
    """Draw probabilities cell by cell: white free, mid-grey unknown, black occupied.

    `image`: its occupancy is drawn. `target`: where to write the picture. `title`, `words`: over the picture: a title,
    and what the small print begins with.
    """
    left, right, bottom, top = image.extent
    window = Window(left, bottom, right, top)
    small = "  ·  ".join([*([words] if words else []), f"cells of {image.resolution:g} m", style.window_words(window)])
    page, axes = style.map_page(window, style.margins_of(window, right=1.35), title, small)
    drawn = draw_occupancy(axes, image, image.occupancy)
    draw_unseen(axes, image)
    style.show_window(axes, window)
    _add_colour_bar(page, drawn, window, "occupied")
    style.save(page, target)


def render_beams(
    run: RunData, target: Target, *, outline: bool = False, path: bool = True, title: str | None = None
) -> None:
    """Draw beams and impacts of the laser, arcs of the sonar, the sensor's path, and points with their values.

    `run`: with readings. `outline`: draw the edges of the best map over them. `path`: draw the sensor's path. `title`:
    instead of the default one.
    """
    if run.sensors is None and run.points is None:
        raise run.missing(names.READINGS)
    run, window = run.placed(), run.draws.window
    words = [_words(part) for part in (run.laser, run.sonar) if part is not None]
    words += [style.counted(len(run.points.value), "point")] if run.points is not None else []
    small = "  ·  ".join([run.name, *words])
    page, axes = style.map_page(window, style.margins_of(window), title or "Readings", small)
    if run.laser is not None:
        draw_beams(axes, run.laser)
    if run.sonar is not None:
        draw_cones(axes, run.sonar)
    if outline and run.best is not None:
        draw_outline(axes, run.best, run.image)
    if run.laser is not None:
        draw_impacts(axes, run.laser)
    if run.points is not None:
        draw_points(axes, run.points)
    if path:
        draw_path(axes, run.path_xy)
    style.save(page, target)


def _words(readings: Readings) -> str:
    """Return how many readings of a sensor there are, and how many are not drawn."""
    n, n_scans = len(readings.angle), style.counted(len(readings.sensor_path()), "scan")
    n_silent = int(np.count_nonzero(~readings.returned))
    what = style.counted(n, "sonar reading" if readings.cone.any() else "beam")
    return f"{what} in {n_scans}  ·  {n_silent:,} without return below {readings.max_range:.4g} m (not drawn)"


def small_print(run: RunData) -> str:
    """Return the words under the title: the run, its draws, the window, and its status if that is a bad one."""
    parts = [
        run.name,
        f"{style.counted(len(run.draws), 'draw')} of {style.counted(run.n_chains, 'chain')}",
        style.window_words(run.draws.window),
        *(["hatched: not seen"] if run.image is not None and not run.image.seen.all() else []),
    ]
    status = run.manifest.get("status")
    return "  ·  ".join(parts + ([str(status)] if status in ("interrupted", "not converged") else []))


def _add_colour_bar(page: Figure, drawn: AxesImage, window: Window, event: str) -> None:
    """Add the bar of probabilities right of the map, centred on the map's height; it may be taller than the map."""
    margins = style.margins_of(window)
    width, height = style.drawn_size(window)
    tall = max(LEAST_BAR, min(height, MOST_BAR))
    axes = style.add_axes(page, margins.left + width + 0.25, margins.bottom + 0.5 * (height - tall), 0.16, tall)
    bar = page.colorbar(drawn, cax=axes)
    bar.set_ticks([0.0, 0.25, 0.5, 0.75, 1.0], labels=["0", "", "0.5", "", "1"])
    bar.set_label(f"probability: {event}", color=style.MUTED, fontsize=9)
    bar.outline.set(color=style.FRAME, linewidth=0.8)
    axes.tick_params(colors=style.MUTED, labelsize=8, color=style.FRAME, width=0.8, length=3)


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
    """Draw the edges of a map, beside an `image` as far as readings saw, without the window's border."""
    from matplotlib.collections import LineCollection

    lines = coloring.xy[coloring.edges]
    if image is not None:
        lines = image.near_seen(lines[image.sees(lines)])
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
    differs = image.seen & (image.disagreement > LEAST_DIFFERENCE)
    tint = np.zeros((*differs.shape, 4))
    tint[differs] = to_rgba(DIFFERS, 0.5)
    axes.imshow(tint, extent=image.extent, origin="lower", aspect="auto", interpolation="nearest", zorder=1.3)
    return bool(differs.any())


def thinned(rows: NDArray[Any]) -> NDArray[Any]:
    """Return every k-th row, so that no more than :data:`MOST_BEAMS` are drawn."""
    return rows[:: max(1, -(-len(rows) // MOST_BEAMS))]


def draw_beams(axes: Axes, beams: Readings, width: float = 0.4) -> None:
    """Draw the beams that returned, from sensor to impact."""
    from matplotlib.collections import LineCollection

    hit = thinned(np.flatnonzero(beams.returned))
    lines = np.stack((beams.origin[hit], beams.select(hit).impacts()), axis=1)
    axes.add_collection(
        LineCollection(list(lines), colors=BEAM, linewidths=width, alpha=0.45, zorder=1.5), autolim=False
    )


def draw_impacts(axes: Axes, beams: Readings) -> None:
    """Draw a small dot at the end of every beam that returned; the more there are, the smaller."""
    impacts = beams.impacts()
    size = float(np.clip(2.2 * (4000 / max(len(impacts), 1)) ** 0.5, 0.5, 3.0))
    axes.plot(*impacts.T, linestyle="none", marker="o", markersize=size, markeredgewidth=0.0, color=IMPACT, zorder=2.5)


def draw_cones(axes: Axes, cones: Readings) -> None:
    """Draw an arc across the field of view at the distance of every sonar reading that returned."""
    from matplotlib.collections import LineCollection

    arcs = thinned(cones.arcs())
    axes.add_collection(
        LineCollection(list(arcs), colors=IMPACT, linewidths=0.5, alpha=0.45, zorder=1.6), autolim=False
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
