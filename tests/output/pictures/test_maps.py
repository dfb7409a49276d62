"""Pictures: valid, not empty, true to the map where a pixel can be checked."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from prf.cli import app
from prf.model.coloring import Coloring, Draws, black_at
from prf.model.window import Window
from prf.output.pictures import plot_posterior, render_beams, render_best, render_draws, render_maps, render_posterior
from prf.output.pictures.maps import columns_for, spread
from prf.output.run import Run
from prf.results import PosteriorImage, write_run
from prf.shell.cli import pictures as style
from prf.shell.cli.pictures import DPI, drawn_size, margins_of, round_length
from prf.shell.cli.run import run_app
from prf.shell.errors import InputError, UsageError
from tests.factories import WINDOW, make_run, random_draws, write_draws

WINDOWS = [Window(0.0, 0.0, 1.0, 1.0), Window(0.0, 0.0, 90.0, 6.0), Window(4.5e5, 5.1e6, 4.5e5 + 8, 5.1e6 + 90)]


def pixels(data: bytes | Path) -> np.ndarray:
    """Return a PNG as (rows, columns, 3) in 0 ... 1, checking that something is drawn on it."""
    from matplotlib.image import imread

    picture = np.asarray(imread(io.BytesIO(data) if isinstance(data, bytes) else data))[..., :3]
    assert min(picture.shape[:2]) > 150
    assert max(picture.shape[:2]) < 2600
    assert picture.std() > 0.02
    assert (picture[[0, -1]] == 1.0).all(), "the edge of the page is white: nothing is cut off"
    assert (picture[:, [0, -1]] == 1.0).all(), "the edge of the page is white: nothing is cut off"
    return picture


def draw(function, run: Run, **options) -> np.ndarray:  # type: ignore[no-untyped-def]
    stream = io.BytesIO()
    function(run, stream, **options)
    return pixels(stream.getvalue())


@pytest.mark.parametrize("window", WINDOWS, ids=["unit", "corridor", "tall-utm"])
def test_every_picture_of_every_window(window: Window) -> None:
    run = make_run(n_draws=5, window=window, resolution=max(window.width, window.height) / 100)
    draw(render_posterior, run, squares=True, outline=False, path=False)
    draw(render_best, run, path=True)
    draw(render_draws, run, n_draws=3)
    draw(render_beams, run, outline=True)


def at_points(picture: np.ndarray, window: Window, xy: np.ndarray) -> np.ndarray:
    """Return the grey value at map coordinates of a one-map page with the default margins left, bottom and top."""
    width, height = drawn_size(window)
    margins = margins_of(window)
    column = (margins.left + (xy[:, 0] - window.x_min) / window.width * width) * DPI
    row = len(picture) - (margins.bottom + (xy[:, 1] - window.y_min) / window.height * height) * DPI
    return picture[row.astype(int), column.astype(int)].mean(axis=1)


@pytest.mark.parametrize("path", [True, False])
def test_small_print_explains_colours_and_ends_before_the_edge(monkeypatch: pytest.MonkeyPatch, path: bool) -> None:
    pages = []
    monkeypatch.setattr(style, "save", lambda page, _: pages.append(page))
    window = WINDOWS[2]
    run = make_run(n_draws=5, window=window, resolution=max(window.width, window.height) / 100)
    run = replace(run, manifest={**run.manifest, "status": "not converged"})
    render_posterior(run, io.BytesIO(), path=path)
    [page] = pages
    words = [text for text in page.axes[0].texts if style.BETWEEN in text.get_text() or ": " in text.get_text()]
    assert len(words) > 1
    said = " ".join(text.get_text() for text in words)
    assert "orange: best map" in said
    assert ("blue: way driven" in said) == path
    width = page.bbox.width
    assert all(text.get_window_extent().x1 < width for text in words)


def test_the_best_map_is_black_where_it_is_black() -> None:
    run = make_run(n_draws=5)
    assert run.best is not None
    xy = np.random.default_rng(1).uniform(WINDOW[:2], WINDOW[2:], (400, 2)) * 0.998
    grey = at_points(draw(render_best, run), WINDOW, xy)
    black = black_at(run.best, xy)
    assert (np.abs(grey - np.where(black, 0.13, 1.0)) < 0.05).mean() > 0.97  # the rest lies on an edge


def test_the_posterior_is_white_grey_and_black_at_0_half_and_1() -> None:
    run = make_run(n_draws=5)
    assert run.image is not None
    values = np.tile(np.repeat([0.0, 0.5, 1.0, np.nan], 10)[None, :], (25, 1)).astype(np.float32)
    run = replace(run, image=run.image._replace(occupancy=values))
    x = WINDOW.x_min + np.array([5.5, 15.5, 25.5, 35.5])
    page = draw(render_posterior, run, outline=False, path=False)
    grey = at_points(page, WINDOW, np.column_stack((x, np.full(4, 3.3))))
    np.testing.assert_allclose(grey[:3], [1.0, 0.5, 0.0], atol=0.02)
    assert 0.85 < grey[3] < 0.97


def test_edges_of_the_best_map_end_where_nothing_was_seen() -> None:
    """Columns 0 to 4 and 9 of ten were seen: columns 6 and 7 are not beside one of them."""
    seen = np.zeros((10, 10), np.bool_)
    seen[:, :5] = seen[:, 9] = True
    cells = np.zeros((10, 10), np.float32)
    image = PosteriorImage(cells, cells, np.array([100.0, 50.0]), 1.0, seen)
    lines = np.array([[[100.5, 55.5], [109.5, 55.5]], [[106.2, 51.0], [107.8, 51.0]], [[103.0, 50.1], [103.0, 59.9]]])
    parts = [[[100.5, 55.5], [106.0, 55.5]], [[108.0, 55.5], [109.5, 55.5]], lines[2]]
    np.testing.assert_allclose(image.near_seen(lines), parts, atol=0.5)
    assert image.near_seen(lines[1:2]).shape == image.near_seen(lines[:0]).shape == (0, 2, 2)
    np.testing.assert_array_equal(image._replace(seen=~cells.astype(np.bool_)).near_seen(lines), lines)


def test_a_picture_has_no_outline_on_unseen_ground() -> None:
    run = make_run(n_draws=5)
    assert run.image is not None
    seen = np.zeros_like(run.image.seen)
    seen[:, : seen.shape[1] // 2] = True
    axes = plot_posterior(replace(run, image=run.image._replace(seen=seen)))
    outline = next(each for each in axes.collections if isinstance(each, LineCollection))
    x = np.concatenate([part[:, 0] for part in outline.get_segments()])
    left, right = run.image.extent[:2]
    assert left <= x.min() < x.max() <= 0.5 * (left + right) + 2.0 * run.image.resolution


def test_seen_cells_where_chains_differ_are_tinted() -> None:
    run = make_run(n_draws=5)
    assert run.image is not None
    blank, seen = np.zeros_like(run.image.occupancy), np.ones_like(run.image.seen)
    seen[:, 20:] = False
    differs = blank + np.where(np.arange(blank.shape[1]) % 20 < 10, 0.19, 0.21).astype(np.float32)
    image = run.image._replace(occupancy=blank, seen=seen, disagreement=differs)
    xy = np.column_stack((WINDOW.x_min + np.array([5.5, 15.5]), np.full(2, 3.3)))
    options = {"outline": False, "path": False}
    assert np.isclose(at_points(draw(render_posterior, replace(run, image=image), **options), WINDOW, xy)[0], 1.0)
    assert at_points(draw(render_posterior, replace(run, image=image), **options), WINDOW, xy)[1] < 0.9
    agreed = image._replace(disagreement=blank)
    plain = draw(render_posterior, replace(run, image=agreed), **options)
    np.testing.assert_allclose(at_points(plain, WINDOW, xy), 1.0, atol=0.02)


def test_an_unfinished_run_reports_what_is_missing(tmp_path: Path) -> None:
    empty = Run({}, Draws.from_colorings([], WINDOW), np.empty(0, np.int32), np.empty(0, np.int64), {}, path=tmp_path)
    for function, name in (
        (render_posterior, "posterior.npz"),
        (render_best, "map.geojson"),
        (render_beams, "readings"),
    ):
        with pytest.raises(InputError, match=name):
            function(empty, io.BytesIO())
    with pytest.raises(InputError, match="no draws"):
        render_draws(empty, io.BytesIO())
    with pytest.raises(UsageError, match="no map"):
        render_maps([], [], io.BytesIO())


def test_maps_without_edges_and_beams_without_returns() -> None:
    stream = io.BytesIO()
    render_maps([Coloring.empty(WINDOW), Coloring.empty(WINDOW, True)], ["white", "black"], stream)
    assert pixels(stream.getvalue()).mean() > 0.5
    run = make_run(n_draws=2)
    assert run.laser is not None
    draw(render_beams, replace(run, laser=replace(run.laser, range=np.full_like(run.laser.range, np.inf))))


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_formats_by_suffix(tmp_path: Path, suffix: str) -> None:
    target = tmp_path / f"picture.{suffix}"
    render_best(make_run(n_draws=2), target)
    assert target.read_bytes()[:5] in (b"\x89PNG\r", b"<?xml", b"%PDF-")
    assert [path.name for path in tmp_path.iterdir()] == [target.name]


@pytest.mark.parametrize("words", ["two\nlines", "a -- <b>", "20 m²"])
def test_svg_is_xml_whatever_the_title(tmp_path: Path, words: str) -> None:
    render_maps([Coloring.empty(WINDOW)], [words], tmp_path / "map.svg", title=words)
    assert ElementTree.parse(tmp_path / "map.svg").getroot().tag.endswith("svg")


@pytest.mark.parametrize(("limit", "length"), [(1.0, 1.0), (0.2, 0.2), (9.99, 5.0), (0.0049, 0.002), (50.0, 50.0)])
def test_round_length(limit: float, length: float) -> None:
    assert round_length(limit) == pytest.approx(length)


def test_panels_fill_the_rows_evenly_and_draws_are_spread() -> None:
    assert [columns_for(n, 3.4) for n in (1, 2, 3, 4, 6, 7, 9)] == [1, 2, 3, 2, 3, 3, 3]
    assert spread(10, 4) == [1, 4, 6, 9]
    assert spread(2, 4) == [0, 1]
    assert spread(0, 4) == []


@pytest.fixture
def inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_run("run", make_run(n_draws=6))
    for name, scale in (("p1", 1.0), ("p10", 10.0)):
        write_draws(f"{name}.geojsonl", random_draws(1, 5, Window(0.0, 0.0, 1.0, 1.0), scale))
    return tmp_path


def render(*args: str) -> int:
    return run_app(app, "prf", ["render", *args])


def test_command_draws_every_picture_of_a_run(inputs: Path) -> None:
    for what in ("posterior", "squares", "best", "draws", "beams"):
        assert render("run", "--what", what, "-o", f"{what}.png") == 0
        pixels(inputs / f"{what}.png")
    assert render("run", "--no-outline", "--no-path", "--title", "Office") == 0
    pixels(inputs / "run-posterior.png")


def test_command_draws_figure_1_of_the_paper(inputs: Path) -> None:
    captions = ["--caption", "p = 1", "--caption", "p = 10"]
    assert render("p1.geojsonl", "p10.geojsonl", *captions, "-o", "prior.png") == 0
    picture = pixels(inputs / "prior.png")
    assert picture.shape[1] > 1.7 * picture.shape[0]
    assert render("p10.geojsonl", "--draws", "3") == 0
    pixels(inputs / "p10.png")


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["run", "-o", "a.jpg"], 2, "no picture format .jpg"),
        (["run", "p1.geojsonl"], 2, "one RUN"),
        (["p1.geojsonl", "--caption", "a"], 2, "1 captions for 4 maps"),
        (["absent"], 3, "absent"),
        (["crossing.geojsonl"], 3, "draw 1: invalid coloring"),
    ],
)
def test_command_names_what_is_wrong(
    inputs: Path, capsys: pytest.CaptureFixture, args: list[str], code: int, message: str
) -> None:
    Path("crossing.geojsonl").write_text(
        '{"type": "Feature", "properties": {"anchor_black": true, "window": [0, 0, 1, 1]}, "geometry": '
        '{"type": "MultiLineString", "coordinates": [[[0, 0.2], [1, 0.7]], [[0, 0.7], [1, 0.2]]]}}\n'
    )
    assert render(*args) == code
    assert message in capsys.readouterr().err
    assert not list(inputs.glob("*.png"))
