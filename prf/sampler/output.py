"""From the state of a sampler to the RUN directory."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from prf.configuration import Configuration
from prf.diagnostics import acceptance, document
from prf.kernels import constants as c
from prf.render import render_posterior
from prf.run import Beams, Cones, Points, PosteriorImage, Run, names, read_manifest, read_run, write_run
from prf.sampler.checkpoint import save_checkpoint
from prf.sampler.drive import Progress
from prf.sampler.outlook import outlook
from prf.sampler.several import MOVE_NAMES, Sampler
from prf.shell.errors import OutputError, cannot_write, system_reason
from prf.shell.files import STREAM, is_leftover, remove_leftovers

FILES = (names.MANIFEST, names.CHECKPOINT, names.PICTURE, *names.SCHEMAS)
"""All that a RUN directory may hold, the manifest first: without it the others are no run."""


@dataclasses.dataclass(frozen=True)
class Output:
    """Where and with what a run is written."""

    folder: Path | None  # None: nothing is written, runs stay in memory
    process: dict[str, Any]  # versions, platform, command, inputs (:func:`prf.shell.manifest.describe_process`)
    config: Configuration  # resolved
    seed: int
    beams: Beams | None
    cones: Cones | None = None
    points: Points | None = None

    def write(self, sampler: Sampler, progress: Progress, seconds_before: float, picture: bool) -> Run:
        """Write checkpoint and RUN as the chains stand; `picture` draws posterior.png too.

        The manifest comes last: what is killed before can be resumed from a checkpoint, or is no run yet; and one that
        does not say "running" stands beside files that are all of its step. `seconds_before` is the time of sampling
        in earlier processes of a resumed run. Where one cannot be written, what is no run yet goes.
        """
        run = self.make_run(sampler, progress, seconds_before)
        if self.folder is None:
            return run
        _make_folder(self.folder)
        try:
            save_checkpoint(self.folder, sampler, self.identity())
            if picture:
                render_posterior(dataclasses.replace(run, path=self.folder), self.folder / names.PICTURE)
            write_run(self.folder, run)
        except OutputError:
            _remove_unfinished(self.folder)
            raise
        return run

    def read_written(self, step: int) -> Run | None:
        """Return the run that the directory holds if it is whole and stands after `step` steps, else None."""
        if self.folder is None:
            return None
        manifest = read_manifest(self.folder)
        is_whole = manifest.get("steps") == step and manifest.get("status") != "running"
        return read_run(self.folder) if is_whole else None

    def make_way(self) -> None:
        """Take away what an older run left in the directory; see :func:`make_way`."""
        if self.folder is not None:
            make_way(self.folder)

    def remove_leftovers(self) -> None:
        """Take away what a killed process had half written; the caller holds the run (:mod:`prf.shell.lock`)."""
        if self.folder is not None:
            _remove_leftovers(self.folder)

    def identity(self) -> str:
        """Return a digest of configuration, seed and readings: a checkpoint of another run is refused by it."""
        asked = json.dumps([self.config.flat(), self.seed], sort_keys=True)
        digest = hashlib.sha256(asked.encode())
        if self.beams is not None:
            for array in (self.beams.origin, self.beams.angle, self.beams.range):
                digest.update(np.ascontiguousarray(array).tobytes())
        if self.cones is not None:
            for array in (self.cones.origin, self.cones.angle, self.cones.cone, self.cones.range):
                digest.update(np.ascontiguousarray(array).tobytes())
        if self.points is not None:
            for array in self.points:
                digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def make_run(self, sampler: Sampler, progress: Progress, seconds_before: float) -> Run:
        """Return the RUN as the chains stand."""
        sample = sampler.sample()
        best = sampler.best()
        image = make_image(sampler)
        return Run(
            manifest=self.manifest(sampler, progress, seconds_before),
            draws=sample.draws,
            chain=sample.chain,
            step=sample.step,
            functionals=sample.functionals,
            probe_xy=sampler.probe_xy,
            probe_black=sample.probe_black,
            image=image,
            beams=self.beams,
            cones=self.cones,
            points=self.points,
            way=sampler.settings.way,
            best=best.coloring if best is not None else None,
            best_log_posterior=float(best.functionals[-1]) if best is not None else float("nan"),
            diagnostics=make_diagnostics(sampler, progress, image, seconds_before),
        )

    def manifest(self, sampler: Sampler, progress: Progress, seconds_before: float) -> dict[str, Any]:
        """Return what the manifest says besides its schema."""
        swaps = sampler.swaps()
        return {
            **self.process,
            "status": progress.status,
            "configuration": self.config.flat(),
            "seed": self.seed,
            "steps": sampler.step,
            "burn_in": sampler.burn_in,
            **({"tempered_from": swaps[0].first_step} if swaps else {}),
            "seconds": round(seconds_before + progress.seconds, 3),
        }


def make_way(folder: Path) -> None:
    """Take away what an older run left in a directory, so that no file of it can pass for one of the new run."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: a file is in the way. Choose another directory.")
    _remove_leftovers(folder)
    for name in FILES:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{folder / name}: cannot be removed ({system_reason(error)}).") from error


def _remove_leftovers(folder: Path) -> None:
    for name in FILES:
        remove_leftovers(folder / name)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error


def _remove_unfinished(folder: Path) -> None:
    """Take away files that are no run without a manifest, and the directory if nothing else is in it."""
    if is_unfinished(folder):
        make_way(folder)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def make_image(sampler: Sampler) -> PosteriorImage:
    """Return the occupancy image of all chains."""
    grid = sampler.chains[0].chain.image.grid
    occupancy, squares = sampler.occupancy()
    seen = sampler.settings.seen
    everything = np.ones(occupancy.shape, np.bool_)
    return PosteriorImage(
        occupancy,
        squares,
        np.array([grid.x0, grid.y0]),
        grid.cell,
        everything if seen is None else seen,
        sampler.disagreement(),
    )


def make_diagnostics(
    sampler: Sampler, progress: Progress, image: PosteriorImage, seconds_before: float
) -> dict[str, Any]:
    """Return agreement, what it would take, acceptance by move and speed."""
    outcomes, diagnoses, where = sampler.outcomes(), sampler.diagnose(), image.agreement()
    seconds = seconds_before + progress.seconds
    expected = outlook(sampler.diagnose_half(), diagnoses, seconds, sampler.climbs())
    assert where is not None
    return document(
        diagnoses,
        agreement=where.document(),
        trend=expected.trend,
        suggested_seconds=expected.seconds,
        acceptance=acceptance(list(MOVE_NAMES), outcomes[:, c.PROPOSED], outcomes[:, c.ACCEPTED]),
        steps_per_second=progress.steps_per_second,
        **tempering_entry(sampler),
    )


def tempering_entry(sampler: Sampler) -> dict[str, Any]:
    """Return what swaps between rungs came to, chain by chain; nothing without parallel tempering."""
    reports = [report._asdict() for report in sampler.swaps()]
    return {"tempering": reports} if reports else {}


def is_unfinished(folder: Path) -> bool:
    """Return whether `folder` is what a run leaves that is killed before its first manifest: nothing of worth."""
    if not os.path.isdir(folder) or (folder / names.MANIFEST).exists():
        return False
    kept = [entry.name for entry in folder.iterdir()]
    return bool(kept) and all(name in FILES or any(is_leftover(name, output) for output in FILES) for name in kept)


LOG_SUFFIXES = (".bag", ".mcap", ".db3", ".csv", ".txt", ".log", ".clf", ".gz")
"""Ends of the names of logs; several may stand one behind the other."""


def default_output(log: str | os.PathLike[str]) -> Path:
    """Return the RUN directory for a log whose output was not named: its stem in the working directory."""
    path = Path(os.fspath(log))
    name = "" if os.fspath(log) == STREAM else path.name or path.resolve().name
    while Path(name).suffix.lower() in LOG_SUFFIXES:
        name = Path(name).stem
    return Path((name or "laser") + ".run")
