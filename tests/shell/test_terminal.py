"""Pictures as text: what lies in which cell, how cells look on which screen, and what a stream can show."""

from __future__ import annotations

import numpy as np
import pytest
from rich.text import Text

from prf.shell import console
from prf.shell.terminal import (
    Canvas,
    Layer,
    Raster,
    Screen,
    find_screen,
    grey_raster,
    legend_of_greys,
    lines_of,
    per_row,
    put,
    scale_bar,
    side_by_side,
)
from prf.window import Window
from tests.shell.terminals import ESCAPE, Stream

ASCII = Screen(20, None, None, blocks=False, braille=False)
BLOCKS = ASCII._replace(blocks=True, braille=True)
COLOURS = BLOCKS._replace(colours="truecolor")


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    console.reset()
    for name in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")


@pytest.mark.parametrize("columns", [8, 33, 80, 211])
@pytest.mark.parametrize("rows", [None, 3, 24])
@pytest.mark.parametrize("size", [(40.0, 25.0), (1.0, 1.0), (90.0, 6.0), (2.0, 70.0)])
def test_a_canvas_fits_and_keeps_the_aspect(columns: int, rows: int | None, size: tuple[float, float]) -> None:
    canvas = Canvas.fit(Window(-3.0, 5.0, size[0] - 3.0, size[1] + 5.0), columns, rows)
    assert 1 <= canvas.columns <= columns
    assert rows is None or 1 <= canvas.rows <= rows
    assert canvas.columns * canvas.pixel >= size[0] - 0.2501 * canvas.pixel
    assert 2 * canvas.rows * canvas.pixel >= size[1] - 0.5001 * canvas.pixel
    fills_width = (canvas.columns - 1) * canvas.pixel < size[0] and canvas.columns == columns
    fills_height = rows is not None and 2 * (canvas.rows - 1) * canvas.pixel < size[1] and canvas.rows == rows
    assert fills_width or fills_height, "the largest that fits"


def slow_means(canvas: Canvas, values: np.ndarray, origin: np.ndarray, resolution: float) -> np.ndarray:
    """Return the mean over the cells whose middle lies in the pixel, one pixel at a time; nan without one."""
    means = np.full(canvas.shape, np.nan)
    for row, column in np.ndindex(canvas.shape):
        left, top = canvas.x_min + column * canvas.pixel, canvas.y_max - row * canvas.pixel
        inside = [
            values[i, j]
            for i, j in np.ndindex(values.shape)
            if left < origin[0] + (j + 0.5) * resolution < left + canvas.pixel
            and top - canvas.pixel < origin[1] + (i + 0.5) * resolution < top
        ]
        known = [value for value in inside if np.isfinite(value)]
        means[row, column] = np.mean(known) if known else np.nan
    return means


def test_means_are_those_of_the_cells_in_each_pixel() -> None:
    rng = np.random.default_rng(1)
    values, origin = rng.random((30, 42)), np.array([-2.0, 1.0])
    values[rng.random(values.shape) < 0.3] = np.nan
    canvas = Canvas.fit(Window(-2.0, 1.0, -2.0 + 42 * 0.25, 1.0 + 30 * 0.25), 14)
    assert canvas.shape == (10, 14)
    np.testing.assert_allclose(canvas.means(values, origin, 0.25), slow_means(canvas, values, origin, 0.25))


def test_an_image_coarser_than_the_pixels_is_enlarged() -> None:
    values = np.array([[0.0, 1.0], [0.5, np.nan]])
    canvas = Canvas.fit(Window(0.0, 0.0, 2.0, 2.0), 8)
    means = canvas.means(values, np.zeros(2), 1.0)
    assert means.shape == (8, 8)
    assert np.all(means[:4, :4] == 0.5)
    assert np.isnan(means[:4, 4:]).all()
    assert np.all(means[4:, :4] == 0.0)
    assert np.all(means[4:, 4:] == 1.0)


def test_points_fall_into_their_pixel_or_outside() -> None:
    canvas = Canvas.fit(Window(0.0, 0.0, 8.0, 4.0), 8)
    xy = np.array([[0.5, 3.5], [7.5, 0.5], [8.5, 1.0], [np.nan, 1.0], [3.0, -1.0]])
    row, column = canvas.places(xy)
    assert row.tolist() == [0, 3, -1, -1, -1]
    assert column.tolist() == [0, 7, -1, -1, -1]
    centre_row, centre_column = canvas.places(canvas.centres())
    assert (centre_row * 8 + centre_column).tolist() == list(range(32))


def test_a_line_goes_through_its_dots() -> None:
    canvas = Canvas.fit(Window(0.0, 0.0, 8.0, 8.0), 8)
    assert canvas.dots(np.empty((0, 2, 2))).sum() == 0
    level = canvas.dots(np.array([[[0.1, 7.9], [7.9, 7.9]]]))
    assert level.shape == (16, 16)
    assert level[0].all()
    assert level.sum() == 16
    slope = canvas.dots(np.array([[[0.1, 0.1], [7.9, 7.9]]]))
    assert np.flatnonzero(np.diag(slope[::-1])).tolist() == list(range(16))
    assert canvas.dots(np.array([[[2.0, 2.0], [2.0, 2.0]]])).sum() == 1


GREYS = np.array([[0.0, 0.25, 0.5, 0.75, 1.0, np.nan], [0.0, 0.25, 0.5, 0.75, 1.0, 0.0]])


def shown(raster: Raster, screen: Screen) -> list[str]:
    return [line.plain for line in lines_of(raster, screen)]


def test_greys_as_characters() -> None:
    assert shown(grey_raster(GREYS, ASCII), ASCII) == [" :+#@ "]
    assert shown(grey_raster(GREYS, BLOCKS), BLOCKS) == [" ░▒▓█ "]
    assert shown(grey_raster(np.full(GREYS.shape, np.nan), ASCII), ASCII) == ["??????"]
    assert legend_of_greys(ASCII) == "free ' ' .:-=+*#% '@' occupied"


def test_half_blocks_have_the_colours_of_both_pixels() -> None:
    raster = grey_raster(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), COLOURS)
    raster.rgb[0, 2] = np.nan
    line = lines_of(raster, COLOURS)[0]
    assert line.plain == " ▀▄"
    styles = [span.style for span in line.spans]
    assert [style.color and style.color.triplet.hex for style in styles] == [None, "#ffffff", "#ffffff"]
    assert [style.bgcolor and style.bgcolor.triplet.hex for style in styles] == ["#ffffff", "#000000", None]
    coarse = COLOURS._replace(blocks=False, braille=False)
    line = lines_of(raster, coarse)[0]
    assert line.plain == "   "
    assert [span.style.bgcolor.triplet.hex for span in line.spans] == ["#ffffff", "#808080", "#ffffff"]


def test_lines_are_braille_or_a_letter() -> None:
    dots = np.zeros((4, 4), np.bool_)
    dots[:, 0] = True
    dots[3, 1] = True
    raster = grey_raster(np.zeros((2, 2)), COLOURS, (Layer(dots, (232, 89, 12), "x"),))
    line = lines_of(raster, COLOURS)[0]
    assert line.plain == "⣇ "
    assert line.spans[0].style.color.triplet.hex == "#e8590c"
    assert shown(raster, BLOCKS) == ["⣇ "]
    assert shown(raster, ASCII) == ["x "]
    assert lines_of(raster, COLOURS._replace(braille=False))[0].plain == "x "


def test_a_scale_bar_is_of_round_length() -> None:
    canvas = Canvas.fit(Window(0.0, 0.0, 40.0, 10.0), 80)
    assert scale_bar(canvas, ASCII) == "|" + "-" * 18 + "| 10 m"
    assert scale_bar(canvas, BLOCKS) == "├" + "─" * 18 + "┤ 10 m"
    assert scale_bar(Canvas.fit(Window(0.0, 0.0, 0.3, 0.3), 8), ASCII).endswith(" 0.2 m")


def test_pictures_side_by_side() -> None:
    assert per_row(4, ASCII._replace(columns=80))[0] == 2
    assert per_row(4, ASCII._replace(columns=80))[1].columns == 39
    assert per_row(3, ASCII._replace(columns=30))[0] == 1
    parts = [[Text("ab"), Text("c")], [Text("d")], [Text("e")]]
    lines = side_by_side(parts, 2, 4)
    assert [line.plain for line in lines] == ["ab    d", "c     ", "", "e"]


@pytest.mark.parametrize(
    ("is_terminal", "environment", "expected"),
    [
        (True, {"COLORTERM": "truecolor"}, ("truecolor", True, True)),
        (True, {}, ("256", True, True)),
        (True, {"TERM": "xterm"}, ("standard", True, True)),
        (True, {"TERM": "linux"}, ("standard", True, False)),
        (True, {"TERM": "dumb"}, (None, True, True)),
        (True, {"NO_COLOR": "1"}, (None, True, True)),
        (False, {}, (None, False, False)),
        (False, {"COLORTERM": "truecolor"}, (None, False, False)),
        (False, {"FORCE_COLOR": "1"}, ("256", True, True)),
        (False, {"FORCE_COLOR": "1", "TERM": ""}, ("standard", True, True)),
    ],
)
def test_what_a_stream_can_show(
    is_terminal: bool, environment: dict[str, str], expected: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    screen = find_screen(Stream(is_terminal))
    assert screen[2:] == expected
    assert screen.columns == 80
    assert screen.rows == (24 if is_terminal else None)


def test_the_size_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "133")
    monkeypatch.setenv("LINES", "50")
    assert find_screen(Stream(True))[:2] == (133, 50)
    assert find_screen(Stream(False))[:2] == (133, None)
    assert find_screen(Stream(True), 60)[:2] == (60, None)
    monkeypatch.setenv("COLUMNS", "wide")
    assert find_screen(Stream(True)).columns == 80


def test_a_terminal_of_few_characters_gets_ascii() -> None:
    assert find_screen(Stream(True, "latin-1"))[3:] == (False, False)


def test_without_colours_there_is_no_escape() -> None:
    styled = Text("walls", "bold red")
    plain, coloured = Stream(False), Stream(True)
    put([styled, Text("  ")], plain, BLOCKS)
    assert plain.text() == "walls\n\n"
    put([styled], coloured, COLOURS)
    assert ESCAPE.sub("", coloured.text()) == "walls\n"
    assert "\x1b[" in coloured.text()
    latin = Stream(False, "latin-1")
    put([Text("█ 4 × 5")], latin, BLOCKS)
    assert latin.text() == "? 4 × 5\n"
