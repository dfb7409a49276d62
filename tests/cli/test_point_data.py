"""Point observations on the command line: sampled alone and with a laser, resumed, stored, drawn, refused."""

from __future__ import annotations

import hashlib
import json
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
from tests.cli.calls import prf
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


def test_resuming_refuses_other_points_and_another_model(
    bits_run: Path, files: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prf("sample", "--resume", str(bits_run), "--point-data", files["grey"], "-q") == 3
    assert "not the log that the run was made from. Leave --point-data out" in capsys.readouterr().err
    settings = tmp_path / "other.toml"
    settings.write_text("[points]\nflip_probability = 0.2\n")
    assert prf("sample", "--resume", str(bits_run), "--config", str(settings), "-q") == 2
    assert "[points] flip_probability 0.2: the run to resume has 0.1" in capsys.readouterr().err


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
    alone = read_prepared(files["laser"], Configuration.of(), None, None).config.prior.window
    assert read_prepared(files["laser"], Configuration.of(), None, files["grey"]).config.prior.window == alone


def test_settings_reach_the_model(files: dict[str, str], tmp_path: Path) -> None:
    settings, folder = tmp_path / "points.toml", tmp_path / "run"
    settings.write_text('[points]\nkind = "gaussian"\nmean_black = 2\nmean_white = -1\nsigma = 0.75\n')
    args = ("--point-data", files["bits"], "--config", str(settings), *QUICK, "--steps", "2000", "--seed", "1")
    assert prf("sample", *args, "-o", str(folder)) == 0
    stored = read_run(folder).manifest["configuration"]
    model = {name: stored[f"points_{name}"] for name in ("kind", "mean_black", "mean_white", "sigma")}
    assert model == {"kind": "gaussian", "mean_black": 2.0, "mean_white": -1.0, "sigma": 0.75}


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
