"""What the experiments on logs compute themselves: contours, bytes of a map, a scan turned upright, R-hat, tables."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from benchmarks import commands, figure4, scores
from benchmarks.contours import contour_polygons, write_contours
from prf.readings import Readings, read_readings
from prf.results import write_run
from prf.results.occupancy import OccupancyGrid
from prf.results.score import read_occupied_area
from tests.factories import make_run


def grid_of(rows: list[str]) -> OccupancyGrid:
    """Return a grid of cells of 0.1 m from its rows, the highest first: # wall, . free, space unseen."""
    cells = np.array([list(row) for row in rows[::-1]])
    hits = np.where(cells == "#", 2, 0).astype(np.int32)
    misses = np.where(cells == ".", 2, 0).astype(np.int32)
    occupancy = ((hits + 0.5) / (hits + misses + 1.0)).astype(np.float32)
    return OccupancyGrid(occupancy, hits, misses, np.array([1.0, 2.0]), 0.1)


def test_contours_join_the_cells_of_a_wall_and_leave_out_what_is_unseen() -> None:
    wall = contour_polygons(grid_of(["      ", " #### ", "......"]))
    assert shapely.hausdorff_distance(wall, shapely.box(1.1, 2.1, 1.5, 2.2)) < 0.02


def test_contours_join_cells_that_touch_at_a_corner() -> None:
    rows = ["." * k + "#" + "." * (9 - k) for k in range(10)]
    slanted = contour_polygons(grid_of(rows))
    assert len(slanted.geoms) == 1
    assert len(shapely.get_coordinates(slanted)) - 1 <= 6


def test_written_contours_are_read_as_a_map(tmp_path: Path) -> None:
    grid = grid_of([".....", ".###.", "....."])
    corners = write_contours(grid, tmp_path / "map.geojson")
    area = read_occupied_area(tmp_path / "map.geojson")
    assert corners == 4
    assert area.window == grid.window
    assert area.region.area == pytest.approx(0.03, rel=0.3)


def test_bytes_count_every_corner_once(tmp_path: Path) -> None:
    holed = [[[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]], [[1, 1], [1, 2], [2, 2], [1, 1]]]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "MultiPolygon", "coordinates": [holed]}}
    path = tmp_path / "map.geojson"
    path.write_text(json.dumps(feature))
    sizes = figure4.map_bytes(path)
    assert (sizes["rings"], sizes["corners"]) == (2, 7)
    assert [sizes[f"{form}_bytes"] for form in ("int16_cm", "float32", "float64")] == [32, 60, 116]
    assert sizes["geojson_bytes"] == path.stat().st_size


def test_the_scan_of_the_hallway_is_turned_to_look_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heading, fan = 2.0, np.linspace(-math.pi / 2, math.pi / 2, 181)
    scan = Readings.from_arrays([3.0, 4.0], heading + fan, np.full(181, 2.5), scan=7)
    monkeypatch.setattr(figure4, "read_readings", lambda _: scan)
    turned = read_readings(str(figure4.upright_scan(tmp_path, 7, tmp_path / "scan.csv")))
    np.testing.assert_allclose(turned.angle, fan + math.pi / 2, atol=1e-12)
    np.testing.assert_array_equal(turned.origin, np.zeros((181, 2)))


@pytest.mark.parametrize("seen", [False, True])
def test_the_worst_r_hat_is_that_of_what_was_seen(tmp_path: Path, seen: bool) -> None:
    run = make_run(n_draws=80)
    assert run.image is not None
    stuck = run.chain < 2
    image = run.image._replace(seen=np.full_like(run.image.seen, seen))
    steady = np.random.default_rng(1).normal(size=80)
    functionals = {**run.functionals, "n_edges": stuck.astype(np.float64), "log_posterior": steady}
    run = dataclasses.replace(run, image=image, functionals=functionals, probe_black=np.repeat(stuck[:, None], 3, 1))
    write_run(tmp_path / "run", run)
    found = commands.worst_rhat(tmp_path / "run")
    assert math.isinf(found) if seen else found < 1.5


def test_the_summary_has_the_best_rival_score_by_score() -> None:
    names = (*scores.SUMMARY, "rhat")
    rows = [{"map": scores.POSTERIOR, **dict.fromkeys(names, 0.5)}]
    rows += [{"map": f"grid {k}", **dict.fromkeys(names, value)} for k, value in enumerate((0.25, 0.75))]
    cells = scores.summary({"intel": rows}).splitlines()[-1].split(" | ")
    assert cells[:3] == ["| intel", "0.50", "0.50, 0.25 (grid 0)"]
    assert cells[5:7] == ["0.500, 0.750 (grid 1)"] * 2, "of AUC and of the share within 0.2 m the most is the best"
