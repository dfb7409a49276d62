"""`prf render --terminal`: runs, grids and maps as text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prf.cli import app
from prf.coloring import Coloring, write_geojsonl
from prf.coloring.polygons import from_segments
from prf.occupancy import OccupancyGrid, write_grid
from prf.render import terminal
from prf.run import Points, write_run
from prf.shell import console
from prf.shell.errors import InputError
from prf.shell.run import run_app
from prf.shell.terminal import Screen
from prf.window import Window
from tests.factories import make_run
from tests.shell.terminals import ESCAPE, run_on_terminal

ASCII = Screen(40, None, None, blocks=False, braille=False)
COLOURS = Screen(40, None, "truecolor", blocks=True, braille=True)
ROOM = Window(0.0, 0.0, 16.0, 8.0)


def render(*args: object) -> int:
    return run_app(app, "prf", ["render", *map(str, args)])


@pytest.fixture
def room() -> Coloring:
    """A block of 4 x 4 m, its lower left corner at (2, 2), in white."""
    corners = np.array([[2.0, 2.0], [6.0, 2.0], [6.0, 6.0], [2.0, 6.0]])
    return from_segments(np.stack((corners, np.roll(corners, -1, axis=0)), axis=1), ROOM)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_run(tmp_path / "run", make_run())
    return tmp_path / "run"


def plain(lines: list) -> list[str]:  # type: ignore[type-arg] # of rich's Text
    return [line.plain.rstrip() for line in lines]


def test_a_map_to_the_character(room: Coloring) -> None:
    lines = plain(terminal.map_lines([room], ["a block"], ASCII._replace(columns=16), title="Maps"))
    assert lines == ["Maps", "a block", "", "  @@@@", "  @@@@", "", "|---| 5 m"]


def test_half_covered_pixels_are_grey(room: Coloring) -> None:
    lines = plain(terminal.map_lines([room], [""], ASCII._replace(columns=8)))
    assert lines[-3:-1] == [" ++", " ++"], "pixels of 2 x 2 m, two in a cell"


def test_maps_are_drawn_side_by_side(room: Coloring) -> None:
    lines = plain(terminal.map_lines([room, room], ["one", "two"], ASCII._replace(columns=80)))
    assert lines[0].split() == ["one", "two"]
    assert all(line[:39].rstrip() == line[41:] for line in lines[1:])


@pytest.mark.parametrize("columns", [8, 40, 97])
def test_every_picture_of_a_run_fits(columns: int) -> None:
    run = make_run()
    for screen in (ASCII._replace(columns=columns), COLOURS._replace(columns=columns, rows=15)):
        pictures = [
            terminal.posterior_lines(run, screen),
            terminal.posterior_lines(run, screen, squares=True, path=True, beams=True, title="T"),
            terminal.best_lines(run, screen, path=True),
            terminal.reading_lines(run, screen, outline=True),
            terminal.cell_lines(run.image, screen, title="Cells"),
        ]
        for lines in pictures:
            assert max(line.cell_len for line in lines) <= columns
            assert screen.rows is None or len(lines) < screen.rows
        for line in terminal.draw_lines(run, screen, n_draws=5):
            assert line.cell_len <= columns


def test_the_picture_is_that_of_the_image() -> None:
    """Dark where the posterior is, up to the mean over a pixel and the steps of the shades."""
    run = make_run(resolution=0.5)
    assert run.image is not None
    lines = plain(terminal.posterior_lines(run, ASCII._replace(columns=80), outline=False))[2:-1]
    shades = " .:-=+*#%@"
    found = np.array([[shades.index(letter) for letter in line.ljust(80)] for line in lines])
    cells = run.image.occupancy[::-1].astype(np.float64).reshape(25, 2, 80)
    assert found.shape == (25, 80)
    np.testing.assert_array_equal(found, np.clip(cells.mean(axis=1) * 10 + 1e-6, 0, 9).astype(int))


def test_sonar_and_points_are_drawn_too() -> None:
    run = make_run()
    points = Points(np.array([[0.0, 0.0]]), np.array([1.0]))
    lines = plain(terminal.reading_lines(replace(run, beams=None, points=points), ASCII, path=False))
    assert sum(line.count("*") for line in lines[2:-1]) == 1
    with pytest.raises(InputError):
        terminal.reading_lines(replace(run, beams=None), ASCII)


def test_a_run_without_draws_is_reported() -> None:
    run = replace(make_run(), image=None, best=None)
    for function in (terminal.posterior_lines, terminal.best_lines):
        with pytest.raises(InputError):
            function(run, ASCII)
    with pytest.raises(InputError):
        terminal.draw_lines(make_run(n_draws=0), ASCII)


@pytest.mark.parametrize("what", ["posterior", "squares", "best", "draws", "beams"])
def test_in_a_pipe_there_are_plain_characters(folder: Path, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    console.reset()
    assert render(folder, "--terminal", "--what", what) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert told.out.isascii()
    assert "\x1b" not in told.out
    assert max(map(len, told.out.splitlines())) <= 80


def test_grids_and_draws_from_the_prior(tmp_path: Path, room: Coloring, capsys: pytest.CaptureFixture[str]) -> None:
    occupancy = np.full((4, 8), 0.5, np.float32)
    occupancy[0, 0], occupancy[3, 7] = 0.0, 1.0
    none = np.zeros((4, 8), np.int32)
    write_grid(tmp_path / "g.npz", OccupancyGrid(occupancy, none, none, np.zeros(2), 1.0, {"method": "count"}))
    assert render(tmp_path / "g.npz", "--terminal", "--width", 8, "--title", "G") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "G"
    assert lines[2:4] == ["+++++++#", ":+++++++"] or lines[2:4] == ["+++++++#", "-+++++++"]
    write_geojsonl(tmp_path / "d.geojsonl", [room, room])
    assert render(tmp_path / "d.geojsonl", "--terminal", "--caption", "left", "--caption", "right") == 0
    assert capsys.readouterr().out.split()[:2] == ["left", "right"]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--terminal", "-o", "x.png"], "leave -o and -f out"),
        (["--terminal", "-f"], "leave -o and -f out"),
        (["--width", "40"], "--width goes with --terminal"),
        (["--terminal", "--width", "3"], "--width"),
    ],
)
def test_options_that_exclude_each_other(
    folder: Path, args: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert render(folder, *args) == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert words in told.err


def test_on_a_terminal_it_is_coloured_and_fits(folder: Path) -> None:
    code, written = run_on_terminal("prf", "render", folder, "--terminal", size=(20, 66))
    seen = ESCAPE.sub("", written).replace("\r\n", "\n").splitlines()
    assert code == 0
    assert "\x1b[38;2;" in written
    assert "▀" in written
    assert any("⠀" < letter <= "⣿" for letter in written), "the best map's edges, in braille"
    assert len(seen) < 20
    assert max(map(len, seen)) <= 66
    code, written = run_on_terminal("prf", "render", folder, "--terminal", environment={"NO_COLOR": "1"})
    assert (code, "\x1b" in written) == (0, False)
    assert set("░▒▓█") & set(written)
