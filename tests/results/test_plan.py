"""Plans of walls: which walls and doors of draws are the same, where they usually lie, and shares; as files."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from prf.model.coloring import Draws
from prf.model.walls import WallDraws, map_of_walls, united
from prf.model.window import Window
from prf.output.export import Options, export_source
from prf.output.report.plan import plan_section
from prf.output.run import Run
from prf.results.plan import doors_of, plan_of, plan_of_walls
from prf.results.read import read_run_data
from prf.results.write import write_run
from prf.shell.errors import InputError, UsageError

WINDOW = Window(0.0, 0.0, 10.0, 8.0)
PLAN = np.array(
    [
        [1.0, 1.0, 4.0, 1.0, 0.2],  # a wall with a door of 0.9 m ...
        [4.9, 1.0, 9.0, 1.0, 0.2],
        [1.0, 1.0, 1.0, 6.0, 0.1],  # ... joined to another
        [9.0, 1.0, 9.0, 6.05, 0.1],
        [1.0, 6.0, 8.15, 6.0, 0.1],  # which a door of 0.8 m parts from the wall at its side
    ]
)


def run_of(draws: list[np.ndarray]) -> Run:
    n = len(draws)
    return Run(
        manifest={"configuration": {}},
        draws=Draws.from_colorings([united(map_of_walls(walls, WINDOW)) for walls in draws]),
        chain=np.zeros(n, np.int32),
        step=np.arange(n),
        functionals={"log_posterior": -np.arange(float(n))},
        walls=WallDraws.of(draws),
    )


def shaken(rng: np.random.Generator, n: int) -> list[np.ndarray]:
    """Draws of the plan: walls 1 cm to either side, thickness by 5 mm; the last wall is absent in a quarter of them."""
    draws = []
    for k in range(n):
        walls = PLAN.copy()
        normal = np.stack([-(PLAN[:, 3] - PLAN[:, 1]), PLAN[:, 2] - PLAN[:, 0]], axis=1)
        by = 0.01 * rng.standard_normal(len(PLAN))[:, None] * normal / np.hypot(*normal.T)[:, None]
        walls[:, :2] += by
        walls[:, 2:4] += by
        walls[:, 4] += 0.005 * rng.standard_normal(len(PLAN))
        draws.append(walls[: 4 if k % 4 == 3 else 5])
    return draws


def test_walls_have_the_median_of_the_draws_and_the_share_that_has_them() -> None:
    plan = plan_of(run_of(shaken(np.random.default_rng(1), 100)))
    assert [wall.probability for wall in plan.walls] == [1.0, 1.0, 1.0, 1.0, 0.75]
    for wall, true in zip(plan.walls, PLAN, strict=True):
        np.testing.assert_allclose(wall.ends.ravel(), true[:4], atol=0.02)
        assert wall.thickness == pytest.approx(true[4], abs=0.002)
        assert wall.thickness_sd == pytest.approx(0.005, rel=0.3)
        assert wall.offset_sd == pytest.approx(0.01, rel=0.3)
    widths = sorted(door.width for door in plan.doors)
    assert widths == pytest.approx([0.8, 0.9], abs=0.02)
    assert sorted(door.probability for door in plan.doors) == [0.75, 1.0]


def test_a_wall_in_pieces_is_the_same_wall_and_one_askew_is_not() -> None:
    whole = np.array([[1.0, 2.0, 7.0, 2.0, 0.1]])
    pieces = np.array([[1.0, 2.03, 4.0, 2.03, 0.1], [4.1, 1.99, 7.0, 1.99, 0.1]])
    askew = np.array([[1.0, 1.5, 7.0, 2.5, 0.1]])
    aside = np.array([[1.0, 2.15, 7.0, 2.15, 0.1]])
    plan = plan_of(run_of([whole, whole, pieces, askew, aside]))
    assert plan.walls[0].probability == pytest.approx(0.6)
    thicker = np.array([[1.0, 2.15, 7.0, 2.15, 0.4]])
    seen_from_below = plan_of(run_of([whole, thicker])).walls[0]
    assert seen_from_below.probability == 1.0
    assert seen_from_below.ends[0, 1] - 0.5 * seen_from_below.thickness == pytest.approx(1.95)


def test_a_wall_keeps_its_line_where_the_best_draw_took_furniture_for_its_end() -> None:
    """Nine draws have a wall up to 4 m and a box beside where it went on; the best one has a wall of 6 m alone."""
    wall, box = [2.0, 1.0, 2.0, 4.0, 0.1], [1.9, 4.4, 1.9, 6.0, 0.2]
    draws = [np.array([[2.0, 1.0, 2.0, 7.0, 0.1]]), *[np.array([wall, box])] * 9]
    (found,) = plan_of(run_of(draws)).walls
    np.testing.assert_allclose(found.ends[:, 0], 2.0, atol=1e-9)
    assert found.ends[0, 1] == pytest.approx(1.0)
    assert found.thickness == pytest.approx(0.1)
    assert found.ends[1, 1] == pytest.approx(6.0, abs=0.1)


def test_a_door_is_a_gap_of_the_width_of_doors_between_jambs() -> None:
    for gap, expected in ((0.3, 0), (0.9, 1), (2.5, 0)):
        walls = np.array([[1.0, 1.0, 3.0, 1.0, 0.1], [3.0 + gap, 1.0, 6.0, 1.0, 0.1]])
        ends = np.array([[1.0, 0.5, 1.0, 4.0, 0.1], [6.0, 0.5, 6.0, 4.0, 0.1]])
        assert len(doors_of(np.concatenate([walls, ends]))) == expected
        assert len(doors_of(walls)) == 0, "furniture"
    assert len(plan_of_walls(PLAN).doors) == 2
    assert len(doors_of(np.zeros((0, 5)))) == 0


def test_a_run_of_walls_is_read_as_it_was_written_and_exported(tmp_path: Path) -> None:
    run = run_of(shaken(np.random.default_rng(2), 20))
    write_run(tmp_path / "walls", run)
    read = read_run_data(tmp_path / "walls")
    assert read.walls is not None
    assert run.walls is not None
    np.testing.assert_array_equal(read.walls.wall, run.walls.wall)
    np.testing.assert_array_equal(read.walls.offsets, run.walls.offsets)
    target = str(tmp_path / "plan.geojson")
    found = export_source(tmp_path / "walls", target, Options(walls=True))
    assert found.facts["n_walls"] == 5
    assert found.facts["n_doors"] == 2
    features = json.loads(Path(target).read_text())["features"]
    assert [each["properties"]["layer"] for each in features] == ["wall"] * 5 + ["door"] * 2
    assert {"thickness", "thickness_sd", "offset_sd", "probability"} < features[0]["properties"].keys()
    export_source(tmp_path / "walls", str(tmp_path / "one.geojson"), Options(walls=True, draw=3))
    with pytest.raises(UsageError, match="--layer walls is for"):
        export_source(tmp_path / "walls", str(tmp_path / "plan.svg"), Options(walls=True))
    assert "5 walls of" in plan_section(run)


def test_the_drawing_has_its_layers(tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    write_run(tmp_path / "walls", run_of(shaken(np.random.default_rng(2), 20)))
    target = tmp_path / "plan.dxf"
    export_source(tmp_path / "walls", str(target), Options(walls=True))
    document = ezdxf.readfile(target)
    layers = [entity.dxf.layer for entity in document.modelspace()]
    assert {name: layers.count(name) for name in ("WALLS", "CENTRE_LINES", "DOORS", "OUTLINE")} == {
        "WALLS": 5,
        "CENTRE_LINES": 5,
        "DOORS": 2,
        "OUTLINE": 1,
    }
    assert not document.audit().errors


def test_maps_of_polygons_have_no_plan() -> None:
    run = run_of(shaken(np.random.default_rng(2), 2))
    bare = dataclasses.replace(run, walls=None)
    assert plan_section(bare) == ""
    with pytest.raises(InputError, match="--prior walls"):
        plan_of(bare)
