"""What the chains watched, as netCDF in the groups that ArviZ expects (InferenceData: posterior and sample_stats).

Draws are maps of varying size, for which ArviZ has no place; these have one value, or one for each probe
point, a draw.
"""

from __future__ import annotations

import io
import json
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from prf import __version__
from prf.results import RunData
from prf.shell.cli.files import encoded
from prf.shell.cli.storage import jsonable
from prf.shell.errors import InputError, require

SCHEMA = "prf.netcdf/1"
ENGINE = "h5netcdf"
UNITS = {"n_edges": "1", "total_length": "m", "log_prior": "nat", "log_likelihood": "nat", "lp": "nat"}
MAX_INTEGER = 2**63 - 1
DIMENSIONS = ("chain", "draw")


def align_chains(run: RunData) -> NDArray[np.int64]:
    """Return the numbers (n_chains, n_draws) of the first draws of every chain, as many as the shortest one has.

    All chains record at the same steps, so that the first draws belong together and the longer ones ran on alone.
    """
    if len(run.chain) == 0:
        raise InputError(f"{run.name}: no draws yet: nothing can be exported. Resume with prf sample --resume.")
    numbers = np.unique(run.chain)
    by_step = np.argsort(run.step, kind="stable")
    rows = [by_step[run.chain[by_step] == number] for number in numbers]
    shortest = min(map(len, rows))
    return np.array([row[:shortest] for row in rows], dtype=np.int64)


def netcdf_bytes(run: RunData) -> tuple[bytes, tuple[int, int]]:
    """Return a netCDF 4 file, and how many chains and draws a chain it holds."""
    xarray, _, _ = (require(module, "netcdf", "--format netcdf") for module in ("xarray", ENGINE, "h5py"))
    rows = align_chains(run)
    provenance = _provenance(run)
    coordinates = {"chain": run.chain[rows[:, 0]], "draw": np.arange(rows.shape[1])}
    groups = {
        None: xarray.Dataset(attrs={**provenance, **_attributes(run, len(run.chain) - rows.size)}),
        "posterior": xarray.Dataset(_posterior(run, rows), {**coordinates, **_probe_coordinates(run)}, provenance),
        "sample_stats": xarray.Dataset(_sample_stats(run, rows), coordinates, {**provenance, **_acceptance(run)}),
    }
    # In memory: on a disk without room HDF5 crashes.
    stream = io.BytesIO()
    for name, group in groups.items():
        mode: Literal["a", "w"] = "a" if stream.getbuffer().nbytes else "w"
        group.to_netcdf(stream, mode=mode, group=name, engine=ENGINE)
    n_chains, n_draws = rows.shape
    return stream.getvalue(), (n_chains, n_draws)


def _posterior(run: RunData, rows: NDArray[np.int64]) -> dict[str, Any]:
    variables = {name: _variable(name, values, rows) for name, values in run.functionals.items()}
    words = {"long_name": "1 where the map is black at the probe point", "units": "1"}
    variables["probe_black"] = ((*DIMENSIONS, "probe"), run.probe_black[rows].astype(np.int8), words)
    return variables


def _probe_coordinates(run: RunData) -> dict[str, Any]:
    return {f"probe_{axis}": ("probe", run.probe_xy[:, i], {"units": "m"}) for i, axis in enumerate("xy")}


def _sample_stats(run: RunData, rows: NDArray[np.int64]) -> dict[str, Any]:
    steps = {"long_name": "step of the chain, burn-in included", "units": "1"}
    stats: dict[str, Any] = {"step": (DIMENSIONS, run.step[rows], steps)}
    if {"log_prior", "log_likelihood"} <= run.functionals.keys():
        total = run.functionals["log_prior"] + run.functionals["log_likelihood"]
        stats["lp"] = _variable("lp", total, rows)
    return stats


def _variable(name: str, values: NDArray[np.float64], rows: NDArray[np.int64]) -> tuple[Any, ...]:
    return DIMENSIONS, values[rows], {"units": UNITS[name]} if name in UNITS else {}


def _provenance(run: RunData) -> dict[str, str]:
    """Return what ArviZ wants to read of every group."""
    return {
        "created_at": _text(run.manifest.get("created", "")),
        "inference_library": "prf",
        "inference_library_version": _text(_version(run)),
    }


def _attributes(run: RunData, n_left_out: int) -> dict[str, Any]:
    """Return the attributes of the file: a nested value as JSON text, as netCDF has no other place for it."""
    kept = ("status", "seed", "steps", "burn_in", "seconds", "configuration", "inputs", "versions", "command")
    found = {key: _attribute(run.manifest[key]) for key in kept if run.manifest.get(key) is not None}
    return {"schema": SCHEMA, "prf_version": _text(_version(run)), **found, "n_draws_left_out": n_left_out}


def _version(run: RunData) -> object:
    """Return the version of prf that made the run, or this one's if the manifest has none."""
    return (run.manifest.get("versions") or {}).get("prf", __version__)


def _attribute(value: object) -> object:
    """Return text and numbers as they are, everything else as JSON."""
    if isinstance(value, str):
        return _text(value)
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_INTEGER
    return value if is_number else json.dumps(jsonable(value), allow_nan=False)


def _text(value: object) -> str:
    """Return text with escapes for halves of surrogate pairs, which HDF5 does not take."""
    return encoded(str(value)).decode()


def _acceptance(run: RunData) -> dict[str, str]:
    """Return the counts of proposed and accepted moves over all chains: they have no draw to belong to."""
    counts = (run.diagnostics or {}).get("acceptance")
    return {} if counts is None else {"acceptance": json.dumps(jsonable(counts), allow_nan=False)}
