"""`prf.sample`, `prf.resume` and `Run`: in memory and in folders, told of, interrupted, asked."""

from __future__ import annotations

import logging
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure

import prf
from prf.cli import app
from prf.output.run import read_run
from prf.results.estimate import occupied_probability
from prf.shell.cli.run import run_app
from prf.shell.errors import ArgumentError, InputError, Interrupted, OutputExists

PRIOR = prf.Prior(scale=0.2, window=(-0.5, -0.5, 6.5, 4.5))
HOW: dict[str, Any] = {"chains": 2, "seed": 1, "resolution": 0.1, "threads": 1, "progress": False}
ARRAYS = ("xy", "edges", "vertex_offsets", "edge_offsets", "anchor_black")


def room() -> prf.Readings:
    """Return what a laser sees of an empty room of 6 x 4 m."""
    pose = np.array([[1.0, 1.0, 0.0], [5.0, 3.0, 3.0]])
    angle = np.radians(np.arange(0.5, 360.0, 5.0))
    direction = np.stack([np.cos(pose[:, 2, None] + angle), np.sin(pose[:, 2, None] + angle)], axis=-1)
    far = (np.where(direction > 0.0, [6.0, 4.0], 0.0) - pose[:, None, :2]) / direction
    return prf.laser(pose, angle, far.min(axis=-1))


@pytest.fixture(scope="module")
def run() -> prf.Run:
    return prf.sample(room(), PRIOR, prf.LaserModel(max_range=9.0), steps=20_000, **HOW)


def assert_same_draws(first: Any, second: Any) -> None:
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(first.draws, name), getattr(second.draws, name), name)


def test_a_run_in_memory_is_that_of_a_folder_and_that_of_the_verb(run: prf.Run, tmp_path: Path) -> None:
    folder = tmp_path / "room"
    kept = prf.sample(
        room(), PRIOR, [prf.LaserModel(max_range=9.0)], steps=20_000, output=folder, **(HOW | {"threads": 2})
    )
    assert_same_draws(run, kept)
    assert_same_draws(run, prf.read_run(folder))
    table = tmp_path / "room.csv"
    readings = room()
    columns = np.column_stack([readings.origin, readings.angle, readings.range])
    rows = [",".join(map(repr, row)) for row in columns.tolist()]
    table.write_text("x,y,theta,range\n" + "\n".join(rows))
    words = f"--laser {table} --scale 0.2 --window -0.5 -0.5 6.5 4.5 --max-range 9 --steps 20000 --seed 1 --chains 2"
    assert run_app(app, "prf", ["sample", *words.split(), "--resolution", "0.1", "-q", "-o", str(tmp_path / "v")]) == 0
    assert_same_draws(run, read_run(tmp_path / "v"))


def test_the_repr_of_a_run_describes_it(run: prf.Run) -> None:
    assert run.manifest["status"] == "finished"
    assert run.manifest["configuration"]["noise"] == prf.LaserModel().noise
    assert run.progress is not None
    assert run.progress.step == 20_000
    assert repr(run) == f"<prf.Run: {len(run.draws)} draws, window 7 x 5 m, finished>"
    assert run.path is None
    page = run._repr_html_()
    assert "finished" in page
    assert "data:image/png;base64," in page
    assert len(page) < 100_000


def test_a_run_is_drawn_into_axes_in_metres(run: prf.Run) -> None:
    axes = Figure().add_subplot()
    assert run.plot(axes) is axes
    assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx(run.extent)
    drawn = axes.images[0]
    np.testing.assert_array_equal(drawn.get_array(), run.occupancy)
    assert (*drawn.get_extent(), drawn.origin) == (*run.extent, "lower")
    assert run.image is not None
    hatched = [part.hatches for part in axes.collections if isinstance(part, ContourSet)]
    assert hatched == ([] if run.image.seen.all() else [["////"]])


def test_a_run_answers(run: prf.Run) -> None:
    points = np.array([[3.0, 2.0], [-0.2, 2.0], [50.0, 2.0]])
    np.testing.assert_array_equal(run.query(points), occupied_probability(run.draws, points))
    assert run.query(points)[0] == 0.0
    assert np.isnan(run.query(points)[2])
    assert run.query(points.tolist(), square=0.5).shape == (3,)
    across, out = np.array([[1.0, 2.0], [5.0, 2.0]]), [[1.0, 2.0], [50.0, 2.0], [60.0, 2.0]]
    np.testing.assert_array_equal(run.paths([across, out], radius=0.2), [1.0, np.nan])
    np.testing.assert_array_equal(run.paths(across, radius=0.2), [1.0])
    assert run.paths([], radius=0.2).shape == (0,)
    assert isinstance(run.best_map, shapely.MultiPolygon)
    assert run.best_map.is_valid
    assert not run.best_map.contains(shapely.Point(3.0, 2.0))
    assert run.occupancy.shape == (50, 70)
    np.testing.assert_allclose(run.extent, (-0.5, 6.5, -0.5, 4.5), atol=1e-9)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"prior": prf.LaserModel(max_range=9.0)}, "prior: a LaserModel, must be a Prior"),
        ({"threads": -1}, "threads -1: must be at least 0"),
        ({"on_interrupt": "stop"}, "on_interrupt 'stop': must be one of return, raise"),
        ({"seed": -1}, "seed -1"),
    ],
)
def test_arguments_that_cannot_be_used_are_value_errors(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        prf.sample(room(), steps=20_000, **(HOW | given))


def test_values_by_place_are_given_once_and_are_not_too_many() -> None:
    with pytest.raises(ValueError, match="scale: given twice"):
        prf.Prior(0.1, scale=0.2)
    with pytest.raises(ValueError, match="takes 11 values, but 12 are given"):
        prf.Prior(*[0.1] * 12)


def test_a_scheduler_that_does_not_answer_costs_no_earlier_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("prf.shell.scheduler.CONNECT_SECONDS", 0.5)
    folder = tmp_path / "room"
    prf.sample(room(), PRIOR, steps=20_000, output=folder, **HOW)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match="no scheduler answers there"):
        prf.sample(room(), PRIOR, steps=20_000, output=folder, force=True, scheduler="tcp://127.0.0.1:1", **HOW)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("points", [[1.0, 2.0], [[1.0, 2.0, 3.0]], [[np.nan, 1.0]], "here"])
def test_questions_that_are_none_are_refused(run: prf.Run, points: Any) -> None:
    with pytest.raises(ArgumentError, match="points"):
        run.query(points)


@pytest.mark.parametrize("paths", [[1.0, 2.0], [[[1.0, 2.0, 3.0]]], [[[np.nan, 1.0]]], [[[1.0, 2.0]], [1.0]]])
def test_paths_that_are_none_are_refused(run: prf.Run, paths: Any) -> None:
    with pytest.raises(ArgumentError, match="paths"):
        run.paths(paths, radius=0.1)


def test_a_run_is_saved_and_opened(run: prf.Run, tmp_path: Path) -> None:
    run.save(tmp_path / "saved")
    found = prf.read_run(tmp_path / "saved")
    assert_same_draws(run, found)
    np.testing.assert_array_equal(run.occupancy, found.occupancy)
    assert found.best_map.equals(run.best_map)
    assert found.progress is None
    assert (tmp_path / "saved" / "posterior.png").is_file()
    with pytest.raises(OutputExists):
        run.save(tmp_path / "saved")
    run.save(tmp_path / "saved", force=True)
    with pytest.raises(InputError, match="checkpoint"):
        prf.resume(tmp_path / "saved", steps=40_000, progress=False)


def test_resuming_gives_what_an_uninterrupted_run_gives(run: prf.Run, tmp_path: Path) -> None:
    folder = tmp_path / "room"
    prf.sample(room(), PRIOR, prf.LaserModel(max_range=9.0), steps=10_000, output=folder, **HOW)
    whole = prf.resume(folder, steps=20_000, threads=1, progress=False)
    assert_same_draws(run, whole)
    with pytest.raises(OutputExists):
        prf.sample(room(), PRIOR, steps=2_000, output=folder, **HOW)


def test_callbacks_receive_progress(tmp_path: Path) -> None:
    told: list[tuple[float, Mapping[str, object]]] = []
    seen: list[prf.Run] = []
    prf.sample(
        room(),
        PRIOR,
        steps=20_000,
        watch=lambda session: seen.append(session.run()),
        **(HOW | {"progress": lambda share, words: told.append((share, words))}),
    )
    assert told[-1][0] == 1.0
    assert {"step", "steps/s", "log posterior"} <= set(told[-1][1])
    assert len(seen) == len(told)
    assert seen[-1].progress is not None
    assert seen[-1].progress.step == 20_000
    assert seen[0].occupancy.shape == (50, 70)


def test_an_interrupt_gives_the_run_so_far(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, logger="prf")
    before = signal.getsignal(signal.SIGINT)
    run = prf.sample(room(), PRIOR, seconds=300.0, watch=lambda _: signal.raise_signal(signal.SIGINT), **HOW)
    assert run.manifest["status"] == "interrupted"
    assert "interrupted after" in caplog.text
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_may_raise_after_the_run_is_written(tmp_path: Path) -> None:
    with pytest.raises(Interrupted, match="resume"):
        prf.sample(
            room(),
            PRIOR,
            seconds=300.0,
            output=tmp_path / "room",
            on_interrupt="raise",
            watch=lambda _: signal.raise_signal(signal.SIGTERM),
            **HOW,
        )
    assert prf.read_run(tmp_path / "room").manifest["status"] == "interrupted"


def test_a_settings_file_is_read_and_arguments_win(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_text("[prior]\nscale = 0.3\n[laser]\nnoise = 0.07\nmax_range = 8.0\n")
    run = prf.sample(room(), PRIOR, config=tmp_path / "site.toml", steps=100, **HOW)
    used = run.manifest["configuration"]
    assert (used["scale"], used["noise"], used["max_range"]) == (0.2, 0.07, 8.0)
    with pytest.raises(ValueError, match=r"^scale = -1\.0: must be above 0"):
        prf.sample(room(), prf.Prior(scale=-1.0), steps=100, **HOW)


def test_uncertain_poses_take_nothing_from_the_way_unless_asked() -> None:
    for asked, used in (({}, 0.0), ({"driven_radius": 0.1}, 0.1)):
        run = prf.sample(room(), PRIOR, pose_noise=(0.05, 0.01), steps=100, **asked, **HOW)
        assert run.trajectory is not None
        assert run.trajectory.draws.shape == (len(run.draws), 2, 3)
        configuration = run.manifest["configuration"]
        assert tuple(configuration["pose_noise"]) == (0.05, 0.01)
        assert configuration["driven_radius"] == used
    with pytest.raises(InputError, match="no heading"):
        prf.sample(room(), PRIOR, odometry="wheels", steps=100, **HOW)
    with pytest.raises(ValueError, match=r"^pose_noise"):
        prf.sample(room(), PRIOR, pose_noise=(0.05, 0.0), steps=100, **HOW)


def test_points_alone_make_a_map() -> None:
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(4.0)), axis=-1).reshape(-1, 2)
    run = prf.sample(
        prf.points(grid, grid[:, 0] > 2.5), prf.Prior(scale=0.2), prf.PointModel(kind="binary"), steps=10_000, **HOW
    )
    assert run.points is not None
    assert run.laser is None
    assert run.query([[5.0, 2.0]])[0] > 0.5 > run.query([[0.0, 2.0]])[0]
