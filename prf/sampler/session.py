"""A run under way: its chains and what they were made from, begun or resumed, and written as a RUN directory."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import logging
import os
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from prf.configuration import IN_MANIFEST, Configuration, PoseOptions
from prf.kernels import constants as c
from prf.output.run import Run, read_run
from prf.readings import log_stem
from prf.results import PosteriorImage, Progress, names, read_manifest, write_run
from prf.results.convergence import outlook, verdict
from prf.results.write import (
    make_folder,
    remove_half_written,
    remove_stale_outputs,
    remove_unfinished,
    write_manifest,
)
from prf.sampler.chains import Sampler
from prf.sampler.checkpoint import load_checkpoint, load_pose_model, save_checkpoint
from prf.sampler.posterior import Settings
from prf.sampler.prepare import Prepared, describe_readings, ladder_plan, make_settings
from prf.shell.cli.provenance import describe_input, describe_process, spawn_generators, versions
from prf.shell.cli.settings import Loaded
from prf.shell.errors import ConfigError, InputError, OutputError

COUNTS = ("n_beams", "n_beams_thinned", "n_cones", "n_outside", "n_points", "n_points_outside")
PROCESS_KEYS = ("versions", "platform", "command", "created", "inputs", "sources", *COUNTS)
PICTURE_SECONDS = 1.5
"""What drawing the picture of a run takes."""
FIRST_SECONDS = 1.0
"""What writing a RUN without it is taken to cost until it was measured."""

UNMOVED = Progress(0, 0.0, 0.0, 1.0, None, "finished")
"""Of a run without a round."""

logger = logging.getLogger(__name__)


@dataclasses.dataclass
class Session:
    """A run under way. Without a folder it stays in memory.

    Attributes
    ----------
    progress : Progress
        Step, seconds, share of the goal, latest check of agreement.
    """

    sampler: Sampler
    config: Configuration  # resolved
    seed: int
    process: dict[str, Any]  # versions, platform, command, inputs (:func:`prf.shell.cli.provenance.describe_process`)
    folder: Path | None = None
    seconds_before: float = 0.0  # sampling in earlier processes of a resumed run
    is_resumed: bool = False  # whether the folder holds the run already
    progress: Progress = UNMOVED
    written: float = dataclasses.field(default_factory=time.monotonic)  # when the run was written last
    seconds_to_write: float = FIRST_SECONDS

    @classmethod
    def start(
        cls,
        logs: list[str],
        prepared: Prepared,
        folder: Path | None,
        seed: int,
        threads: int,
        sources: Mapping[str, str] = MappingProxyType({}),
    ) -> Session:
        """Return a run of fresh chains; the manifest keeps `sources`: what has set each value of the configuration."""
        laser, sonar, points = prepared.settings.laser, prepared.settings.sonar, prepared.settings.points
        counts = {
            "n_beams": 0 if laser is None else laser.readings.n_beams,
            "n_beams_thinned": prepared.n_beams_thinned,
            "n_cones": 0 if sonar is None else sonar.readings.n_beams,
            "n_outside": prepared.n_outside,
            "n_points": 0 if points is None else len(points.table.value),
            "n_points_outside": prepared.n_points_outside,
        }
        process = {**describe_process(logs), "sources": dict(sources), **counts}
        sampler = make_sampler(prepared.config, prepared.settings, seed, threads)
        return cls(sampler, prepared.config, seed, process, folder)

    @classmethod
    def resume(
        cls, folder: Path, logs: dict[str, str], requested: Loaded[Configuration], seed: int | None, threads: int
    ) -> Session:
        """Return the run in `folder` as its checkpoint has it; refuse to if it was made otherwise than requested."""
        run = read_run(folder, parts=(names.READINGS, names.POSTERIOR))
        if run.sensors is None and run.points is None:
            raise InputError(f"{folder}: readings.npz is missing. Sample anew with --force.")
        config, stored_seed = stored_config(run, folder)
        refuse_changes(config, requested, stored_seed, seed)
        for flag, log in logs.items():
            refuse_other_log(run, flag, log)
        if run.manifest.get("versions") != versions():
            logger.warning("this run was begun with other versions of the packages: bit for bit may not hold")
        seen = None if run.image is None else run.image.seen
        model, laser, sonar = None, run.laser, run.sonar
        if config.trajectory.is_uncertain:
            model = load_pose_model(folder)
            laser, sonar = model.placed(laser, sonar, model.start)
        settings = make_settings(config, laser, sonar, run.points)
        settings = dataclasses.replace(settings, seen=seen, way=run.way, poses=model)
        process = {key: run.manifest[key] for key in PROCESS_KEYS if key in run.manifest}
        seconds = float(run.manifest.get("seconds", 0.0))
        sampler = make_sampler(config, settings, stored_seed, threads)
        session = cls(sampler, config, stored_seed, process, folder, seconds_before=seconds, is_resumed=True)
        load_checkpoint(folder, sampler, session.identity())
        return session

    def describe(self) -> str:
        """Return in a line what the run is about."""
        readings = describe_readings(self.sampler.settings, int(self.process.get("n_beams_thinned", 0)))
        return f"{readings}, {len(self.sampler.chains)} chains, seed {self.seed}"

    def prepare_folder(self) -> None:
        """Remove what an older run left in the folder, or what a killed process left half written of this one."""
        self.written = time.monotonic()
        if self.folder is not None:
            (remove_half_written if self.is_resumed else remove_stale_outputs)(self.folder)

    def write(self, picture: bool) -> Run:
        """Write checkpoint and RUN as the chains are now; `picture` draws posterior.png too.

        The manifest is written last: what is killed before can be resumed from a checkpoint, or is no run yet; and one
        whose status is not "running" is beside files that are all of its step. If one cannot be written, what is no run
        yet is removed.
        """
        begun = time.monotonic()
        run = self.run()
        if self.folder is None:
            return run
        try:
            make_folder(self.folder)
            save_checkpoint(self.folder, self.sampler, self.identity())
            if not picture:
                write_run(self.folder, run)
            else:  # a picture that fails must not cost the draws, nor be taken for drawn
                write_run(self.folder, dataclasses.replace(run, manifest={**run.manifest, "status": "running"}))
                run.draw(self.folder / names.PICTURE)
                write_manifest(self.folder, run.manifest)
        except OutputError:
            remove_unfinished(self.folder)
            raise
        self.written = time.monotonic()
        self.seconds_to_write = self.written - begun
        return run

    def seconds_since_written(self) -> float:
        """Return the seconds since the run was written; 0 if it stays in memory."""
        return 0.0 if self.folder is None else time.monotonic() - self.written

    def seconds_to_finish(self) -> float:
        """Return the seconds that the end of the run will take."""
        return 0.0 if self.folder is None else self.seconds_to_write + PICTURE_SECONDS

    def read_finished(self) -> Run | None:
        """Return the run to resume if its folder holds all of it at the present step, else None."""
        if self.folder is None or not self.is_resumed:
            return None
        manifest = read_manifest(self.folder)
        is_whole = manifest.get("steps") == self.sampler.step and manifest.get("status") != "running"
        return dataclasses.replace(read_run(self.folder), progress=self.progress) if is_whole else None

    def identity(self) -> str:
        """Return a digest of configuration, seed and readings: a checkpoint of another run is refused by it."""
        settings = self.sampler.settings
        arrays = []
        if settings.laser is not None:
            laser = settings.laser.readings
            arrays += [laser.origin, laser.angle, laser.range]
        if settings.sonar is not None:
            sonar = settings.sonar.readings
            arrays += [sonar.origin, sonar.angle, sonar.cone, sonar.range]
        if settings.points is not None:
            arrays += [settings.points.table.xy, settings.points.table.value]
        flat, poses = self.config.flat(), PoseOptions.model_fields
        kept = {name: value for name, value in flat.items() if name not in poses or value is not None}
        digest = hashlib.sha256(json.dumps([kept, self.seed], sort_keys=True).encode())
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def run(self) -> Run:
        """Return the run so far: its draws and its image."""
        sampler, settings = self.sampler, self.sampler.settings
        best, image = sampler.best(), sampler.image()
        laser, sonar = (None if part is None else part.readings for part in (settings.laser, settings.sonar))
        if settings.poses is not None:
            laser, sonar = settings.poses.placed(laser, sonar, settings.poses.prior.given)
        return Run(
            manifest=self._manifest(),
            **sampler.sample()._asdict(),
            probe_xy=sampler.probe_xy,
            image=image,
            laser=laser,
            sonar=sonar,
            points=None if settings.points is None else settings.points.table,
            way=settings.way,
            trajectory=sampler.trajectory(),
            best=None if best is None else best.coloring,
            best_log_posterior=float("nan") if best is None else float(best.functionals[-1]),
            diagnostics=self._diagnostics(image),
            path=self.folder,
            progress=self.progress,
        )

    @property
    def _seconds(self) -> float:
        """Sampling in all processes of the run."""
        return self.seconds_before + self.progress.seconds

    def _manifest(self) -> dict[str, Any]:
        swaps = self.sampler.swaps()
        return {
            **self.process,
            "status": self.progress.status,
            "configuration": self.config.flat(),
            "seed": self.seed,
            "steps": self.sampler.step,
            "burn_in": self.sampler.burn_in,
            **({"tempered_from": swaps[0].first_step} if swaps else {}),
            "seconds": round(self._seconds, 3),
        }

    def _diagnostics(self, image: PosteriorImage) -> dict[str, Any]:
        """Return agreement, what it would take, acceptance by move and speed."""
        sampler, ground = self.sampler, image.agreement()
        diagnoses = sampler.diagnose()
        found = verdict(diagnoses)
        expected = outlook(sampler.diagnose_half(), diagnoses, self._seconds, sampler.climbs())
        assert ground is not None
        diagnostics = {
            "converged": found.converged,
            "converged_seen": found.seen,
            "worst": found.worst,
            "reason": found.reason,
            "functionals": {name: each._asdict() for name, each in diagnoses.items()},
            "agreement": ground.document(),
            "trend": expected.trend,
            "suggested_seconds": expected.seconds,
            "acceptance": {
                name: {"proposed": int(counts[c.PROPOSED]), "accepted": int(counts[c.ACCEPTED])}
                for name, counts in sampler.named_outcomes().items()
            },
            "steps_per_second": self.progress.steps_per_second,
        }
        swaps = [report._asdict() for report in sampler.swaps()]
        return diagnostics | ({"tempering": swaps} if swaps else {})


def make_sampler(config: Configuration, settings: Settings, seed: int, threads: int) -> Sampler:
    """Return fresh chains of a resolved configuration, which step in threads."""
    generators = spawn_generators(seed, config.sampler.chains)
    return Sampler(settings, generators, threads, ladder_plan(config), config.sampler.start or "empty")


def stored_config(run: Run, folder: Path) -> tuple[Configuration, int]:
    """Return the configuration and the seed of a run."""
    try:
        return Configuration.of(**{"start": "empty", **run.manifest["configuration"]}), int(run.manifest["seed"])
    except (KeyError, TypeError, ValueError, ConfigError) as error:
        raise InputError(f"{folder}/manifest.json: no configuration of this release ({error}). Sample anew.") from error


def refuse_changes(
    config: Configuration, requested: Loaded[Configuration], seed: int, requested_seed: int | None
) -> None:
    """Raise ConfigError naming the first field requested with another value than the run has."""
    if requested_seed is not None and requested_seed != seed:
        raise ConfigError(f"--seed {requested_seed}: the run to resume has {seed}. Leave it out, or sample anew.")
    for place, source in requested.sources.items():
        value, kept = requested.settings.get(place), config.get(place)
        if place.partition(".")[0] in IN_MANIFEST and value != kept:
            raise ConfigError(f"{source} {value}: the run to resume has {kept}. Leave it out, or sample anew.")


def refuse_other_log(run: Run, flag: str, log: str | os.PathLike[str]) -> None:
    """Raise InputError if `log`, given by the option `flag`, is not a file that the run was made from."""
    known = [given.get("sha256") for given in run.manifest.get("inputs", [])]
    if describe_input(log)["sha256"] not in known:
        raise InputError(f"{log}: not the log that the run was made from. Leave {flag} out, or sample anew.")


def default_output(log: str | os.PathLike[str]) -> Path:
    """Return the RUN directory for a log whose output was not named: its stem in the working directory."""
    return Path((log_stem(os.fspath(log)) or "laser") + ".run")
