from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prf.cli import app
from prf.readings import write_table
from prf.results import write_run
from prf.results.occupancy import OccupancyGrid, write_grid
from prf.shell.cli.run import run_app
from prf.shell.cli.storage import save_arrays
from tests.cli.calls import prf
from tests.factories import make_run
from tests.poses.drives import ROOM, readings_at
from tests.readings.bags import START, Maker, Note, drive, yaw
from tests.readings.samples import flaser, save

JUMPY = "".join(flaser([1, 0, 81.83], (0.2 * i + 9 * (i > 5), 0, 0), time=i) for i in range(12)) + "ODD 1\n"


def run(capsys, *args: str) -> tuple[int, str, str]:
    code = run_app(app, "prf", ["info", *args])
    out, err = capsys.readouterr()
    return code, out, err


def test_table_for_a_person(capsys, tmp_path):
    code, out, err = run(capsys, save(tmp_path, JUMPY))
    assert (code, err) == (0, "")
    rows = [line.split(maxsplit=1) for line in out.splitlines()]
    assert ["scans", "12 of 3 beams"] in rows
    assert ["beams", "24 usable, 12 dropped (range 0)"] in rows
    assert "largest range   81.83 m" in out
    assert "the pose jumps before scan 6" in out
    assert "skipped: 1 ODD" in out


def test_notes_beyond_the_table_are_counted(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("prf.commands.info.MOST_LINES", 12)
    path = save(tmp_path, JUMPY)
    short, long = run(capsys, path)[1].splitlines(), run(capsys, path, "-v")[1].splitlines()
    assert len(short) == 13
    assert short[-1] == long[-1] == f"map it          prf sample --laser {path} -o some"
    notes = sum(line.startswith(("suspicious", "assumed")) for line in long)
    assert short[-2].split() == [str(notes), "notes", "more:", "prf", "info", "-v"]


def test_json_is_one_object(capsys, tmp_path):
    path = save(tmp_path, JUMPY, zipped=True)
    code, out, err = run(capsys, path, "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["schema"] == "prf.info/1"
    assert result["source"] == path
    assert (result["n_scans"], result["n_beams"], result["n_zero_ranges"]) == (12, 24, 12)
    assert result["max_range"] == pytest.approx(0.97 * 81.83)
    assert result["path_extent"]["x_max"] == pytest.approx(11.2)
    jump = next(s for s in result["suspicions"] if s["code"] == "pose-jump")
    assert jump["scans"] == [6]


SONAR = "PARAM robot_sonar_offsets 0.1 0 0.5 0.1 0 -0.5 nohost 0\nSONAR 2 1.5 2.5 1 2 0.5 1 2 0.5 3.5 host 3.5\n"


def test_sonar_with_its_ring(capsys, tmp_path):
    both = save(tmp_path, JUMPY + SONAR)
    code, out, _ = run(capsys, both, "-v")
    assert code == 0
    assert "kind            laser" in out
    assert "1 SONAR" in out
    for args in ((both, "--sonar"), (save(tmp_path, SONAR, "only.log"),)):
        code, out, _ = run(capsys, *args)
        assert code == 0
        assert "kind            sonar" in out
        assert "cone            0.349 rad" in out
        assert "max range       3.50 m, unless given by --sonar-max-range" in out
        assert "8 m or more" not in out
        assert "ring            2 transducers at x y heading (0.100 0.000 0.500), (0.100 0.000 -0.500)" in out
    _, out, _ = run(capsys, both, "--sonar", "--json")
    result = json.loads(out)
    assert (result["kind"], result["n_beams"], len(result["ring"])) == ("sonar", 2, 2)


def test_topic_and_frame_of_a_bag(capsys, tmp_path):
    make = Maker("ros1")
    scans = [Note(topic, START + 1, make.scan(START + 1, [1, 2, float("nan")])) for topic in ("/front", "/rear")]
    path = str(make.write(tmp_path / "a.bag", drive(make) + scans))
    code, out, err = run(capsys, path)
    assert (code, out) == (2, "")
    assert "/front, /rear" in err
    code, out, _ = run(capsys, path, "--topic", "/rear", "--frame", "odom", "-v")
    assert code == 0
    assert "format          ROS 1 bag (/rear)" in out
    assert "beams           2 usable, 0 dropped (range 0), 1 dropped (not a number, or too short)" in out
    assert "poses           tf from odom, interpolated in time" in out
    assert "1 /front" in out
    code, _, err = run(capsys, path, "--topic", "/rear", "--frame", "nowhere")
    assert code == 3
    assert "'nowhere'" in err
    assert err.count("\n") == 1


# Several files, and poses that jitter.

JITTER = 0.4


def jittering(folder: Path, jitter: float = JITTER, turned: float = 0.05) -> dict[str, list[str]]:
    """Write the scans of a room with poses that jitter as a table, a CARMEN log, a bag, and as texts."""
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    truth = np.column_stack([4.2 + 2.6 * np.cos(turn), 2.6 + 1.9 * np.sin(turn), turn + np.pi / 2])
    given = truth + np.random.default_rng(5).normal(size=truth.shape) * [jitter, jitter, turned]
    readings = readings_at(ROOM, truth, given, n_beams=180)
    ranges, angle = readings.range.reshape(90, 180), readings.angle.reshape(90, 180)
    write_table(folder / "a.csv", replace(readings, time=np.full(readings.n_beams, np.nan)))
    lines = (
        flaser(np.minimum(row, 30.0).tolist(), pose, time=i)
        for i, (row, pose) in enumerate(zip(ranges, given, strict=True))
    )
    (folder / "a.log").write_text("".join(lines))
    make, notes = Maker("ros1"), []
    for i, (row, pose) in enumerate(zip(ranges, given, strict=True)):
        first, step = angle[i, 0] - pose[2], angle[i, 1] - angle[i, 0]
        notes.append(Note("/tf", START + i, make.tf(START + i, "map", "laser", (*pose[:2], 0.0), yaw(pose[2]))))
        fields = {"angle_min": first, "angle_increment": step, "range_max": 30.0}
        notes.append(Note("/scan", START + i, make.scan(START + i, row.tolist(), **fields)))
    make.write(folder / "a.bag", notes)
    np.savetxt(folder / "ranges.txt", ranges)
    np.savetxt(folder / "poses.txt", given)
    return {kind: [str(folder / f"a.{kind}")] for kind in ("csv", "log", "bag")} | {
        "texts": [str(folder / "ranges.txt"), str(folder / "poses.txt")]
    }


@pytest.mark.parametrize(
    "kind", ["log", "texts", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("csv", "bag"))]
)
def test_poses_that_jitter_are_found_in_every_format_and_the_command_has_numbers(kind, capsys, tmp_path):
    files = jittering(tmp_path)[kind]
    code, out, err = run(capsys, *files, "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    of_poses = [each["code"] for each in found["suspicions"] if each["code"].startswith("pose")]
    assert of_poses == ["pose-error"]
    metres, radians = found["pose_error"]
    assert metres == pytest.approx(JITTER, rel=0.2)
    assert f"--pose-noise {metres:.2g} {radians:.2g}" in found["command"]
    assert found["command"].startswith(f"prf sample --laser {files[0]} ")


def test_headings_in_degrees_are_named_and_nothing_is_advised(capsys, tmp_path):
    table = Path(jittering(tmp_path, 0.01, 0.005)["csv"][0])
    header, *rows = table.read_text().splitlines()
    at = header.split(",").index("theta")
    words = [row.split(",") for row in rows]
    degrees = [[*row[:at], str(np.degrees(float(row[at]))), *row[at + 1 :]] for row in words]
    table.write_text("\n".join([header, *map(",".join, degrees)]))
    out = run(capsys, str(table))[1]
    assert "are they in degrees? Save them in radians" in out
    assert "pose error" not in out
    assert "map it" not in out


def test_a_file_of_poses_that_is_cut_off_is_not_named_in_the_next_command(capsys, tmp_path):
    ranges, poses = jittering(tmp_path)["texts"]
    np.savetxt(poses, np.loadtxt(poses)[:-1])
    out = run(capsys, ranges, poses)[1]
    assert "90 scans" in out
    assert "89 poses, which is not one each; is a file cut off?" in out
    assert f"then            prf info {ranges} --poses POSES" in out


def test_good_poses_are_mapped_as_given_and_sampled_by_a_command_of_its_own(capsys, tmp_path):
    ranges, poses = jittering(tmp_path, 0.06, 0.005)["texts"]
    odometry = str(tmp_path / "odom.txt")
    np.savetxt(odometry, np.loadtxt(poses))
    for files, more in (((ranges, poses), ""), ((ranges, poses, odometry), " --odometry wheels")):
        found = json.loads(run(capsys, *files, "--json")[1])
        metres, radians = found["pose_error"]
        assert metres < 0.1
        assert f"--noise 0.0{np.ceil(100 * metres):.0f} -o" in found["command"]
        assert "--odometry" not in found["command"]
        assert f"--pose-noise {metres:.2g} {radians:.2g}{more} -o" in found["command_poses"]
    out = run(capsys, ranges, poses)[1]
    assert "poses too       prf sample --laser" in out
    assert "compiles for minutes more" in out


def test_advice_beside_odometry_alone_is_that_of_the_command(capsys, tmp_path):
    ranges, poses = jittering(tmp_path)["texts"]
    Path(poses).rename(tmp_path / "odom.txt")
    out = run(capsys, ranges, str(tmp_path / "odom.txt"))[1]
    assert "--pose-noise" not in out
    assert "sample them with the map, prf sample --odometry wheels" in out


def test_files_that_are_no_log_by_themselves_are_said_to_be_what_they_are(capsys, tmp_path):
    ranges, poses = jittering(tmp_path)["texts"]
    code, out, err = run(capsys, ranges)
    assert (code, err) == (0, "")
    assert out.splitlines()[0].partition(", up")[0].endswith("ranges: 90 scans of 180 beams")
    assert "missing         poses: " in out
    assert f"then            prf info {ranges} --beam-angles -90:1:89 --poses POSES" in out
    document = json.loads(run(capsys, poses, "--json")[1])
    assert document["schema"] == "prf.info.files/1"
    assert document["missing"].startswith("readings")
    code, out, err = run(capsys, ranges, poses)
    assert "map it          prf sample --laser" in out
    assert "--beam-angles -90:1:89 --poses" in out


def test_a_log_of_raw_odometry_is_shown_with_the_command_that_maps_it(capsys, tmp_path):
    lines = (f"Odometry {0.1 * i} 0 0\nLaser 3 1.0 2.0 3.0\n" for i in range(12))
    code, out, err = run(capsys, save(tmp_path, "".join(lines)))
    assert (code, err) == (0, "")
    assert "--odometry wheels -o some" in out


# `prf inspect`: the manifest and the state of every file.


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_run(tmp_path / "run", make_run())
    return tmp_path / "run"


def test_a_sound_run(folder: Path, capsys: pytest.CaptureFixture) -> None:
    assert prf("inspect", str(folder)) == 0
    assert "more entries: prf inspect -v)" in capsys.readouterr().out
    assert prf("inspect", str(folder), "-v") == 0
    shown = capsys.readouterr().out
    assert "configuration.scale" in shown
    assert "12 draws of 4 chains" in shown
    assert "checkpoint.npz    missing" in shown


def test_a_damaged_file_is_shown_and_fails(folder: Path, capsys: pytest.CaptureFixture) -> None:
    (folder / "posterior.npz").write_bytes(b"PK broken")
    assert prf("inspect", str(folder)) == 3
    shown = capsys.readouterr()
    assert "posterior.npz     damaged" in shown.out
    assert "damaged: posterior.npz" in shown.err


def test_files_of_other_versions(folder: Path, capsys: pytest.CaptureFixture) -> None:
    """A checkpoint of another release takes nothing from what can be read; draws do."""
    save_arrays(folder / "checkpoint.npz", "prf.checkpoint/1", {})
    assert prf("inspect", str(folder)) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert "checkpoint.npz    other version" in shown.out
    assert "prf.checkpoint/1: this release reads the draws, but cannot resume from here" in shown.out
    save_arrays(folder / "draws.npz", "prf.draws/9", {})
    assert prf("inspect", str(folder), "--json") == 3
    shown = capsys.readouterr()
    assert shown.err.strip().endswith("other version: draws.npz.")
    files = {file["name"]: file for file in json.loads(shown.out)["files"]}
    assert (files["draws.npz"]["state"], files["draws.npz"]["schema"]) == ("other version", "prf.draws/9")
    assert "version 9 of prf.draws is not known" in files["draws.npz"]["summary"]


def inspected(path: Path, capsys: pytest.CaptureFixture) -> dict[str, Any]:
    assert prf("inspect", str(path), "--json") == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert [file["state"] for file in found["files"]] == ["ok"]
    assert prf("inspect", str(path)) == 0
    assert path.name in capsys.readouterr().out
    return found


def test_a_grid(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    cells = np.zeros((3, 4), np.int32)
    process = {"inputs": [{"path": "a.log"}]}
    grid = OccupancyGrid((cells + 0.5).astype(np.float32), cells, cells + 1, np.zeros(2), 0.1, {"clamp": 3.5}, process)
    write_grid(tmp_path / "a.npz", grid)
    found = inspected(tmp_path / "a.npz", capsys)
    assert (found["kind"], found["manifest"]["schema"]) == ("grid", "prf.grid/1")
    assert found["manifest"]["configuration"] == {"clamp": 3.5}
    assert found["manifest"]["inputs"] == process["inputs"]
    assert found["files"][0]["summary"] == "4 x 3 cells of 0.1 m, 100.0% seen"


def test_maps(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    found = inspected(folder / "map.geojson", capsys)
    assert (found["kind"], found["files"][0]["schema"]) == ("map", "prf.map/1")
    assert found["manifest"]["n_edges"] > 0
    other = tmp_path / "plan.json"
    other.write_text('{"type": "Polygon",\n"coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]}')
    found = inspected(other, capsys)
    assert (found["kind"], found["files"][0]["schema"]) == ("map", None)
    assert found["files"][0]["summary"] == "polygons of another program: 1, together 1.0 m2"


@pytest.mark.parametrize("n", [1, 3])
def test_draws(n: int, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file = tmp_path / "draws.geojsonl"
    args = ["--scale", "1", "--window", "0", "0", "2", "1", "--draws", str(n), "--seed", "1", "-o", str(file)]
    assert prf("prior", *args, "-q") == 0
    capsys.readouterr()
    found = inspected(file, capsys)
    assert (found["kind"], found["manifest"]["window"]) == ("draws", [0.0, 0.0, 2.0, 1.0])
    assert found["files"][0]["summary"].startswith(f"{n} draws, on average ")
    file.write_text(file.read_text() + "{}\n")
    assert prf("inspect", str(file)) == 3
    assert f"draws.geojsonl:{n + 1}: " in capsys.readouterr().err
