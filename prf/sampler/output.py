"""From the state of a sampler to the RUN directory."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Configuration
from prf.diagnostics import acceptance, document
from prf.kernels import constants as c
from prf.posterior import Settings
from prf.run import PosteriorImage, Progress, Run, names, read_manifest, read_run, write_run
from prf.run.write import make_folder, remove_half_written, remove_stale_outputs, remove_unfinished
from prf.sampler.chains import MOVE_NAMES, Sampler
from prf.sampler.checkpoint import save_checkpoint
from prf.sampler.convergence import outlook
from prf.shell.errors import OutputError
from prf.shell.files import STREAM

PICTURE_SECONDS = 1.5
"""What drawing the picture of a run takes."""
FIRST_SECONDS = 1.0
"""What writing a RUN without it is taken to cost until it was measured."""


@dataclasses.dataclass
class Output:
    """Where and with what a run is written; without a folder it stays in memory."""

    folder: Path | None
    process: dict[str, Any]  # versions, platform, command, inputs (:func:`prf.shell.manifest.describe_process`)
    config: Configuration  # resolved
    seed: int
    seconds_before: float = 0.0  # sampling in earlier processes of a resumed run
    is_resumed: bool = False  # whether the folder holds the run already
    written: float = dataclasses.field(default_factory=time.monotonic)  # when it was written last
    seconds_to_write: float = FIRST_SECONDS

    def write(self, sampler: Sampler, progress: Progress, picture: bool) -> Run:
        """Write checkpoint and RUN as the chains are now; `picture` draws posterior.png too.

        The manifest is written last: what is killed before can be resumed from a checkpoint, or is no run yet; and one
        whose status is not "running" is beside files that are all of its step. If one cannot be written, what is no run
        yet is removed.
        """
        begun = time.monotonic()
        run = self.make_run(sampler, progress)
        if self.folder is None:
            return run
        try:
            make_folder(self.folder)
            save_checkpoint(self.folder, sampler, self.identity(sampler.settings))
            if picture:
                run.draw(self.folder / names.PICTURE)
            write_run(self.folder, run)
        except OutputError:
            remove_unfinished(self.folder)
            raise
        self.written = time.monotonic()
        self.seconds_to_write = self.written - begun
        return run

    def since_written(self) -> float:
        """Return the seconds since the run was written; 0 if it stays in memory."""
        return 0.0 if self.folder is None else time.monotonic() - self.written

    def seconds_to_finish(self) -> float:
        """Return the seconds that the end of the run will take."""
        return 0.0 if self.folder is None else self.seconds_to_write + PICTURE_SECONDS

    def read_written(self, step: int) -> Run | None:
        """Return the run to resume if its folder holds all of it at `step`, else None."""
        if self.folder is None or not self.is_resumed:
            return None
        manifest = read_manifest(self.folder)
        is_whole = manifest.get("steps") == step and manifest.get("status") != "running"
        return read_run(self.folder) if is_whole else None

    def prepare_folder(self) -> None:
        """Remove what an older run left in the folder, or what a killed process left half written of this one."""
        self.written = time.monotonic()
        if self.folder is not None:
            if self.is_resumed:
                remove_half_written(self.folder)
            else:
                remove_stale_outputs(self.folder)

    def identity(self, settings: Settings) -> str:
        """Return a digest of configuration, seed and readings: a checkpoint of another run is refused by it."""
        asked = json.dumps([self.config.flat(), self.seed], sort_keys=True)
        digest = hashlib.sha256(asked.encode())
        arrays: list[NDArray[np.float64]] = []
        if settings.laser is not None:
            laser = settings.laser.readings
            arrays += [laser.origin, laser.angle, laser.range]
        if settings.sonar is not None:
            sonar = settings.sonar.readings
            arrays += [sonar.origin, sonar.angle, sonar.cone, sonar.range]
        if settings.points is not None:
            arrays += [settings.points.table.xy, settings.points.table.value]
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def make_run(self, sampler: Sampler, progress: Progress) -> Run:
        """Return the RUN as the chains are now."""
        sample = sampler.sample()
        best, settings = sampler.best(), sampler.settings
        image = make_image(sampler)
        return Run(
            manifest=self.manifest(sampler, progress),
            draws=sample.draws,
            chain=sample.chain,
            step=sample.step,
            functionals=sample.functionals,
            probe_xy=sampler.probe_xy,
            probe_black=sample.probe_black,
            image=image,
            laser=None if settings.laser is None else settings.laser.readings,
            sonar=None if settings.sonar is None else settings.sonar.readings,
            points=None if settings.points is None else settings.points.table,
            way=settings.way,
            best=best.coloring if best is not None else None,
            best_log_posterior=float(best.functionals[-1]) if best is not None else float("nan"),
            diagnostics=make_diagnostics(sampler, progress, image, self.seconds_before),
            path=self.folder,
            progress=progress,
        )

    def manifest(self, sampler: Sampler, progress: Progress) -> dict[str, Any]:
        """Return the manifest without its schema."""
        swaps = sampler.swaps()
        return {
            **self.process,
            "status": progress.status,
            "configuration": self.config.flat(),
            "seed": self.seed,
            "steps": sampler.step,
            "burn_in": sampler.burn_in,
            **({"tempered_from": swaps[0].first_step} if swaps else {}),
            "seconds": round(self.seconds_before + progress.seconds, 3),
        }


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
    """Return powers and swap rates, chain by chain; nothing without parallel tempering."""
    reports = [report._asdict() for report in sampler.swaps()]
    return {"tempering": reports} if reports else {}


LOG_SUFFIXES = (".bag", ".mcap", ".db3", ".csv", ".txt", ".log", ".clf", ".gz")
"""Ends of the names of logs; several may follow one another."""


def default_output(log: str | os.PathLike[str]) -> Path:
    """Return the RUN directory for a log whose output was not named: its stem in the working directory."""
    path = Path(os.fspath(log))
    name = "" if os.fspath(log) == STREAM else path.name or path.resolve().name
    while Path(name).suffix.lower() in LOG_SUFFIXES:
        name = Path(name).stem
    return Path((name or "laser") + ".run")
