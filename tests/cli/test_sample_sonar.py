"""The verb `sample` with sonar: alone and with a laser, resumed, stored, drawn, refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.window import Window
from prf.output.run import read_run
from prf.readings import Readings
from prf.readings.table import write_table
from tests.cli.calls import prf
from tests.reference.beams import Sensor
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_data, ring_all_round
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
QUICK = ("--scale", "0.3", "--window", "0", "0", "10", "10", "--chains", "2", "--resolution", "0.5", "--max-range", "6")
N_BEAMS, N_CONES = 60, 36


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A laser's and a sonar's log of one world, as tables."""
    folder = tmp_path_factory.mktemp("logs")
    rng = np.random.default_rng(1)
    world = draw_world(0.3, ROOM, Sensor(6.0), 3, N_BEAMS // 3, rng)
    places = np.unique(world.data.readings.origin, axis=0)
    sonar = draw_data(world.coloring, Ring(), ring_all_round(places, N_CONES // 3, 0.4, rng), rng)
    scan = np.repeat(np.arange(3), N_CONES // 3)
    write_table(
        folder / "laser.csv",
        Readings.from_arrays(world.data.readings.origin, world.data.readings.angle, world.data.readings.range),
    )
    ring = Readings.from_arrays(
        sonar.readings.origin, sonar.readings.angle, sonar.readings.range, scan=scan, cone=sonar.readings.cone
    )
    write_table(folder / "ring.csv", ring)
    return str(folder / "laser.csv"), str(folder / "ring.csv")


@pytest.fixture(scope="module")
def both(logs: tuple[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "both"
    args = ("--laser", logs[0], "--sonar", logs[1], *QUICK, "--steps", "60000", "--seed", "5", "-o", str(folder), "-q")
    assert prf("sample", *args) == 0
    return folder


def test_a_run_with_both_sensors_keeps_its_readings(both: Path, logs: tuple[str, str]) -> None:
    run = read_run(both)
    assert (run.manifest["n_beams"], run.manifest["n_cones"]) == (N_BEAMS, N_CONES)
    assert [given["path"] for given in run.manifest["inputs"]] == list(logs)
    assert run.manifest["configuration"]["sonar_max_range"] == 3.5
    assert run.laser is not None
    assert run.sonar is not None
    assert (len(run.laser.angle), len(run.sonar.angle)) == (N_BEAMS, N_CONES)
    assert run.sonar.max_range == 3.5
    assert run.sonar.cone == pytest.approx(0.4)
    assert np.unique(run.sonar.scan).tolist() == [0, 1, 2]
    assert run.functionals["log_likelihood"].std() > 0.0


@pytest.mark.slow
def test_resuming_with_sonar_gives_what_an_uninterrupted_run_gives(
    logs: tuple[str, str], both: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "both"
    args = ("--laser", logs[0], "--sonar", logs[1], *QUICK, "--seed", "5", "-o", str(folder), "-q", "--threads", "1")
    assert prf("sample", *args, "--steps", "20000") == 0
    assert prf("sample", "--resume", str(folder), "--sonar", logs[1], "--steps", "60000", "-q") == 0
    for name in ("draws.npz", "posterior.npz", "readings.npz", "map.geojson"):
        assert (folder / name).read_bytes() == (both / name).read_bytes(), name


def test_sonar_alone(logs: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "ring"
    args = ("--scale", "0.3", "--chains", "2", "--resolution", "0.5", "--sonar-max-range", "3", "--every-scan", "2")
    assert prf("sample", "--sonar", logs[1], *args, "--steps", "40000", "--seed", "1", "-o", str(folder)) == 0
    assert f"{2 * N_CONES // 3} sonar readings, window" in capsys.readouterr().err
    run = read_run(folder)
    assert run.laser is None
    assert run.sonar is not None
    assert run.sonar.max_range == 3.0
    assert run.manifest["n_beams"] == 0
    assert run.manifest["configuration"]["max_range"] is None
    window, hit = run.draws.window, np.isfinite(run.sonar.range)
    assert window.contains(run.sonar.origin - 1.0).all()
    assert window.contains(run.sonar.origin + 1.0).all()
    assert hit.any()
    assert prf("sample", "--resume", str(folder), "--steps", "50000", "-q") == 0
    assert prf("inspect", str(folder)) == 0
    assert "sonar readings, " in capsys.readouterr().out
    for what in ("posterior", "beams", "best"):
        assert prf("render", str(folder), "--what", what, "-o", str(tmp_path / f"{what}.png"), "-q") == 0


def test_a_restored_chain_has_room_for_what_its_cones_see(both: Path) -> None:
    """A grown graph brings more edges than a fresh chain has room for."""
    from prf.model.layout import grow
    from prf.sampler.checkpoint import chain_arrays, restore
    from prf.sampler.ensemble import Ensemble
    from prf.sampler.prepare import make_target
    from prf.sampler.session import stored_config
    from prf.shell.cli.storage import spawn_generators

    run = read_run(both)
    config, seed = stored_config(run, both)
    sampler = Ensemble(make_target(config, run.laser, run.sonar), spawn_generators(seed, 2))
    one, two = sampler.chains
    one.chain = grow(one.chain)
    restore(two, chain_arrays(one))
    assert len(two.chain.cones.sight.line) == len(two.chain.graph.edge_length) + c.MOST_CHANGES
