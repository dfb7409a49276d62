"""Point observations on the command line: sampled alone and with a laser, resumed, stored, drawn, refused."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.configuration import Configuration
from prf.model.coloring import black_at, from_polygons
from prf.model.window import Window
from prf.output.run import read_run
from prf.readings import Readings
from prf.readings.table import write_table
from prf.results.geojson import read_map_feature
from prf.sampler.prepare import read_prepared
from tests.cli.calls import call, prf
from tests.readings.bags import LEVEL, START, Maker, Note, yaw
from tests.readings.samples import flaser
from tests.reference.beams import Sensor, draw_readings, impacts
from tests.reference.slow_points import Flips, Normal, lattice

ROOM = Window(0.0, 0.0, 10.0, 10.0)
QUICK = ("--scale", "0.2", "--chains", "2", "--resolution", "0.5", "-q")
N = 20


def write_points(file: Path, xy: np.ndarray, values: np.ndarray) -> str:
    rows = [f"{x!r},{y!r},{value!r}\n" for (x, y), value in zip(xy.tolist(), values.tolist(), strict=True)]
    file.write_text("x,y,value\n" + "".join(rows))
    return str(file)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A bitmap of a square with a tenth of its pixels flipped, the same with normal noise, and a laser beside it."""
    folder, rng = tmp_path_factory.mktemp("points"), np.random.default_rng(1)
    square = from_polygons(shapely.box(2.9, 3.1, 7.2, 6.9), ROOM)
    xy = lattice(N, 0.0, 10.0)
    black = black_at(square, xy)
    origin, angle = np.full((40, 2), 1.5), np.arange(40) * 2.0 * np.pi / 40
    laser = draw_readings(Sensor(20.0), impacts(square, origin, angle, 20.0), rng)
    write_table(folder / "laser.csv", Readings.from_arrays(origin, angle, laser))
    return {
        "bits": write_points(folder / "bits.csv", xy, Flips(0.1).draw(black, rng)),
        "grey": write_points(folder / "grey.csv", xy, Normal(sigma=0.5).draw(black, rng)),
        "laser": str(folder / "laser.csv"),
    }


@pytest.fixture(scope="module")
def bits_run(files: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "bits"
    args = ("--point-data", files["bits"], *QUICK, "--steps", "80000", "--seed", "5")
    assert prf("sample", *args, "-o", str(folder)) == 0
    return folder


def test_a_run_on_points_alone_finds_the_square_and_records_its_input(bits_run: Path, files: dict[str, str]) -> None:
    run = read_run(bits_run)
    assert run.draws.window == pytest.approx((*ROOM,))
    assert (run.manifest["n_points"], run.manifest["n_points_outside"], run.manifest["n_beams"]) == (N * N, 0, 0)
    assert run.manifest["configuration"]["points_kind"] == "binary"
    assert run.manifest["configuration"]["points_sigma"] is None
    (used,) = run.manifest["inputs"]
    assert used["sha256"] == hashlib.sha256(Path(files["bits"]).read_bytes()).hexdigest()
    assert run.points is not None
    assert run.laser is run.sonar is run.sensors is None
    assert run.points.value.shape == (N * N,)
    assert run.image is not None
    assert run.image.occupancy[10, 10] > 0.95
    assert run.image.occupancy[2, 2] < 0.05


@pytest.mark.slow
def test_resuming_gives_what_an_uninterrupted_run_gives(bits_run: Path, files: dict[str, str], tmp_path: Path) -> None:
    folder = str(tmp_path / "bits")
    args = ("--point-data", files["bits"], *QUICK, "--seed", "5", "-o", folder, "--threads", "1")
    assert prf("sample", *args, "--steps", "20000") == 0
    assert prf("sample", "--resume", folder, "--point-data", files["bits"], "--steps", "80000", "-q") == 0
    for name in ("draws.npz", "posterior.npz", "readings.npz", "map.geojson"):
        assert (tmp_path / "bits" / name).read_bytes() == (bits_run / name).read_bytes(), name


def test_laser_and_points_in_one_posterior(files: dict[str, str], tmp_path: Path) -> None:
    folder = tmp_path / "both"
    window = ("--window", "0", "0", "10", "5")
    inputs = ("--laser", files["laser"], "--point-data", files["grey"])
    assert prf("sample", *inputs, *window, *QUICK, "--steps", "20000", "--seed", "1", "-o", str(folder)) == 0
    run = read_run(folder)
    assert (run.manifest["n_beams"], run.manifest["n_points"], run.manifest["n_points_outside"]) == (40, 200, 200)
    assert run.manifest["configuration"]["points_kind"] == "gaussian"
    assert run.manifest["configuration"]["points_sigma"] == pytest.approx(0.5, abs=0.1)
    assert [used["path"] for used in run.manifest["inputs"]] == [files["laser"], files["grey"]]
    alone = read_prepared([files["laser"]], Configuration.of()).config.prior.window
    assert read_prepared([files["laser"]], Configuration.of(), (), files["grey"]).config.prior.window == alone


def test_anneal_finds_the_square(files: dict[str, str], tmp_path: Path) -> None:
    target = tmp_path / "square.geojson"
    args = ("--point-data", files["grey"], "--scale", "0.2", "--chains", "1", "--steps", "60000", "--seed", "1")
    assert prf("anneal", *args, "-o", str(target), "-q") == 0
    best, properties = read_map_feature(target)
    assert properties["inputs"][0]["path"] == files["grey"]
    assert properties["configuration"]["points_kind"] == "gaussian"
    middle = black_at(best, [[5.0, 5.0], [3.5, 3.5], [6.5, 6.5], [1.0, 1.0], [9.0, 9.0], [5.0, 1.0]])
    assert middle.tolist() == [True, True, True, False, False, False]
    assert best.n_edges < 12


def test_info_describes_the_file(files: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert prf("info", "--point-data", files["bits"], "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "prf.info.points/1"
    assert (found["n_points"], found["n_places"], found["kind"]) == (N * N, N * N, "binary")
    assert found["extent"] == [0.25, 0.25, 9.75, 9.75]
    assert prf("info", "--point-data", files["grey"]) == 0
    assert "gaussian, unless given" in capsys.readouterr().out
    assert prf("info", files["bits"]) == 3
    assert "given as --point-data" in capsys.readouterr().err


# Thinning as `prf sample` and `prf anneal` do it: reported, recorded, repeated by --resume, switched off.


THINNING_QUICK = ("--chains", "1", "--resolution", "0.5", "--seed", "3")
ALL = 5580
"""Beams of the office's log."""
EXACT = ("--set", "thinning.beam_density=0")
DENSITY = ("--set", "thinning.beam_density=4")
"""Of it that log has some fifteen."""


@pytest.fixture
def log(data_dir: Path) -> Path:
    return data_dir / "demo-office.log.gz"


def test_what_was_left_out_is_reported_and_recorded(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert prf("sample", "--laser", log, *THINNING_QUICK, *DENSITY, "--steps", 10, "-o", folder, "--json") == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert found["n_beams"] + found["n_beams_thinned"] == ALL
    assert 1000 < found["n_beams"] < 2500
    assert f"{found['n_beams']:,} of 5,580 beams (thinned)" in captured.err
    (reason,) = (line for line in captured.err.splitlines() if line.startswith("thinned to about "))
    assert "--set thinning.beam_density=0 keeps all" in reason
    run = read_run(folder)
    assert run.laser is not None
    assert len(run.laser.range) == run.manifest["n_beams"] == found["n_beams"]
    assert run.manifest["n_beams_thinned"] == found["n_beams_thinned"]


@pytest.mark.slow
def test_resuming_repeats_a_thinned_run(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, halved = tmp_path / "whole", tmp_path / "halved"
    for folder, steps in ((whole, 40_000), (halved, 20_000)):
        assert prf("sample", "--laser", log, *THINNING_QUICK, *DENSITY, "--steps", steps, "-o", folder, "-q") == 0
    capsys.readouterr()
    assert prf("sample", "--resume", halved, "--laser", log, *DENSITY, "--steps", 40_000, "--json") == 0
    assert json.loads(capsys.readouterr().out)["n_beams_thinned"] > 0
    for name in ("draws.npz", "posterior.npz", "readings.npz"):
        assert (whole / name).read_bytes() == (halved / name).read_bytes(), name
    assert prf("sample", "--resume", halved, *EXACT, "--steps", 40_000) == 2
    assert "the run to resume has 4.0" in capsys.readouterr().err


# One command makes a useful picture, also of a log whose poses are odometry or in a file.


WIDTH, DEPTH = 6.0, 4.0
"""Of a room with its corner in the origin."""
N_BEAMS = 36
BEARINGS = np.linspace(-np.pi, np.pi, N_BEAMS, endpoint=False)
AHEAD = np.linspace(-np.pi / 2, np.pi / 2, N_BEAMS + 1)
WAY = np.array([(1.0 + 0.8 * k, 1.0 + 0.4 * k, 0.3 * k) for k in range(6)])
"""Poses of the laser, a second apart."""
SMALL = (
    "--steps 40000 --chains 1 --seed 1 --set sampler.start=grid --max-range 20 --scale 0.2 --window -1 -1 7 5 "
    "--resolution 0.1"
)


def ranges(pose: np.ndarray, bearings: np.ndarray = BEARINGS) -> np.ndarray:
    """Return the distances to the walls of the room."""
    ahead = np.stack([np.cos(pose[2] + bearings), np.sin(pose[2] + bearings)])
    walls = np.array([[0.0, 0.0], [WIDTH, DEPTH]])[:, :, None]
    with np.errstate(divide="ignore"):
        return ((walls - pose[:2, None]) / ahead).max(axis=0).min(axis=0).round(4)


BEAMS = [(pose, angle, far) for pose in WAY for angle, far in zip(AHEAD, ranges(pose, AHEAD), strict=True)]


def carmen(folder: Path, is_right: bool = True) -> str:
    lines = [flaser(ranges(p, AHEAD), p if is_right else (9 - k, 9, 0), time=k) for k, p in enumerate(WAY)]
    (folder / "a.log").write_text("".join(lines))
    return "a.log"


def odometry_bag(folder: Path) -> str:
    make = Maker("ros1")
    step = {"angle_min": BEARINGS[0], "angle_increment": BEARINGS[1] - BEARINGS[0], "range_max": 20.0}
    notes = [Note("/tf_static", START, make.tf(START, "base_link", "laser", (0.0, 0.0, 0.3), LEVEL))]
    for k, pose in enumerate(WAY):
        now = START + k
        notes.append(Note("/tf", now, make.tf(now, "odom", "base_link", (*pose[:2], 0.0), yaw(pose[2]))))
        notes.append(Note("/scan", now, make.scan(now, ranges(pose), **step)))
    make.write(folder / "a.bag", notes)
    return "a.bag"


def with_poses(layout: str) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        if layout == "tum":
            rows = [f"{k} {x} {y} 0 0 0 {np.sin(a / 2)} {np.cos(a / 2)}\n" for k, (x, y, a) in enumerate(WAY)]
        else:
            rows = [f"VERTEX_SE2 {k} {x} {y} {a}\n" for k, (x, y, a) in enumerate(WAY)]
        (folder / "way.txt").write_text("".join(rows))
        return f"{carmen(folder, is_right=False)} --poses way.txt"

    return write


LOGS: dict[str, tuple[Callable[[Path], str], str]] = {
    "CARMEN": (carmen, ""),
    "ROS 1 without map": (odometry_bag, "poses are those of 'odom', odometry, which drifts"),
    "TUM": (with_poses("tum"), "way.txt (TUM, 6 poses) matched by time"),
    "g2o": (with_poses("g2o"), "way.txt (g2o, 6 poses) matched by order"),
}


@pytest.mark.parametrize("kind", LOGS)
def test_one_command_makes_a_picture(kind: str, tmp_path: Path) -> None:
    write, words = LOGS[kind]
    done = call(f"prf sample --laser {write(tmp_path)} -o run {SMALL}", tmp_path)
    assert done.code == 0, done.err
    assert words in done.err
    assert (tmp_path / "run" / "posterior.png").stat().st_size > 10_000
    image = read_run(tmp_path / "run").image
    assert image is not None
    for share, low, high in ((0.5, 0.0, 0.02), (1.0, 0.7, 1.0)):
        ends = [
            p[:2] + (share * r + 0.07 * share) * np.array([np.cos(p[2] + a), np.sin(p[2] + a)]) for p, a, r in BEAMS
        ]
        column, row = ((np.array(ends) + 1.0) / 0.1).astype(int).T
        assert low <= image.occupancy[row, column].mean() <= high, "free half way, a wall where beams end"
