"""The posterior as an image of probabilities, and the readings (figures 4 (f) and (d) of Paskin & Thrun 2005)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prf.model.window import Window
from prf.output.pictures import layers
from prf.readings import Readings
from prf.results import PosteriorImage, Run, names
from prf.shell.cli import pictures as style
from prf.shell.cli.pictures import Target

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

LEAST_BAR, MOST_BAR = 1.5, 3.6  # inches of the colour bar: room for its label, and no taller than reads well


def render_posterior(
    run: Run,
    target: Target,
    *,
    squares: bool = False,
    outline: bool = True,
    path: bool = True,
    beams: bool = False,
    disagreement: bool = True,
    title: str | None = None,
) -> None:
    """Draw how probably each point is occupied: white free, mid-grey unknown, black occupied; unseen cells hatched.

    `run`: with an image. `target`: where to write the picture. `squares`: show how probably each cell is not completely
    white instead of the colour at its centre (section 1.3.3). `outline`: draw the edges of the best map over it.
    `path`: draw the sensor's path. `beams`: draw the beams of the laser and the arcs of the sonar, thinly, and the
    points with their values. `disagreement`: tint the seen cells at which chains differ (docs/convergence.md). `title`:
    instead of the default one.
    """
    run = run.placed()
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    window = run.draws.window
    what = "Posterior of squares that are not free" if squares else "Posterior over polygonal maps"
    page, axes = style.map_page(window, style.margins_of(window, right=1.35), title or what, small_print(run))
    values = run.image.square_occupancy if squares else run.image.occupancy
    drawn = layers.draw_occupancy(axes, run.image, values)
    layers.draw_unseen(axes, run.image)
    style.show_window(axes, window)
    words = "not free" if squares else "occupied"
    if disagreement and layers.draw_disagreement(axes, run.image):
        words += "\nviolet: chains differ"
    if run.best is not None and outline:
        layers.draw_outline(axes, run.best, run.image)
    if run.laser is not None and beams:
        layers.draw_beams(axes, run.laser)
    if run.sonar is not None and beams:
        layers.draw_cones(axes, run.sonar)
    if run.points is not None and beams:
        layers.draw_points(axes, run.points)
    if path:
        layers.draw_path(axes, run.path_xy)
    _add_colour_bar(page, drawn, window, words)
    style.save(page, target)


def plot_posterior(run: Run, axes: Axes | None = None) -> Axes:
    """Draw what :func:`render_posterior` does into axes of the caller, in metres; None: those of a new figure."""
    from matplotlib import pyplot

    if run.image is None:
        raise run.missing(names.POSTERIOR)
    axes = pyplot.subplots()[1] if axes is None else axes
    layers.draw_occupancy(axes, run.image, run.image.occupancy)
    layers.draw_unseen(axes, run.image)
    layers.draw_disagreement(axes, run.image)
    if run.best is not None:
        layers.draw_outline(axes, run.best, run.image)
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
    drawn = layers.draw_occupancy(axes, image, image.occupancy)
    layers.draw_unseen(axes, image)
    style.show_window(axes, window)
    _add_colour_bar(page, drawn, window, "occupied")
    style.save(page, target)


def render_beams(
    run: Run, target: Target, *, outline: bool = False, path: bool = True, title: str | None = None
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
        layers.draw_beams(axes, run.laser)
    if run.sonar is not None:
        layers.draw_cones(axes, run.sonar)
    if outline and run.best is not None:
        layers.draw_outline(axes, run.best)
    if run.laser is not None:
        layers.draw_impacts(axes, run.laser)
    if run.points is not None:
        layers.draw_points(axes, run.points)
    if path:
        layers.draw_path(axes, run.path_xy)
    style.save(page, target)


def _words(readings: Readings) -> str:
    """Return how many readings of a sensor there are, and how many are not drawn."""
    n, n_scans = len(readings.angle), style.counted(len(readings.sensor_path()), "scan")
    n_silent = int(np.count_nonzero(~readings.returned))
    what = style.counted(n, "sonar reading" if readings.cone.any() else "beam")
    return f"{what} in {n_scans}  ·  {n_silent:,} without return below {readings.max_range:.4g} m (not drawn)"


def small_print(run: Run) -> str:
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
