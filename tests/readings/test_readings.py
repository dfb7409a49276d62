from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.geometry
from hypothesis import given
from hypothesis import strategies as st

from prf.model.layout import image_grid
from prf.model.window import Window
from prf.readings import Readings, describe, read_point_data, read_readings, write_table
from prf.readings.ground import seen_by_beams, seen_by_cones
from prf.readings.readings import beam_numbers
from prf.shell.errors import InputError
from tests.readings.sonar_sets import ARENA_WALLS, arena_readings, corridor8_readings
from tests.reference.slow_sonar import Cone, reach_in


def test_scalars_hold_for_every_beam():
    readings = Readings.from_arrays((1, 2), [0.1, 0.2, 0.3], [3, 4, np.inf], scan=7, cone=0.3)
    assert readings.origin.shape == (3, 2)
    np.testing.assert_array_equal(readings.scan, [7, 7, 7])
    np.testing.assert_array_equal(readings.beam, [0, 1, 2])
    assert (readings.n_beams, readings.n_scans, readings.largest_range) == (3, 1, 4.0)
    assert repr(readings) == "<prf.Readings: 3 sonar readings in 1 scans, arrays, within 0.0 x 0.0 m, up to 4.00 m>"
    assert "3 sonar readings in 1 scans" in readings._repr_html_()


def test_arrays_have_the_promised_types_and_own_their_memory():
    origin = np.zeros((2, 2))
    readings = Readings.from_arrays(origin, [0, 0], [1, 2])
    names = ("origin", "angle", "range", "time", "cone", "scan", "beam")
    assert [getattr(readings, name).dtype.str for name in names] == ["<f8"] * 5 + ["<i8", "<i4"]
    origin[:] = 5
    assert readings.origin.max() == 0


def test_shapes_that_do_not_agree():
    with pytest.raises(ValueError, match="shape"):
        Readings.from_arrays(np.zeros((2, 2)), [0, 0, 0], [1, 2, 3])


def test_no_finite_range():
    assert np.isnan(Readings.from_arrays((0, 0), [0], [np.inf]).largest_range)


@pytest.mark.parametrize("pick", [np.array([True, False, True]), np.array([2, 0])])
def test_select(pick):
    readings = Readings.from_arrays([[0, 0], [1, 1], [2, 2]], [0, 1, 2], [1, 2, 3], scan=[0, 0, 1])
    some = readings.select(pick)
    np.testing.assert_array_equal(some.range, readings.range[pick])
    np.testing.assert_array_equal(some.origin, readings.origin[pick])
    np.testing.assert_array_equal(some.beam, readings.beam[pick])
    assert some.origin.flags.c_contiguous
    assert some.notes is readings.notes


@given(st.lists(st.integers(0, 5)))
def test_beam_numbers_count_within_each_scan(scans):
    expected = [scans[:i].count(scan) for i, scan in enumerate(scans)]
    np.testing.assert_array_equal(beam_numbers(np.array(scans, dtype=np.int64)), expected)


# Cells that readings saw, against shapely.


WINDOW = Window(-2.0, 1.0, 6.0, 7.0)
GRID = image_grid(WINDOW, 0.25)


def squares() -> np.ndarray:
    x = GRID.x0 + GRID.cell * np.arange(GRID.nx)
    y = GRID.y0 + GRID.cell * np.arange(GRID.ny)
    low_x, low_y = np.meshgrid(x, y)
    return shapely.box(low_x, low_y, low_x + GRID.cell, low_y + GRID.cell)


def test_beams_see_the_cells_that_they_cross_up_to_their_end() -> None:
    rng = np.random.default_rng(1)
    origin = rng.uniform(WINDOW[:2], WINDOW[2:], (60, 2))
    angle, ranges = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.1, 12.0, 60)
    ranges[::7] = np.inf
    laser = Readings.from_arrays(origin, angle, ranges, scan=np.arange(60))
    seen = seen_by_beams(GRID, WINDOW, replace(laser, max_range=9.0))
    length = np.minimum(ranges, 9.0)
    end = origin + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    lines = shapely.linestrings(np.stack([origin, end], axis=1))
    crossed = shapely.intersects(squares()[..., None], lines).any(axis=-1)
    assert seen.shape == (GRID.ny, GRID.nx)
    assert (seen == crossed).all()
    assert 0.2 < seen.mean() < 0.95


@pytest.mark.parametrize("walked", [False, True])
def test_beams_without_a_return_see_up_to_a_wall_that_others_show(walked: bool) -> None:
    """One that meets no wall counts as far as it may; who walks by is no wall where many beams pass."""
    bearing = np.radians(np.linspace(-60.0, 60.0, 61))
    ranges = 3.0 / np.cos(bearing)  # a wall at x = 3, and nothing through a door of it
    door = np.abs(3.0 * np.tan(bearing) - 2.0) < 0.5
    ranges[[10, 30]] = np.inf
    ranges[door] = np.inf
    scans = [np.where(door, np.inf, 3.0 / np.cos(bearing)) for _ in range(6)] + [ranges]
    if walked:
        scans[0] = np.where(np.abs(bearing) < 0.15, 1.0, scans[0])
    laser = Readings.from_arrays(
        (0.0, 4.0), np.tile(bearing, 7), np.concatenate(scans), scan=np.repeat(np.arange(7), 61)
    )
    seen = seen_by_beams(GRID, WINDOW, replace(laser, max_range=9.0))
    x, y = np.array(GRID.x0) + GRID.cell * (np.arange(GRID.nx) + 0.5), GRID.y0 + GRID.cell * (np.arange(GRID.ny) + 0.5)
    behind = seen[:, x > 3.0 + GRID.cell]
    through = (y > 4.0 + 1.2) & (y < 4.0 + 5.0)
    assert not behind[~through].any()
    assert behind[through].any()
    assert seen[(y > 3.0) & (y < 5.0)][:, (x > 0.5) & (x < 2.5)].all()


def test_cones_see_no_less_than_they_cover_and_little_more() -> None:
    rng = np.random.default_rng(2)
    origin = rng.uniform(WINDOW[:2], WINDOW[2:], (12, 2))
    angle, ranges = rng.uniform(-np.pi, np.pi, 12), rng.uniform(0.3, 3.0, 12)
    ranges[0] = np.inf
    seen = seen_by_cones(GRID, WINDOW, origin, angle, np.full(12, 0.35), ranges, 3.5)
    length = np.minimum(
        ranges, [reach_in(WINDOW, Cone(*xy, turn, 0.35), 3.5) for xy, turn in zip(origin, angle, strict=True)]
    )
    turn = angle[:, None] + 0.35 * np.linspace(-0.5, 0.5, 41)
    rim = origin[:, None] + length[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    cones = shapely.union_all([shapely.Polygon([start, *ends]) for start, ends in zip(origin, rim, strict=True)])
    covered = shapely.intersects(squares(), cones)
    near = shapely.intersects(squares(), cones.buffer(GRID.cell))
    assert (seen >= covered).all()
    assert (seen <= near).all()


# Point observations as CSV: what is read, and what is refused with its line.


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "points.csv"


def test_columns_in_any_order_among_others(file: Path) -> None:
    file.write_text('\ufeff# soil\n\n"Value", station,Y , x\n0.5,a,2,1\n# later\n-1e3,b, 4 ,3\n')
    table = read_point_data(file)
    assert np.array_equal(table.xy, [[1.0, 2.0], [3.0, 4.0]])
    assert table.value.tolist() == [0.5, -1000.0]
    assert table.line.tolist() == [4, 6]
    assert table.source == str(file)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# nothing\n", "points.csv: the file is empty."),
        ("1,2,3\n4,5,6\n", "points.csv:1: the header has no column x, y, value."),
        ("x,y,value\n1,2,black\n", "points.csv:2: could not convert string 'black' to float64."),
        ("x,y,value\n1,2,3\n\n1,2,nan\n", "points.csv:4: value is nan, but must be a finite number."),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line(file: Path, text: str, words: str) -> None:
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_point_data(file)
    assert words in str(caught.value)


def test_values_that_are_no_colours_are_named_with_their_line(file: Path) -> None:
    file.write_text("x,y,value\n1,2,0\n1,2,1\n\n3,4,0.3\n")
    table = read_point_data(file)
    with pytest.raises(InputError, match=r"points.csv:5: value is 0\.3, but binary"):
        table.refuse_other_than_colours()
    table._replace(value=np.array([0.0, 1.0, 1.0])).refuse_other_than_colours()


def test_corridor(shared_data, tmp_path):
    readings = corridor8_readings(shared_data / "prf/sonar/corridor8")
    assert (readings.n_scans, readings.n_beams) == (413, 413 * 8)
    assert readings.range.min() == 0.4
    assert np.isinf(readings.range).mean() > 0.2
    assert np.ptp(readings.time) == pytest.approx(92.8, abs=0.1)
    summary = describe(readings, "corridor8")
    assert (summary.kind, summary.devices) == ("sonar", ("table",))
    write_table(tmp_path / "corridor8.csv", readings)
    again = read_readings(str(tmp_path / "corridor8.csv"), "sonar")
    np.testing.assert_array_equal(again.range, readings.range)
    np.testing.assert_array_equal(again.cone, readings.cone)


def test_arena(shared_data):
    readings = arena_readings(shared_data / "prf/sonar/arena_known_map")
    assert (readings.n_scans, readings.n_beams) == (5, 900)
    assert np.isinf(readings.range).reshape(5, -1).sum(axis=1).tolist() == [0, 13, 10, 20, 12]
    # No echo comes from nearer than the nearest wall, give or take what the placing by hand leaves.
    a, b = ARENA_WALLS[:, 0], ARENA_WALLS[:, 1]
    along = np.clip(np.sum((readings.origin[:, None] - a) * (b - a), axis=2) / np.sum((b - a) ** 2, axis=1), 0, 1)
    nearest = np.linalg.norm(a + along[..., None] * (b - a) - readings.origin[:, None], axis=2).min(axis=1)
    assert np.mean(readings.range > nearest - 0.06) > 0.98


@pytest.fixture(scope="module")
def readings(data_dir):
    return read_readings(str(data_dir / "demo-office.log.gz"))


@pytest.fixture(scope="module")
def plan(data_dir):
    feature = json.loads((data_dir / "demo-office.geojson").read_text())
    return shapely.geometry.shape(feature["geometry"])


def test_the_files_are_what_the_script_makes(data_dir, tmp_path, readings):
    subprocess.run([sys.executable, str(data_dir / "make_demo_log.py"), str(tmp_path)], check=True)
    made = read_readings(str(tmp_path / "demo-office.log.gz"))
    # Another machine's sine may turn a centimetre over, no more.
    np.testing.assert_allclose(made.range, readings.range, atol=0.011)
    np.testing.assert_allclose(made.origin, readings.origin, atol=1e-4)
    assert (tmp_path / "demo-office.geojson").read_text() == (data_dir / "demo-office.geojson").read_text()


def test_it_is_small_and_unsuspicious(data_dir, readings):
    summary = describe(readings, "demo")
    assert (summary.n_scans, summary.n_beams, summary.suspicions) == (31, 5580, ())
    assert (data_dir / "demo-office.log.gz").stat().st_size < 1e6


def test_the_plan_is_valid_and_the_robot_drives_through_free_space(readings, plan):
    assert plan.is_valid
    assert shapely.distance(plan, shapely.points(readings.origin)).min() > 0.3


def test_readings_agree_with_the_plan_but_for_outliers_and_misses(readings, plan):
    direction = np.column_stack((np.cos(readings.angle), np.sin(readings.angle)))
    rays = shapely.linestrings(np.stack((readings.origin, readings.origin + 30 * direction), axis=1))
    distance = shapely.distance(shapely.points(readings.origin), shapely.intersection(rays, plan))
    error = readings.range - np.where(np.isnan(distance), 81.83, distance)
    near = np.abs(error) < 0.15
    assert error[near].std() == pytest.approx(0.03, rel=0.05)
    assert 0.02 < np.mean(~near) < 0.06
    missed = readings.range == 81.83
    assert 0.01 < np.mean(missed[np.isfinite(distance)]) < 0.03
