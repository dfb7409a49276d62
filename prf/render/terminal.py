"""Pictures of runs, grids and maps as lines of text for a terminal (docs/terminal.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prf.coloring import Coloring, black_at
from prf.render.maps import spread_draws
from prf.render.posterior import small_print
from prf.run import Cones, PosteriorImage, Run, names
from prf.shell import pictures as style
from prf.shell.terminal import (
    Canvas,
    Layer,
    Screen,
    fitted,
    grey_raster,
    legend_of_greys,
    per_row,
    picture_rows,
    side_by_side,
    with_words,
)
from prf.window import Window

if TYPE_CHECKING:
    from rich.text import Text

FINE = 3
"""Points asked across a pixel, to see how much of it is occupied."""


def posterior_lines(
    run: Run,
    screen: Screen,
    *,
    squares: bool = False,
    outline: bool = True,
    path: bool = False,
    beams: bool = False,
    title: str | None = None,
) -> list[Text]:
    """Return the picture of :func:`prf.render.render_posterior` for a terminal.

    Parameters
    ----------
    run : Run
        With an image.
    screen : Screen
    squares, outline, path, beams : bool
        As there; of the beams where they ended.
    title : str, optional
    """
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    window = run.draws.window
    canvas = Canvas.fit(window, screen.columns, picture_rows(screen))
    values = run.image.square_occupancy if squares else run.image.occupancy
    means = canvas.means(values, run.image.origin, run.image.resolution)
    layers = [*(reading_layers(run, canvas) if beams else []), *_line_layers(run, canvas, outline, path)]
    what = "Posterior of squares that are not free" if squares else "Posterior over polygonal maps"
    raster = grey_raster(means, screen, tuple(layers))
    legend = legend_of_greys(screen, "not free" if squares else "occupied") if screen.colours is None else ""
    return with_words(raster, canvas, screen, title or what, small_print(run), legend)


def best_lines(run: Run, screen: Screen, *, path: bool = False, title: str | None = None) -> list[Text]:
    """Return the best map for a terminal."""
    if run.best is None:
        raise run.missing(names.MAP)
    small = f"{run.name}  ·  {style.counted(run.best.n_edges, 'edge')}  ·  {style.window_words(run.best.window)}"
    canvas = Canvas.fit(run.best.window, screen.columns, picture_rows(screen))
    layers = tuple(_line_layers(run, canvas, outline=False, path=path))
    return _map_lines(run.best, canvas, screen, title or "Best map", small, layers)


def reading_lines(
    run: Run, screen: Screen, *, outline: bool = False, path: bool = True, title: str | None = None
) -> list[Text]:
    """Return for a terminal where the readings of a run ended, over white."""
    if run.sensors is None and run.points is None:
        raise run.missing(names.READINGS)
    window = run.draws.window
    canvas = Canvas.fit(window, screen.columns, picture_rows(screen))
    layers = [*reading_layers(run, canvas), *_line_layers(run, canvas, outline, path)]
    raster = grey_raster(np.zeros(canvas.shape), screen, tuple(layers))
    small = f"{run.name}  ·  {style.window_words(window)}"
    return with_words(raster, canvas, screen, title or "Readings", small)


def draw_lines(run: Run, screen: Screen, *, n_draws: int = 4, title: str | None = None) -> list[Text]:
    """Return several draws side by side for a terminal."""
    maps, captions = spread_draws(run, n_draws)
    return map_lines(maps, captions, screen, title=title or "Draws from the posterior")


def cell_lines(image: PosteriorImage, screen: Screen, *, title: str, words: str = "") -> list[Text]:
    """Return probabilities cell by cell for a terminal; for the parameters see :func:`prf.render.render_cells`."""
    left, right, bottom, top = image.extent
    window = Window(left, bottom, right, top)
    canvas = Canvas.fit(window, screen.columns, picture_rows(screen))
    means = canvas.means(image.occupancy, image.origin, image.resolution)
    small = "  ·  ".join([*([words] if words else []), f"cells of {image.resolution:g} m", style.window_words(window)])
    legend = legend_of_greys(screen) if screen.colours is None else ""
    return with_words(grey_raster(means, screen), canvas, screen, title, small, legend)


def map_lines(
    maps: Sequence[Coloring], captions: Sequence[str], screen: Screen, *, title: str | None = None
) -> list[Text]:
    """Return maps side by side, occupied area filled, each with its caption."""
    from rich.text import Text

    n_columns, part = per_row(len(maps), screen)
    pictures = [
        _map_lines(coloring, Canvas.fit(coloring.window, part.columns), part, "", caption, ())
        for coloring, caption in zip(maps, captions, strict=True)
    ]
    head = fitted([Text(title, "bold")] if title else [], screen)
    return [*head, *side_by_side(pictures, n_columns, part.columns)]


def _map_lines(
    coloring: Coloring, canvas: Canvas, screen: Screen, title: str, small: str, layers: tuple[Layer, ...]
) -> list[Text]:
    raster = grey_raster(covered(coloring, canvas), screen, layers)
    return with_words(raster, canvas, screen, title, small)


def covered(coloring: Coloring, canvas: Canvas) -> NDArray[np.float64]:
    """Return the occupied share (2 rows, columns) of every pixel, of FINE x FINE points in it."""
    shift = canvas.pixel * ((np.arange(FINE) + 0.5) / FINE - 0.5)
    offsets = np.stack(np.meshgrid(shift, shift), axis=-1).reshape(-1, 1, 2)
    points = np.clip(canvas.centres() + offsets, *_corners(coloring.window))
    shares: NDArray[np.float64] = black_at(coloring, points.reshape(-1, 2)).reshape(len(offsets), -1).mean(axis=0)
    return shares.reshape(canvas.shape)


def _corners(window: Window) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower left and the upper right corner, a little inside."""
    low, high = np.array([window.x_min, window.y_min]), np.array([window.x_max, window.y_max])
    inwards = 1e-9 * (high - low)
    return low + inwards, high - inwards


def _line_layers(run: Run, canvas: Canvas, outline: bool, path: bool) -> list[Layer]:
    """Return the edges of the best map and the path of the sensor, as far as they are wanted and there."""
    layers = []
    if path and run.sensors is not None:
        way = run.sensors.sensor_path()
        layers.append(Layer(canvas.dots(np.stack((way[:-1], way[1:]), axis=1)), style.rgb(style.PATH), "o"))
    if outline and run.best is not None:
        layers.append(outline_layer(run.best, canvas))
    return layers


def outline_layer(coloring: Coloring, canvas: Canvas) -> Layer:
    """Return the edges of a map as a layer."""
    return Layer(canvas.dots(coloring.xy[coloring.edges]), style.rgb(style.OUTLINE), "x")


def reading_layers(run: Run, canvas: Canvas) -> list[Layer]:
    """Return where beams ended, the arcs of sonar readings, and points, as far as the run has them."""
    dots = np.zeros((4 * canvas.rows, 2 * canvas.columns), np.bool_)
    if run.beams is not None:
        canvas.mark(dots, run.beams.impacts())
    if run.points is not None:
        canvas.mark(dots, run.points.xy)
    if run.cones is not None:
        dots |= canvas.dots(_arcs(run.cones))
    return [Layer(dots, style.rgb(style.IMPACT), "*")]


def _arcs(cones: Cones) -> NDArray[np.float64]:
    """Return the arcs of readings that returned as straight pieces (n, 2, 2)."""
    arcs = cones.arcs()
    return np.stack((arcs[:, :-1], arcs[:, 1:]), axis=2).reshape(-1, 2, 2)
