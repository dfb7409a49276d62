"""RUN directories: round trips, damage, versions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prf.model.coloring import Coloring, Draws
from prf.model.window import Window
from prf.output.run import Run, read_run
from prf.poses.plane import wrapped
from prf.readings.counts import beam_counts
from prf.results import read_map_feature, write_run
from prf.results.inspection import inspect_files
from prf.results.names import SCHEMAS
from prf.results.write import remove_stale_outputs
from prf.shell.errors import InputError, OutputError
from prf.shell.poses.files import read_pose_file
from tests.factories import WINDOW, make_run, make_trajectory


def assert_same_draws(a: Draws, b: Draws) -> None:
    assert a.window == b.window
    for name in ("vertex_offsets", "xy", "side", "edge_offsets", "edges", "anchor_black"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def edge_set(coloring: Coloring) -> set[tuple[tuple[float, ...], ...]]:
    return {tuple(sorted(map(tuple, ends.tolist()))) for ends in coloring.xy[coloring.edges]}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_run(tmp_path / "run", make_run())
    return tmp_path / "run"


def test_round_trip_is_exact(folder: Path) -> None:
    written, read = make_run(), read_run(folder)
    assert_same_draws(written.draws, read.draws)
    np.testing.assert_array_equal(written.chain, read.chain)
    np.testing.assert_array_equal(written.step, read.step)
    np.testing.assert_array_equal(written.probe_xy, read.probe_xy)
    np.testing.assert_array_equal(written.probe_black, read.probe_black)
    assert list(read.functionals) == list(written.functionals)
    for name, values in written.functionals.items():
        np.testing.assert_array_equal(values, read.functionals[name])
    assert written.image is not None
    assert read.image is not None
    np.testing.assert_array_equal(written.image.occupancy, read.image.occupancy)
    np.testing.assert_array_equal(written.image.square_occupancy, read.image.square_occupancy)
    assert read.image.extent == written.image.extent
    assert written.laser is not None
    assert read.laser is not None
    for name in ("origin", "angle", "range", "scan", "max_range"):
        np.testing.assert_array_equal(getattr(written.laser, name), getattr(read.laser, name))
    assert read.manifest["seed"] == 1
    assert read.diagnostics is not None
    assert read.diagnostics["converged"] is True
    assert (read.name, read.n_chains) == ("run", 4)


def test_best_map_keeps_every_edge_to_the_last_bit(folder: Path) -> None:
    written, read = make_run().best, read_run(folder)
    assert written is not None
    assert read.best is not None
    assert edge_set(read.best) == edge_set(written)
    assert (read.best.anchor_black, read.best_log_posterior) == (written.anchor_black, -123.25)


@pytest.mark.parametrize("black", [False, True])
def test_a_best_map_without_edges(tmp_path: Path, black: bool) -> None:
    best = Coloring.empty(WINDOW, black)
    run = make_run(n_draws=0)
    write_run(tmp_path, Run(run.manifest, run.draws, run.chain, run.step, {}, best=best))
    read = read_run(tmp_path)
    assert read.best is not None
    assert (read.best.n_edges, read.best.anchor_black) == (0, black)
    assert np.isnan(read.best_log_posterior)


def test_a_run_interrupted_before_its_first_draw_is_valid(tmp_path: Path) -> None:
    empty = Draws.from_colorings([], WINDOW)
    run = Run({"status": "interrupted"}, empty, np.empty(0, np.int32), np.empty(0, np.int64), {"n_edges": np.empty(0)})
    write_run(tmp_path, run)
    read = read_run(tmp_path)
    assert len(read.draws) == 0
    assert (read.image, read.laser, read.best, read.diagnostics) == (None, None, None, None)
    assert {state.name: state.state for state in inspect_files(tmp_path)} == {
        "manifest.json": "ok",
        "draws.npz": "ok",
        "posterior.npz": "missing",
        "readings.npz": "missing",
        "map.geojson": "missing",
        "diagnostics.json": "missing",
        "checkpoint.npz": "missing",
        "posterior.png": "missing",
    }


def test_counts_of_beams_round_trip(tmp_path: Path) -> None:
    run = make_run()
    assert run.laser is not None
    counts = beam_counts(run.draws.window, run.laser)
    write_run(tmp_path, replace(run, counts=counts))
    read = read_run(tmp_path).counts
    assert read is not None
    for name, value in counts._asdict().items():
        np.testing.assert_array_equal(getattr(read, name), value)
    write_run(tmp_path, run)
    assert read_run(tmp_path).counts is None, "runs of earlier releases have none"


@pytest.fixture
def moved() -> Run:
    run = make_run()
    assert run.laser is not None
    return replace(run, trajectory=replace(make_trajectory(run.laser, len(run.draws)), chain=run.chain))


def test_sampled_poses_round_trip_and_their_means_are_a_table(tmp_path: Path, moved: Run) -> None:
    write_run(tmp_path, moved)
    written, read = moved.trajectory, read_run(tmp_path).trajectory
    assert written is not None
    assert read is not None
    assert read.sonar is None
    for name in ("scan", "time", "given", "draws", "laser", "chain"):
        np.testing.assert_array_equal(getattr(written, name), getattr(read, name))
    header, *rows = (tmp_path / "trajectory.csv").read_text().splitlines()
    assert header == "scan,t,x,y,theta,sd_x,sd_y,sd_theta,cov_xy,cov_xt,cov_yt"
    table = np.array([[float(field) for field in row.split(",")] for row in rows])
    np.testing.assert_array_equal(
        table, np.column_stack([read.scan, read.time, read.mean, read.sd, read.covariance[:, [0, 0, 1], [1, 2, 2]]])
    )
    poses = read_pose_file(str(tmp_path / "trajectory.csv"))
    np.testing.assert_allclose(poses.poses[:, :2, 3], read.mean[:, :2])
    states = {state.name: state.summary for state in inspect_files(tmp_path)}
    assert states["poses.npz"].startswith("12 draws; 5 poses corrected by 5")
    assert states["trajectory.csv"] == "5 poses, mean and standard deviation"


def test_poses_without_times_or_draws(tmp_path: Path, moved: Run) -> None:
    assert moved.trajectory is not None
    early = replace(moved.trajectory, time=np.full(5, np.nan), draws=moved.trajectory.draws[:0])
    write_run(tmp_path, replace(moved, trajectory=early))
    assert not (tmp_path / "trajectory.csv").exists()
    np.testing.assert_array_equal(read_run(tmp_path).path_xy, early.given[:, :2])
    write_run(tmp_path, replace(moved, trajectory=replace(moved.trajectory, time=early.time)))
    assert (tmp_path / "trajectory.csv").read_text().splitlines()[1].startswith("0,,")
    read = read_pose_file(str(tmp_path / "trajectory.csv"))
    assert (len(read.poses), read.times) == (5, None)
    remove_stale_outputs(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_readings_are_drawn_where_the_mean_poses_have_them(tmp_path: Path, moved: Run) -> None:
    assert moved.trajectory is not None
    assert moved.laser is not None
    turned = moved.trajectory.draws + np.array([0.0, 0.0, 0.5], np.float32)
    found = replace(moved, trajectory=replace(moved.trajectory, draws=turned)).placed()
    assert found.laser is not None
    np.testing.assert_allclose(found.laser.sensor_path(), found.path_xy, atol=1e-12)
    np.testing.assert_allclose(wrapped(found.laser.angle - moved.laser.angle), 0.5, atol=0.02)
    fixed = make_run()
    assert fixed.placed() is fixed


def test_fixed_poses_leave_no_file(folder: Path) -> None:
    assert not {"poses.npz", "trajectory.csv"} & {path.name for path in folder.iterdir()}
    assert not {"poses.npz", "trajectory.csv"} & {state.name for state in inspect_files(folder)}


def test_only_the_requested_parts_are_read(folder: Path) -> None:
    (folder / "posterior.npz").write_bytes(b"broken")
    read = read_run(folder, parts=("map.geojson",))
    assert read.image is None
    assert read.best is not None


def test_writing_again_replaces_whole_files_and_leaves_others(folder: Path) -> None:
    (folder / "checkpoint.npz").write_bytes(b"opaque")
    write_run(folder, make_run(seed=2, n_draws=5))
    assert len(read_run(folder).draws) == 5
    assert (folder / "checkpoint.npz").read_bytes() == b"opaque"
    assert not list(folder.glob("*.tmp")) + list(folder.glob(".*.tmp"))


def test_files_are_plain_numpy_and_json(folder: Path) -> None:
    with np.load(folder / "draws.npz", allow_pickle=False) as stored:
        assert str(stored["schema"]) == "prf.draws/1"
        assert stored["functional_n_edges"].dtype == np.float64
        assert stored["edges"].dtype == np.int32
    feature = json.loads((folder / "map.geojson").read_text())
    assert feature["type"] == "Feature"
    assert feature["geometry"]["type"] == "MultiPolygon"
    assert feature["properties"]["frame"] == "metres"
    assert json.loads((folder / "manifest.json").read_text())["schema"] == "prf.run/1"


def test_readings_beyond_the_max_range_are_no_returns(folder: Path) -> None:
    run = make_run()
    assert run.laser is not None
    far = replace(run.laser, range=np.where(run.laser.range < 2.0, run.laser.max_range, run.laser.range))
    write_run(folder, Run(run.manifest, run.draws, run.chain, run.step, {}, laser=far))
    read = read_run(folder).laser
    assert read is not None
    assert np.isinf(read.range).sum() == (far.range >= far.max_range).sum()


@pytest.mark.parametrize("name", ["manifest.json", "draws.npz", "posterior.npz", "readings.npz", "map.geojson"])
@pytest.mark.parametrize("damage", [b"", b"{}"])
def test_a_damaged_file_is_named(folder: Path, name: str, damage: bytes) -> None:
    (folder / name).write_bytes(damage)
    with pytest.raises(InputError, match=name) as caught:
        read_run(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["draws.npz", "posterior.npz", "readings.npz", "poses.npz"])
def test_a_truncated_file_is_named(folder: Path, moved: Run, name: str) -> None:
    write_run(folder, moved)
    whole = (folder / name).read_bytes()
    for size in (10, len(whole) // 2, len(whole) - 3):
        (folder / name).write_bytes(whole[:size])
        with pytest.raises(InputError, match=name):
            read_run(folder)
    assert {state.name: state.state for state in inspect_files(folder)}[name] == "damaged"


def test_unknown_versions_are_refused(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps({**manifest, "schema": "prf.run/2"}))
    with pytest.raises(InputError, match=r"manifest.json: version 2 of prf.run is not known.*reads version 1"):
        read_run(folder)


@pytest.mark.parametrize(
    ("file", "changes", "message"),
    [
        ("draws", {"schema": np.str_("prf.draws/9")}, "version 9"),
        ("draws", {"schema": np.str_("prf.posterior/1")}, "schema prf.posterior/1, expected prf.draws/1"),
        ("draws", {"edges": np.array([[0, 99_999]], dtype=np.int32)}, "edge_offsets"),
        ("draws", {"chain": np.zeros(3, np.int32)}, "array chain has shape"),
        ("draws", {"xy": None}, "array xy is missing"),
        ("draws", {"side": np.array([{}], dtype=object)}, "Object arrays"),
        ("posterior", {"resolution": np.float64(np.nan)}, "resolution"),
        ("poses", {"given": np.full((5, 3), np.nan)}, "not finite"),
        ("poses", {"draws": np.zeros((2, 4, 3), np.float32)}, "array draws has shape"),
        ("poses", {"pose_of_laser": np.zeros(199, np.int32)}, "poses of 199 readings, but the run has 200"),
    ],
)
def test_arrays_that_contradict_each_other_are_refused(
    tmp_path: Path, moved: Run, file: str, changes: dict, message: str
) -> None:
    write_run(tmp_path, moved)
    path = tmp_path / f"{file}.npz"
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    for name, change in changes.items():
        arrays[name] = change(arrays[name]) if callable(change) else change
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(InputError, match=message):
        read_run(tmp_path)


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such directory"):
        read_run(tmp_path / "none")
    with pytest.raises(InputError, match=r"no manifest\.json"):
        read_run(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"not a directory; .* If it is a result of mapq: mapq report .*file$"):
        inspect_files(tmp_path / "file")


def test_an_output_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file"):
        write_run(tmp_path / "file", make_run(n_draws=1))


def test_a_foreign_geojson_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.geojson"
    path.write_text('{"schema": "prf.map/1", "type": "Feature", "properties": {}, "geometry": {}}')
    with pytest.raises(InputError, match=r"map\.geojson: not a map"):
        read_map_feature(path)


def test_windows_far_from_the_origin_round_trip(tmp_path: Path) -> None:
    write_run(tmp_path, make_run(window=Window(4.5e5, 5.1e6, 4.5e5 + 30.0, 5.1e6 + 20.0)))
    best = make_run(window=Window(4.5e5, 5.1e6, 4.5e5 + 30.0, 5.1e6 + 20.0)).best
    read = read_run(tmp_path).best
    assert best is not None
    assert read is not None
    assert edge_set(read) == edge_set(best)


def test_every_array_and_file_is_documented(folder: Path, moved: Run, project_root: Path) -> None:
    write_run(folder, moved)
    text = (project_root / "docs" / "file-formats.md").read_text()
    for name, schema in SCHEMAS.items():
        section = text.partition(f"### {name}\n")[2].partition("\n##")[0]
        assert f"`{name}` | `{schema}`" in text
        if name.endswith(".npz"):
            with np.load(folder / name) as stored:
                for array in stored.files:
                    documented = "functional_NAME" if array.startswith("functional_") else array
                    assert f"| `{documented}` |" in section
                    assert array == "schema" or f"| {stored[array].dtype} |" in section
    for property_name in json.loads((folder / "map.geojson").read_text())["properties"]:
        assert f"`{property_name}`" in text
