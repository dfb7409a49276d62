"""Occupancy grids: cell by cell against plain Python, closed forms, what is refused."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from prf.readings import Readings
from prf.results.occupancy import (
    SCHEMA,
    OccupancyGrid,
    build_grid,
    is_grid,
    occupied_probability,
    path_free,
    read_grid,
    write_grid,
)
from prf.shell.cli.storage import load_arrays, save_arrays
from prf.shell.errors import ConfigError, InputError, UsageError
from tests.factories import grid_settings
from tests.reference.slow_occupancy import cells_in_cone, cells_on_segment, clamped_log_odds

ROOM = (0.0, 0.0, 5.0, 4.0)
BEAM = Readings.from_arrays([0.25, 0.25], [0.0], [2.0])


def build(laser: Readings | None = None, sonar: Readings | None = None, **options: object) -> OccupancyGrid:
    return build_grid(laser, sonar, grid_settings(**{"window": ROOM, "max_range": 10.0, **options}))[0]


def random_grid(seed: int, shape: tuple[int, int] = (8, 10)) -> OccupancyGrid:
    occupancy = np.random.default_rng(seed).uniform(0.0, 1.0, shape).astype(np.float32)
    none = np.zeros(shape, np.int32)
    return OccupancyGrid(occupancy, none, none, np.array([-1.0, 2.0]), 0.5)


def random_readings(seed: int, n: int, longest: float, cone: float = 0.0) -> Readings:
    rng = np.random.default_rng(seed)
    origin = rng.uniform(ROOM[:2], ROOM[2:], (n, 2))
    return Readings.from_arrays(origin, rng.uniform(-4.0, 4.0, n), rng.uniform(0.1, longest, n), cone=cone)


def test_one_beam_misses_the_cells_on_its_way_and_hits_the_last() -> None:
    grid = build(BEAM, resolution=0.5)
    assert grid.occupancy.shape == (8, 10)
    np.testing.assert_array_equal(grid.misses[0], [1, 1, 1, 1, 0, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(grid.hits[0], [0, 0, 0, 0, 1, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(grid.occupancy[0, 3:6], [0.25, 0.75, 0.5])
    assert (grid.hits[1:] + grid.misses[1:]).sum() == 0
    assert grid.share_seen == 5 / 80


@pytest.mark.parametrize("reading", [5.2, 8.0, 9.99])
def test_a_beam_that_leaves_the_grid_is_free_up_to_the_border_whatever_it_reads(reading: float) -> None:
    """The window, 4.9 m wide, is rounded up to ten cells: what is beyond these is in no cell."""
    beam = Readings.from_arrays([0.25, 0.25], [0.0], [reading])
    grid = build(beam, resolution=0.5, window=(0.0, 0.0, 4.9, 4.0))
    np.testing.assert_array_equal(grid.misses[0], np.ones(10))
    assert (int(grid.hits.sum()), int(grid.misses.sum())) == (0, 10)
    assert grid.seen.sum() == 10


@pytest.mark.parametrize("reading", [2.0, 3.4, np.inf])
def test_a_cone_that_leaves_the_grid_is_free_up_to_the_border_whatever_it_reads(reading: float) -> None:
    """The ends of these readings lie outside all over the cone, or there is none."""
    cone = Readings.from_arrays([4.0, 2.125], [0.0], [reading], cone=0.3)
    grid = build(sonar=cone, resolution=0.25)
    assert (int(grid.hits.sum()), int(grid.misses[8, 16:].min())) == (0, 1)


@pytest.mark.parametrize("method", ["count", "log-odds"])
def test_beams_agree_with_plain_python(method: str) -> None:
    readings = random_readings(1, 200, 7.0)
    grid = build(readings, resolution=0.37, method=method, max_range=5.0, no_return="free")
    outcomes: dict[tuple[int, int], list[bool]] = {}
    border = shapely.box(*grid.window)
    for start, angle, reading in zip(readings.origin, readings.angle, readings.range, strict=True):
        end = start + min(reading, 5.0) * np.array([math.cos(angle), math.sin(angle)])
        inside = shapely.get_coordinates(shapely.intersection(shapely.LineString([start, end]), border))
        hit = bool(reading < 5.0 and shapely.covers(border, shapely.Point(end)))
        cells = cells_on_segment(start, inside[-1], grid.origin, 0.37)
        for cell in cells:
            outcomes.setdefault(cell, []).append(hit and cell == cells[-1])
    for row, column in itertools.product(*map(range, grid.occupancy.shape)):
        found = outcomes.get((row, column), [])
        assert (grid.hits[row, column], grid.misses[row, column]) == (sum(found), len(found) - sum(found))
        p = (sum(found) + 0.5) / (len(found) + 1.0) if method == "count" else clamped_log_odds(found, 0.7, 0.4, 3.5)
        assert grid.occupancy[row, column] == pytest.approx(p, rel=1e-6)


def test_cones_agree_with_plain_python() -> None:
    readings = random_readings(2, 40, 4.5, cone=0.5)
    grid = build(sonar=readings, resolution=0.25, sonar_thickness=0.4)
    hits, misses = np.zeros_like(grid.hits), np.zeros_like(grid.misses)
    for start, angle, reading in zip(readings.origin, readings.angle, readings.range, strict=True):
        near = min(reading, 3.5) - 0.2
        far = near + 0.4 if reading < 3.5 else 0.0
        missed, hit = cells_in_cone(start, angle, 0.5, near, far, grid.origin, 0.25, hits.shape)
        for cell in missed:
            misses[cell] += 1
        for cell in hit:
            hits[cell] += 1
    np.testing.assert_array_equal(grid.hits, hits)
    np.testing.assert_array_equal(grid.misses, misses)
    assert hits.sum() > 50
    assert misses.sum() > 500


def test_the_opening_of_the_log_counts_before_the_option() -> None:
    narrow = Readings.from_arrays([0.25, 2.0], [0.0], [2.0], cone=0.1)
    plain = Readings.from_arrays([0.25, 2.0], [0.0], [2.0])
    assert (build(sonar=narrow, sonar_cone=1.0).hits == build(sonar=plain, sonar_cone=0.1).hits).all()
    assert build(sonar=plain, sonar_cone=1.0).hits.sum() > build(sonar=narrow, sonar_cone=1.0).hits.sum()


def test_beams_without_return_are_left_out_by_default() -> None:
    silent = Readings.from_arrays([0.25, 0.25], [0.0, 1.0], [np.inf, 20.0])
    assert build(silent).share_seen == 0.0
    free = build(silent, no_return="free")
    assert free.hits.sum() == 0
    assert free.share_seen > 0.0
    assert free.misses.sum() == np.count_nonzero(free.misses) + 1, "both start in one cell"


def test_sensors_outside_the_window_are_dropped_and_counted() -> None:
    readings = Readings.from_arrays([[1.0, 1.0], [-1.0, 1.0]], [0.0, 0.0], [1.0, 3.0])
    grid, n_beams, n_outside = build_grid(readings, None, grid_settings(window=ROOM, max_range=10.0))
    assert (n_beams, n_outside, int(grid.hits.sum())) == (1, 1, 1)


def test_laser_and_sonar_share_cells() -> None:
    both, laser = build(BEAM, random_readings(3, 5, 3.0)), build(BEAM)
    sonar = build(sonar=random_readings(3, 5, 3.0))
    np.testing.assert_array_equal(both.hits, laser.hits + sonar.hits)
    np.testing.assert_array_equal(both.misses, laser.misses + sonar.misses)


def test_the_default_window_holds_sensors_and_returns() -> None:
    grid = build_grid(random_readings(1, 100, 7.0), None, grid_settings())[0]
    assert grid.window.x_min < 0.0
    assert grid.settings["max_range"] == pytest.approx(0.97 * random_readings(1, 100, 7.0).largest_range)


def test_settings_that_make_no_grid() -> None:
    bad = {"resolution": 0.0, "max_range": -1.0, "hit_probability": 0.5, "clamp": 0.0, "sonar_cone": 4.0}
    for name, value in bad.items():
        with pytest.raises(ConfigError, match=f"--{name.replace('_', '-')}"):
            build(BEAM, **{name: value})
    with pytest.raises(ConfigError, match="more than"):
        build(BEAM, resolution=1e-6)


def test_logs_that_make_no_grid() -> None:
    with pytest.raises(InputError, match="no sensor"):
        build(Readings.from_arrays([9.0, 9.0], [0.0], [1.0]))
    with pytest.raises(InputError, match="finite range"):
        build(Readings.from_arrays([1.0, 1.0], [0.0], [np.inf]), max_range=None)


@given(st.integers(0, 1000), st.floats(0.01, 4.0))
def test_squares_take_the_cells_whose_centres_they_hold_as_independent(seed: int, square: float) -> None:
    grid = random_grid(seed)
    xy = np.random.default_rng(seed).uniform(grid.window[:2], grid.window[2:], (20, 2))
    found = occupied_probability(grid, xy, square)
    for (x, y), p in zip(xy, found, strict=True):
        cells = []
        for row, column in itertools.product(range(8), range(10)):
            across, up = np.abs(grid.origin + 0.5 * np.array([column, row]) + 0.25 - [x, y])
            if max(across, up) <= 0.5 * square:
                cells.append(float(grid.occupancy[row, column]))
        own = float(grid.occupancy[int((y - 2.0) / 0.5), int((x + 1.0) / 0.5)])
        assert p == pytest.approx(1.0 - math.prod(1.0 - cell for cell in cells or [own]), abs=1e-9)


def test_centres_on_the_border_of_a_square_belong_to_it() -> None:
    occupancy = np.full((5, 5), 0.5, np.float32)
    none = np.zeros((5, 5), np.int32)
    grid = OccupancyGrid(occupancy, none, none, np.array([0.3, 0.7]), 0.1)
    middle = [[0.3 + 0.25, 0.7 + 0.25]]
    for square, n in ((0.05, 1), (0.19, 1), (0.2, 9), (0.3, 9), (0.4, 25), (9.0, 25)):
        assert occupied_probability(grid, middle, square)[0] == pytest.approx(1.0 - 0.5**n, abs=1e-9)
    corner = occupied_probability(grid, [[0.3, 0.7]], 0.2)
    assert corner[0] == pytest.approx(0.5), "beyond the grid there are no cells"


def test_points_take_their_cell_and_the_outside_is_nan() -> None:
    grid = random_grid(1)
    xy = [[-1.0, 2.0], [4.0, 6.0], [0.3, 3.1], [-1.1, 3.0], [np.nan, 3.0]]
    np.testing.assert_array_equal(
        occupied_probability(grid, xy),
        [grid.occupancy[0, 0], grid.occupancy[7, 9], grid.occupancy[2, 2], np.nan, np.nan],
    )


@pytest.mark.parametrize("radius", [0.0, 0.21, 1.0])
@pytest.mark.parametrize("path", [[[0.3, 3.1]], [[0.3, 3.1], [2.2, 4.4], [2.2, 2.7]]])
def test_paths_take_the_cells_that_the_disc_touches_as_independent(radius: float, path: list[list[float]]) -> None:
    grid = random_grid(2)
    line = shapely.LineString(path) if len(path) > 1 else shapely.Point(path[0])
    expected = 1.0
    for row, column in itertools.product(range(8), range(10)):
        left, low = grid.origin + 0.5 * np.array([column, row])
        if shapely.distance(shapely.box(left, low, left + 0.5, low + 0.5), line) <= radius:
            expected *= 1.0 - float(grid.occupancy[row, column])
    assert path_free(grid, path, radius) == pytest.approx(expected, rel=1e-9)


def test_questions_that_have_no_answer() -> None:
    grid = random_grid(1)
    assert math.isnan(path_free(grid, [[0.0, 3.0], [99.0, 3.0]], 0.1))
    with pytest.raises(InputError, match="at least one point"):
        path_free(grid, [], 0.1)
    with pytest.raises(UsageError, match="radius"):
        path_free(grid, [[0.0, 3.0]], math.nan)
    with pytest.raises(UsageError, match="square"):
        occupied_probability(grid, [[0.0, 3.0]], -1.0)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_grid(tmp_path / "room.grid.npz", build(BEAM))
    return tmp_path / "room.grid.npz"


def test_a_grid_is_read_back_as_it_was(file: Path) -> None:
    grid, found = build(BEAM), read_grid(file)
    for name in ("occupancy", "hits", "misses", "origin"):
        np.testing.assert_array_equal(getattr(found, name), getattr(grid, name))
        assert getattr(found, name).dtype == getattr(grid, name).dtype
    assert found.resolution == grid.resolution
    assert found.settings["method"] == "count"
    assert found.settings["window"] == [0.0, 0.0, 5.0, 4.0]
    assert found.settings["scans"] is None


def test_grids_are_distinguished_from_other_files(file: Path, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("PX")
    assert is_grid(file)
    assert not is_grid(tmp_path / "text")
    assert not is_grid(tmp_path)
    assert not is_grid(tmp_path / "absent")


def test_other_versions_are_refused(file: Path) -> None:
    save_arrays(file, "prf.grid/2", load_arrays(file, SCHEMA))
    with pytest.raises(InputError, match="version 2"):
        read_grid(file)
