"""What files of a user are together: ranges, poses, odometry, as text, .mat or .npz, and what is missing."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from prf.poses.inputs import sort_files
from prf.readings import read_readings
from prf.readings.describe import find_spoiling
from prf.readings.directions import VIEWS, bend, guess_angles, usual_angles
from prf.readings.poses import read_poses
from prf.readings.units import Unit, unit_of
from prf.shell.errors import InputError
from prf.shell.poses.files import read_pose_file
from prf.shell.poses.named import named_arrays
from prf.simulate.sensors import LaserPhysics, simulate_laser
from tests.poses.drives import ROOM

TURN = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
TRUTH = np.column_stack([4.2 + 2.6 * np.cos(TURN), 2.6 + 1.9 * np.sin(TURN), TURN + np.pi / 2])
STEPS = np.vstack([TRUTH[:1], np.tile([0.25, 0.01, 0.1], (59, 1))])
DIRECTIONS = np.arange(-90.0, 90.0)


def scans(view: float = 180.0, beams: int = 180, walls: np.ndarray = ROOM) -> np.ndarray:
    """Return ranges (60, beams) from half the view to the right to a step short of its other end."""
    seen = np.radians(view * (beams - 1) / beams)
    physics = LaserPhysics(beams=beams, max_range=30.0, field_of_view=seen, noise=0.01)
    turned = TRUTH - [0.0, 0.0, np.radians(0.5 * view / beams)]
    return simulate_laser(np.asarray(walls, float), turned, physics, np.random.default_rng(0))


RANGES = scans()


def text(folder: Path, name: str, values: np.ndarray) -> str:
    np.savetxt(folder / name, values, fmt="%.6f")
    return str(folder / name)


def test_three_text_files_are_known_and_have_a_command(tmp_path: Path) -> None:
    files = [text(tmp_path, "odom.txt", STEPS), text(tmp_path, "a.txt", RANGES), text(tmp_path, "b.txt", TRUTH)]
    found = sort_files(files)
    assert (found.log, found.poses, found.odometry) == (files[1], files[2], files[0])
    assert found.missing == ""
    assert found.beam_angles == "-90:1:89"
    flags = "--pose-noise 0.1 0.02 --odometry wheels"
    assert found.command(flags=flags) == (
        f"prf sample --laser {files[1]} --beam-angles -90:1:89 --poses {files[2]} "
        f"--set trajectory.file={files[0]} {flags} -o a-poses"
    )
    assert sort_files(files[:2]).command(flags="--odometry wheels") == (
        f"prf sample --laser {files[1]} --beam-angles -90:1:89 --poses {files[0]} --odometry wheels -o a-odometry"
    )
    assert sort_files(files).command() == (
        f"prf sample --laser {files[1]} --beam-angles -90:1:89 --poses {files[2]} -o a"
    )


def test_what_is_missing_is_said_with_the_command_to_ask_again(tmp_path: Path) -> None:
    ranges, poses = text(tmp_path, "a.txt", RANGES), text(tmp_path, "b.txt", TRUTH)
    alone = sort_files([ranges])
    assert alone.missing.startswith("poses: a pose a scan")
    assert alone.command("info") == f"prf info {ranges} --beam-angles -90:1:89 --poses POSES"
    alone = sort_files([poses])
    assert alone.missing.startswith("readings: ")
    assert alone.command("info") == f"prf info LOG --poses {poses}"
    few = sort_files([ranges, text(tmp_path, "c.txt", TRUTH[:-1])])
    assert "60 scans" in few.missing
    assert "59 poses" in few.missing


def test_two_of_a_kind_and_what_is_nothing_are_refused(tmp_path: Path) -> None:
    ranges, other = text(tmp_path, "a.txt", RANGES), text(tmp_path, "b.txt", RANGES)
    with pytest.raises(InputError, match="ranges already"):
        sort_files([ranges, other])
    (tmp_path / "word.txt").write_text("nothing of use\n")
    with pytest.raises(InputError, match="text of an unknown format"):
        sort_files([str(tmp_path / "word.txt")])
    with pytest.raises(InputError, match="2 columns, expected a pose"):
        sort_files([text(tmp_path, "two.txt", TRUTH[:, :2])])
    (tmp_path / "table.csv").write_text("x,y,theta,range\n1,2,0,3\n")
    with pytest.raises(InputError, match="ranges beside a log"):
        sort_files([ranges, str(tmp_path / "table.csv")])


def test_files_of_poses_are_no_tables_of_readings(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text("t,x,y,theta\n0,1,2,0\n1,1,2,0\n")
    found = sort_files([str(tmp_path / "way.csv")])
    assert found.rows[0][1] == "poses: 2 rows (CSV)"
    matrices = np.tile([1.0, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 0], (4, 1))
    assert sort_files([text(tmp_path, "kitti.txt", matrices)]).rows[0][1] == "poses: 4 rows (KITTI)"


def motions() -> np.ndarray:
    motion = np.tile(np.eye(4)[..., None], (1, 1, len(TRUTH)))
    cosine, sine = np.cos(TRUTH[:, 2]), np.sin(TRUTH[:, 2])
    motion[0, 0], motion[0, 1], motion[1, 0], motion[1, 1] = cosine, -sine, sine, cosine
    motion[:2, 3] = TRUTH[:, :2].T
    return motion


def structs() -> np.ndarray:
    made = np.empty(len(RANGES), object)
    for k, row in enumerate(RANGES):
        made[k] = {"Ranges": row, "Angles": np.radians(DIRECTIONS), "Count": 180.0}
    return made


LAYOUTS = {
    "rows": {"r": RANGES, "pose": TRUTH, "angles": DIRECTIONS},
    "columns": {"r": RANGES.T, "pose": TRUTH.T, "bearing": np.radians(DIRECTIONS)},
    "structs": {"scans": structs(), "pose": TRUTH},
    "fields": {"data": {"laser": {"r": RANGES, "theta": np.radians(DIRECTIONS)}, "T": motions()}},
    "plane": {"r": RANGES, "T": np.delete(np.delete(motions(), 2, 0), 2, 1), "phi": DIRECTIONS},
    "odometry too": {"r": RANGES, "pose": TRUTH, "odo": STEPS, "ang": DIRECTIONS},
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_mat_holds_ranges_directions_and_poses_by_name(tmp_path: Path, layout: str) -> None:
    path = str(tmp_path / "all.mat")
    savemat(path, LAYOUTS[layout])
    found = sort_files([path])
    assert (found.log, found.poses, found.beam_angles, found.missing) == (path, path, None, "")
    assert found.odometry == (path if layout == "odometry too" else None)
    readings = read_readings(path, poses=read_poses(path, 2.0))
    np.testing.assert_allclose(readings.range, RANGES.ravel())
    np.testing.assert_allclose(readings.origin[::180], TRUTH[:, :2], atol=1e-9)
    directions = np.radians(DIRECTIONS) + TRUTH[:, 2:]
    np.testing.assert_allclose(np.exp(1j * readings.angle), np.exp(1j * directions.ravel()), atol=1e-9)


def test_arrays_of_numpy_and_odometry_of_the_same_file(tmp_path: Path) -> None:
    path = str(tmp_path / "all.npz")
    np.savez(path, ranges=RANGES, poses=TRUTH, odometry=STEPS)
    found = sort_files([path])
    assert (found.poses, found.odometry, found.beam_angles) == (path, path, "-90:1:89")
    np.testing.assert_allclose(read_pose_file(path).poses[:, :2, 3], TRUTH[:, :2])
    way = read_pose_file(path, is_odometry=True)
    assert way.layout == "odometry: x y theta, rows taken as steps"


def test_a_mat_of_version_7_3_is_read_where_h5py_is(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "new.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["r"], file["pose"] = RANGES.T, TRUTH.T
        file["note"] = np.array([[104, 105]], np.uint16)
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    assert set(named_arrays(path.read_bytes(), "new.mat")) == {"r", "pose"}
    assert sort_files([str(path)]).missing == ""


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"a": RANGES, "b": RANGES + 1.0}, r"several arrays may be ranges \(a 60 x 180, b 60 x 180\)"),
        ({"a": TRUTH, "b": TRUTH + 1.0}, r"several arrays may be poses \(a 60 x 3, b 60 x 3\)"),
        ({"a": np.ones(5)}, "no array may be ranges"),
        ({"a": "words"}, "no array of numbers"),
    ],
)
def test_arrays_that_do_not_say_what_they_are_are_named(tmp_path: Path, content: dict, words: str) -> None:
    path = str(tmp_path / "a.mat")
    savemat(path, content)
    with pytest.raises(InputError, match=words):
        sort_files([path]) if "poses" not in words else read_pose_file(path)


def test_a_damaged_mat_is_one_line(tmp_path: Path) -> None:
    whole = io.BytesIO()
    savemat(whole, {"r": RANGES})
    (tmp_path / "a.mat").write_bytes(whole.getvalue()[:5000])
    with pytest.raises(InputError, match=r"a\.mat: damaged or cut off"):
        sort_files([str(tmp_path / "a.mat")])


# Where beams point.


@pytest.mark.parametrize("view", VIEWS)
def test_straight_walls_show_the_field_of_view(view: float) -> None:
    ranges = scans(view, 360, 2.5 * ROOM[:4] - 5.0)
    bent = {each: bend(ranges, each) for each in VIEWS}
    assert min(bent, key=lambda each: bent[each]) == view
    assert bent[view] < 0.02


def test_scans_at_poses_show_the_sense_and_the_first_beam() -> None:
    assert guess_angles(RANGES, TRUTH)[0] == "-90:1:89"
    assert guess_angles(RANGES[:, ::-1], TRUTH)[0] == "90:-1:-89"
    around = scans(360.0, 360)
    assert guess_angles(around, TRUTH)[0] == "-180:1:179"
    assert guess_angles(np.roll(around, -180, axis=1), TRUTH)[0] == "0:1:359"
    assert guess_angles(RANGES)[1].endswith("counter-clockwise about straight ahead is assumed")


def test_ranges_without_walls_are_taken_for_half_a_turn() -> None:
    assert guess_angles(np.full((3, 181), np.inf))[0] == usual_angles(181) == "-90:1:90"


def test_a_first_column_that_rises_is_time(tmp_path: Path) -> None:
    path = text(tmp_path, "a.txt", np.column_stack([0.5 * np.arange(60), RANGES]))
    poses = read_poses(text(tmp_path, "b.txt", TRUTH), 2.0)
    readings = read_readings(path, poses=poses, beam_angles="-90:1:89")
    np.testing.assert_allclose(readings.time[::180], 0.5 * np.arange(60))
    assert "the first column is time" in readings.notes.remarks
    columns = text(tmp_path, "c.txt", RANGES.T)
    np.testing.assert_allclose(
        read_readings(columns, poses=poses, beam_angles="-90:1:89").range, RANGES.ravel(), atol=1e-6
    )


@pytest.mark.parametrize("name", ["time", "t", "timestamp", "# stamp", "t [ms]", '"time"'])
@pytest.mark.parametrize("n", [60, 10])
def test_a_first_line_of_names_is_a_header_and_says_what_is_time(tmp_path: Path, name: str, n: int) -> None:
    unit = 1e-3 if "ms" in name else 1.0
    rows = np.column_stack([0.5 * np.arange(n) / unit, RANGES[:n]])
    header = ",".join([name, *(f"r{i}" for i in range(180))])
    np.savetxt(tmp_path / "a.csv", rows, fmt="%.6f", delimiter=",", header=header, comments="")
    files = [str(tmp_path / "a.csv"), text(tmp_path, "b.txt", TRUTH[:n])]
    assert sort_files(files).rows[0][1].startswith(f"ranges: {n} scans of 180 beams")
    readings = read_readings(files[0], poses=read_poses(files[1], 2.0), beam_angles="-90:1:89")
    np.testing.assert_allclose(readings.time[::180], 0.5 * np.arange(n))
    np.testing.assert_allclose(readings.range, RANGES[:n].ravel(), atol=1e-6)
    assert readings.notes.scans.line[0] == 2


def test_a_header_of_a_pose_or_a_beam_a_row_is_none_of_ranges(tmp_path: Path) -> None:
    names = ["scan,t,x,y,theta,sd_x,sd_y,sd_theta,cov_xy,cov_xt,cov_yt", "theta,range,t,a,b,c,d,e,f"]
    for header, kind in zip(names, ("poses: ", "a table"), strict=True):
        rows = np.tile(np.arange(len(header.split(","))) + 1.0, (30, 1))
        np.savetxt(tmp_path / "a.csv", rows, fmt="%g", delimiter=",", header=header, comments="")
        assert sort_files([str(tmp_path / "a.csv")]).rows[0][1].startswith(kind)


def test_a_header_of_tum_is_no_csv(tmp_path: Path) -> None:
    turn = 0.5 * TRUTH[:, 2]
    zero = np.zeros(60)
    rows = np.column_stack([np.arange(60.0), TRUTH[:, :2], zero, zero, zero, np.sin(turn), np.cos(turn)])
    np.savetxt(tmp_path / "a.txt", rows, header="timestamp tx ty tz qx qy qz qw")
    assert sort_files([str(tmp_path / "a.txt")]).rows[0][1] == "poses: 60 rows (TUM)"
    np.savetxt(tmp_path / "a.csv", rows, header="t,x,y,z,qx,qy,qz,qw", comments="", delimiter=",")
    assert sort_files([str(tmp_path / "a.csv")]).rows[0][1] == "poses: 60 rows (CSV)"


def test_a_file_that_is_not_read_is_named_with_its_line_and_what_the_others_are(tmp_path: Path) -> None:
    names = ",".join(f"r{i}" for i in range(179))
    np.savetxt(tmp_path / "a.csv", RANGES, fmt="%.3f", delimiter=",", header=names, comments="")
    with pytest.raises(InputError) as caught:
        sort_files([str(tmp_path / "a.csv"), text(tmp_path, "b.txt", TRUTH)])
    words = str(caught.value)
    assert "line 1 begins 'r0,r1" in words
    assert "has 179 fields, line 2 has 180 numbers" in words
    assert words.endswith("b.txt is poses, 60 rows (x y theta).")


@pytest.mark.parametrize("jitter", [0.0, 0.5])
def test_headings_in_degrees_are_known_by_the_way_or_by_turns(tmp_path: Path, jitter: float) -> None:
    rng = np.random.default_rng(2)
    heading = np.cumsum(rng.normal(0.0, 0.5, 400))
    step = 0.5 * np.column_stack([np.cos(heading), np.sin(heading)])
    place = np.cumsum(step, axis=0) + rng.normal(0.0, jitter, step.shape)
    found = read_pose_file(text(tmp_path, "a.txt", np.column_stack([place, np.degrees(heading)])))
    assert "headings in degrees" in found.layout
    np.testing.assert_allclose(found.poses[:, 0, 0], np.cos(heading), atol=1e-6)


# Units of ranges.

UNITS = {"metres": 1.0, "centimetres": 100.0, "millimetres": 1000.0}


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_of_ranges_is_that_in_which_scans_agree_at_their_poses(tmp_path: Path, unit: str) -> None:
    files = [text(tmp_path, "a.txt", UNITS[unit] * RANGES), text(tmp_path, "b.txt", TRUTH)]
    found = sort_files(files)
    assert found.beam_angles == "-90:1:89"
    readings = read_readings(files[0], poses=read_poses(files[1], 2.0), beam_angles=found.beam_angles)
    np.testing.assert_allclose(readings.range, RANGES.ravel(), atol=1e-6)
    in_words = f"in {unit}, in which scans agree at their poses"
    assert readings.notes.range_unit == ("" if unit == "metres" else in_words)


def test_a_street_in_metres_stays_and_without_another_fitting_unit_none_is_compared() -> None:
    street = np.full((4, 9), 30.0) + np.arange(9.0)
    assert unit_of(street, None, lambda _: np.radians(DIRECTIONS[:9])) is None
    assert unit_of(1000.0 * street, None, lambda _: DIRECTIONS) == Unit(
        "millimetres", "since half of them are above 33,000"
    )
    assert unit_of(0.001 * street, None, lambda _: DIRECTIONS) is None
    assert unit_of(np.full((4, 9), np.nan), None, lambda _: DIRECTIONS) is None


def test_poses_of_other_scans_show_no_unit_and_nothing_is_converted(tmp_path: Path) -> None:
    files = [
        text(tmp_path, "a.txt", 1000.0 * RANGES),
        text(tmp_path, "b.txt", np.random.default_rng(3).permutation(TRUTH)),
    ]
    readings = read_readings(files[0], poses=read_poses(files[1], 2.0), beam_angles="-90:1:89")
    assert readings.notes.range_unit == ""
    np.testing.assert_allclose(readings.range, 1000.0 * RANGES.ravel(), atol=1e-3)
    assert "range-unit" in [each.code for each in find_spoiling(readings)]


def test_dropped_ranges_and_several_numbers_for_no_return_leave_the_unit(tmp_path: Path) -> None:
    ranges = 1000.0 * RANGES
    ranges[:, :3], ranges[5, 20:60], ranges[::2, 100:110] = 0.0, 65535.0, np.nan
    files = [text(tmp_path, "a.txt", ranges), text(tmp_path, "b.txt", TRUTH)]
    readings = read_readings(files[0], poses=read_poses(files[1], 2.0), beam_angles="-90:1:89")
    assert readings.notes.range_unit.startswith("in millimetres")
    assert readings.largest_range == pytest.approx(65.535)
