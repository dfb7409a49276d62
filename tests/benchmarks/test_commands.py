"""The options that benchmarks give to `prf` are options that it has."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import prf.cli
from benchmarks import commands, trajectories
from benchmarks.drives import JUDGING, TUNING, Case, disturbed, loop_world
from prf.configuration import Configuration
from prf.poses.model import pose_model
from prf.poses.plane import compose, seen_from
from prf.simulate import read_world
from prf.simulate.path import read_path
from tests.poses.drives import ROOM, readings_at

TREES = {path.stem: ast.parse(path.read_text()) for path in Path(commands.__file__).parent.glob("*.py")}
CALLS = ("prf", "made", "commands.prf", "commands.made")
SETTINGS = {f"{table}.{key}" for table, model in Configuration.tables().items() for key in model.model_fields}


def tables_named(name: str, function: ast.AST, module: str) -> Iterator[ast.Dict]:
    """Yield the dictionaries assigned to a name, or returned by a property: in the function, its module or anywhere."""
    for scope in (function, TREES[module], *TREES.values()):
        found = []
        for node in ast.walk(scope):
            if isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                found += [node.value] if name in map(ast.unparse, targets) else []
            elif isinstance(node, ast.FunctionDef) and node.name == name:
                found += [each.value for each in node.body if isinstance(each, ast.Return)]
        yield from (each for each in found if isinstance(each, ast.Dict))
        if found:
            return


def option_names(node: ast.expr, *scope: Any) -> Iterator[str]:
    """Yield the keys of what is passed with `**`: a literal, a name, an attribute or an entry of a table."""
    match node:
        case ast.Dict():
            for key, value in zip(node.keys, node.values, strict=True):
                if key is None:
                    yield from option_names(value, *scope)
                elif isinstance(key, ast.Constant):
                    yield str(key.value)
        case ast.IfExp():
            yield from (*option_names(node.body, *scope), *option_names(node.orelse, *scope))
        case ast.Name(id=name) | ast.Attribute(attr=name):
            for table in tables_named(name, *scope):
                yield from option_names(table, *scope)
        case ast.Subscript(value=ast.Name(id=name)):
            for table in tables_named(name, *scope):
                yield from (each for value in table.values for each in option_names(value, *scope))


def calls() -> Iterator[tuple[str, str, set[str]]]:
    """Yield module and function, verb and option names of each call of `prf` or `made` with a verb."""
    for module, tree in TREES.items():
        for function in tree.body:
            for node in ast.walk(function):
                if (
                    isinstance(node, ast.Call)
                    and ast.unparse(node.func) in CALLS
                    and isinstance(node.args[0], ast.Constant)
                ):
                    passed = ast.Dict(
                        [ast.Constant(each.arg) if each.arg else None for each in node.keywords],
                        [each.value for each in node.keywords],
                    )
                    names = set(option_names(passed, function, module))
                    yield f"{module}.{getattr(function, 'name', '')}", str(node.args[0].value), names


def test_benchmarks_give_options_that_prf_has() -> None:
    unknown = []
    for place, verb, names in calls():
        options = {option for parameter in prf.cli.app.get_command(None, verb).params for option in parameter.opts}
        flags = {"--" + name.replace("_", "-"): name for name in names if "." not in name}
        unknown += [(place, verb, flag) for flag in set(flags) - options]
        unknown += [(place, verb, name) for name in names - set(flags.values()) - SETTINGS]
    assert unknown == []


def test_every_call_is_read() -> None:
    found = {(place, verb): names for place, verb, names in calls()}
    assert {"laser", "every_scan", "skip_scans", "max_range", "grid.method"} <= found["scores.grids", "grid"]
    assert {"laser.noise", "scale", "time_budget"} <= found["scores.sampled", "sample"]
    assert {"chains", "sampler.tiles", "laser.noise"} <= found["tiles.mapped", "sample"]


# Drives of the benchmark of trajectories: rings that can be driven round, and logs that are disturbed as said.


@pytest.mark.parametrize("seed", TUNING + JUDGING)
def test_a_ring_is_driven_round_once_and_a_bit(tmp_path: Path, seed: int) -> None:
    name = "repeating" if seed % 2 == 0 else "loop"
    files = zip((read_world, read_path), loop_world(tmp_path, name, seed), strict=True)
    world, path = (read(file) for read, file in files)
    path.check(world)
    way = shapely.LineString(path.rows)
    assert world.occupied.distance(way) > 0.2
    assert shapely.Polygon(path.rows[:5]).covers(shapely.Point(path.rows[:4].mean(axis=0)))
    assert way.length == pytest.approx(shapely.LinearRing(path.rows[:4]).length + 8.0)


def test_poses_of_a_log_are_disturbed_one_by_one(data_dir: Path, tmp_path: Path) -> None:
    drive = disturbed(tmp_path, data_dir / "demo-rooms.log.gz", Case([0.15, 0.03], "wheels"), 1)
    assert drive.poses is not None
    off = np.loadtxt(drive.poses, delimiter=",", skiprows=1) - drive.truth
    assert (off / [0.15, 0.15, 0.03]).std() == pytest.approx(1.0, abs=0.2)
    assert drive.odometry is not None
    driven = np.loadtxt(drive.odometry, delimiter=",", skiprows=1)
    np.testing.assert_allclose(driven[0], drive.truth[0], atol=1e-6)
    made, true = (seen_from(each[:-1], each[1:]) for each in (driven, drive.truth))
    away = np.hypot(*(driven - drive.truth)[:, :2].T)
    assert np.hypot(*(made - true)[:, :2].T).max() < 0.5 * away.max(), "errors add up along the way"


# Figures of the benchmark of trajectories, on poses whose errors are known.


def test_a_sharper_map_has_returns_in_fewer_squares() -> None:
    rows = np.arange(40)
    true = np.column_stack([np.linspace(1.0, 7.0, 40), np.full(40, 1.0), np.zeros(40)])
    given = true + np.random.default_rng(1).standard_normal((40, 3)) * [0.1, 0.1, 0.02]
    readings = readings_at(ROOM, true, given)
    model = pose_model(readings, None, (0.1, 0.02))
    sharp, blurred = (trajectories.n_cells(model, readings, rows, poses) for poses in (true, given))
    assert 100 < sharp < 0.7 * blurred
    assert trajectories.n_cells(model, readings, rows[:20], true[:20]) < sharp


ALONG = np.linspace(0.0, 6.0, 400)
TRUTH = np.column_stack([5.0 * np.cos(ALONG), 4.0 * np.sin(ALONG), np.full(400, 3.14)])


def test_errors_are_root_mean_squares_and_headings_are_turns() -> None:
    found = trajectories.errors(TRUTH + np.array([0.3, -0.4, 0.01 - 2.0 * np.pi]), TRUTH)
    assert (found["metres"], found["radians"]) == pytest.approx((0.5, 0.01))


def test_evo_aligns_before_it_judges() -> None:
    pytest.importorskip("evo")
    moved = compose(np.array([[1.0, 2.0, 0.7]]), TRUTH)
    noise = np.random.default_rng(1).normal(0.0, 0.02, (400, 2))
    found = trajectories.evo_errors(moved + np.column_stack([noise, np.zeros(400)]), TRUTH)
    assert found == pytest.approx({"ate": 0.02 * 2**0.5, "rpe": 0.04}, rel=0.08)


def test_intervals_hold_the_truth_as_often_as_they_should() -> None:
    sd = np.full((400, 3), 0.1)
    error = np.random.default_rng(2).normal(0.0, [0.1, 0.2, 0.1], (400, 3))
    sd[0], error[0] = 0.0, 5.0
    found = trajectories.held(TRUTH + error, sd, TRUTH)
    assert found == pytest.approx({"x": 0.95, "y": 0.67, "heading": 0.95}, abs=0.05)
