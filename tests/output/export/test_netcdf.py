"""netCDF: opened again by xarray, and by ArviZ where it is installed."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import math
from pathlib import Path

import numpy as np
import pytest

from prf.output.export import Options, export_source
from prf.output.export.netcdf import align_chains
from prf.output.run import Run
from prf.results import write_run
from prf.shell.errors import InputError
from tests.factories import make_run

xarray = pytest.importorskip("xarray")
pytest.importorskip("h5netcdf")


def make_full_run(n_draws: int) -> Run:
    run = make_run(n_draws=n_draws)
    rng = np.random.default_rng(2)
    likelihoods = {"log_prior": rng.normal(size=n_draws), "log_likelihood": rng.normal(size=n_draws)}
    manifest = {
        **run.manifest,
        "created": "2030-01-02T03:04:05+00:00",
        "versions": {"prf": "9.9"},
        "steps": 5000,
        "seed": 2**70,
    }
    diagnostics = {**run.diagnostics, "acceptance": {"split": {"proposed": 10, "accepted": 3}}}
    functionals = {**run.functionals, **likelihoods}
    return dataclasses.replace(run, manifest=manifest, functionals=functionals, diagnostics=diagnostics)


@pytest.fixture
def exported(tmp_path: Path) -> tuple[Run, Path]:
    """Return a run of 4 chains, two of them one draw longer, and its export."""
    run = make_full_run(14)
    write_run(tmp_path / "office", run)
    done = export_source(tmp_path / "office", str(tmp_path / "office.nc"), Options())
    assert done.facts == {"n_chains": 4, "n_draws_per_chain": 3, "n_draws_left_out": 2}
    assert "2 of 14 draws left out" in done.notes[0]
    return run, tmp_path / "office.nc"


def test_values_of_every_chain_and_draw(exported: tuple[Run, Path]) -> None:
    run, path = exported
    with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as posterior:
        assert set(posterior.data_vars) == {*run.functionals, "probe_black"}
        assert posterior["n_edges"].dims == ("chain", "draw")
        assert posterior["probe_black"].dims == ("chain", "draw", "probe")
        for chain in range(4):
            rows = np.flatnonzero(run.chain == chain)[:3]
            for name, values in run.functionals.items():
                np.testing.assert_array_equal(posterior[name].sel(chain=chain), values[rows])
            np.testing.assert_array_equal(posterior["probe_black"].sel(chain=chain) == 1, run.probe_black[rows])
        np.testing.assert_array_equal(posterior["probe_x"], run.probe_xy[:, 0])
        np.testing.assert_array_equal(posterior["probe_y"], run.probe_xy[:, 1])
        assert posterior["total_length"].attrs["units"] == "m"


def test_sample_stats_and_provenance(exported: tuple[Run, Path]) -> None:
    run, path = exported
    with xarray.open_dataset(path, group="sample_stats", engine="h5netcdf") as stats:
        np.testing.assert_array_equal(stats["step"][0], [1000, 2000, 3000])
        total = run.functionals["log_prior"] + run.functionals["log_likelihood"]
        np.testing.assert_array_equal(stats["lp"].sel(chain=2), total[run.chain == 2])
        assert json.loads(stats.attrs["acceptance"]) == {"split": {"proposed": 10, "accepted": 3}}
        assert stats.attrs["inference_library"] == "prf"
    with xarray.open_dataset(path, engine="h5netcdf") as root:
        assert root.attrs["schema"] == "prf.netcdf/1"
        assert (root.attrs["prf_version"], root.attrs["created_at"]) == ("9.9", "2030-01-02T03:04:05+00:00")
        assert (root.attrs["seed"], root.attrs["steps"]) == (str(2**70), 5000), "too large for a number of netCDF"
        assert json.loads(root.attrs["configuration"]) == {"scale": 0.1}
        assert root.attrs["n_draws_left_out"] == 2


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (True, "true"),
        ("\udcff", "\\udcff"),
        ({"a": [math.nan, "\udcff"]}, '{"a": [null, "\\udcff"]}'),
        (2**70, str(2**70)),
        (1.5, 1.5),
        (7, 7),
    ],
)
def test_attributes_that_the_format_does_not_take_are_text(tmp_path: Path, value: object, written: object) -> None:
    run = make_full_run(12)
    acceptance = {"acceptance": {"split": math.nan}}
    write_run(tmp_path / "run", dataclasses.replace(run, diagnostics={**run.diagnostics, **acceptance}))
    path = tmp_path / "run" / "manifest.json"
    manifest = json.loads(path.read_text())
    path.write_text(json.dumps({**manifest, "status": value, "created": value}))
    export_source(tmp_path / "run", str(tmp_path / "a.nc"), Options())
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as opened:
        assert opened.attrs["status"] == written


@pytest.mark.skipif(importlib.util.find_spec("arviz") is None, reason="ArviZ is not installed")
def test_arviz_opens_it(exported: tuple[Run, Path]) -> None:
    arviz = pytest.importorskip("arviz")
    data = arviz.from_netcdf(str(exported[1]))
    assert data.posterior["n_edges"].shape == (4, 3)


def test_chains_are_ordered_by_step_and_cut_to_the_shortest() -> None:
    run = dataclasses.replace(
        make_run(n_draws=7),
        chain=np.array([5, 5, 2, 5, 2, 2, 5], np.int32),
        step=np.array([30, 10, 10, 20, 30, 20, 40], np.int64),
    )
    chains = align_chains(run)
    np.testing.assert_array_equal(chains.numbers, [2, 5])
    np.testing.assert_array_equal(chains.rows, [[2, 5, 4], [1, 3, 0]])
    assert chains.n_left_out == 1


def test_without_draws_there_is_nothing_to_export(tmp_path: Path) -> None:
    write_run(tmp_path / "early", make_run(n_draws=0))
    with pytest.raises(InputError, match="no draws yet"):
        export_source(tmp_path / "early", str(tmp_path / "early.nc"), Options())
    assert not (tmp_path / "early.nc").exists()
