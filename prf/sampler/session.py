"""A run from its start, or from its checkpoint, to its end: sampling with checkpoints on the way."""

from __future__ import annotations

import dataclasses
import logging
import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from prf.configuration import IN_MANIFEST, Configuration
from prf.kernels import step
from prf.kernels._jit import CACHE
from prf.logs import Kind, PointTable, Readings, read_logs, read_point_data, thin, warn_of_spoiling
from prf.logs.describe import default_max_range
from prf.posterior import Settings
from prf.run import Run, names, read_run
from prf.sampler.checkpoint import load_checkpoint
from prf.sampler.config import Prepared, ladder_plan, make_settings, prepare
from prf.sampler.distributed import Remote
from prf.sampler.drive import Progress, StopRule, drive
from prf.sampler.output import Output
from prf.sampler.several import Sampler
from prf.sampler.starts import needs_search
from prf.shell.errors import ConfigError, InputError
from prf.shell.manifest import describe_input, describe_process, versions
from prf.shell.seeds import spawn_generators
from prf.shell.settings import Loaded

CHECKPOINT_SECONDS = 60.0
"""Sampling between two checkpoints: what a killed run loses at most."""

FIRST_ARCHIVES = 1.0
"""Seconds that writing a RUN is thought to take, until it was measured."""
PICTURE_SECONDS = 1.5
"""What its picture takes besides."""

COUNTS = ("n_beams", "n_beams_thinned", "n_cones", "n_outside", "n_points", "n_points_outside")
PROCESS_KEYS = ("versions", "platform", "command", "created", "inputs", "sources", *COUNTS)

logger = logging.getLogger(__name__)


class Checkpoints:
    """Checkpoints on the way, and how long it takes to write a RUN, as they show it."""

    def __init__(self, output: Output, seconds_before: float) -> None:
        self.output, self.seconds_before = output, seconds_before
        self.written, self.archives = time.monotonic(), FIRST_ARCHIVES

    def keep(self, sampler: Sampler, progress: Progress) -> None:
        """Write a RUN without its picture if one is due."""
        begun = time.monotonic()
        is_due = progress.status == "running" and begun - self.written > CHECKPOINT_SECONDS
        if self.output.folder is not None and is_due:
            self.output.write(sampler, progress, self.seconds_before, picture=False)
            self.written = time.monotonic()
            self.archives = self.written - begun

    def reserve(self) -> float:
        """Return the seconds that the end of the run will take."""
        return 0.0 if self.output.folder is None else self.archives + PICTURE_SECONDS


@dataclasses.dataclass(frozen=True)
class Session:
    """A sampler and where it writes."""

    sampler: Sampler
    output: Output
    seconds_before: float = 0.0  # sampling in earlier processes of a resumed run
    is_resumed: bool = False  # whether the directory holds the run already

    def carry_out(
        self, rule: StopRule, on_progress: Callable[[Progress], None], stop_requested: Callable[[], bool]
    ) -> tuple[Run, Progress]:
        """Sample until `rule` is met or `stop_requested` says so, then write the RUN; return it and the end."""
        if self.is_resumed:
            self.output.remove_leftovers()
        else:
            self.output.make_way()
        checkpoints = Checkpoints(self.output, self.seconds_before)
        first_step = self.sampler.step
        progress = Progress(first_step, 0.0, 0.0, 1.0, None, "finished")
        if first_step == 0 and needs_search(self.sampler.chains[0].starts_from, self.sampler.settings):
            logger.info("finding maps to start from ...")
        for progress in drive(self.sampler, rule, stop_requested, checkpoints.reserve):
            on_progress(progress)
            if stop_requested() and progress.status == "running":
                progress = progress._replace(status="interrupted")
                break
            checkpoints.keep(self.sampler, progress)
        stands = self.is_resumed and self.sampler.step == first_step
        written_run = self.output.read_written(first_step) if stands else None
        if written_run is not None:
            return written_run, progress
        return self.output.write(self.sampler, progress, self.seconds_before, picture=True), progress


def read_prepared(
    laser_log: str | None, config: Configuration, sonar_log: str | None = None, point_data: str | None = None
) -> Prepared:
    """Read the logs of a laser and a sonar, thin them, read point observations, and resolve `config` for all these."""
    laser, sonar = read_configured(config, laser_log, sonar_log)
    observed = None if point_data is None else read_point_data(point_data)
    return prepare_whole(config, laser, sonar, observed)


def read_configured(
    config: Configuration, laser_log: str | None, sonar_log: str | None
) -> tuple[Readings | None, Readings | None]:
    """Read the logs of a laser and a sonar, of the topics and in the frame of a configuration; None without a log."""
    return read_logs(
        laser_log,
        sonar_log,
        topic=config.readings.topic,
        frame=config.readings.frame,
        sonar_topic=config.readings.sonar_topic,
        cone=config.sonar.cone,
    )


def prepare_whole(
    config: Configuration, laser: Readings | None, sonar: Readings | None, observed: PointTable | None
) -> Prepared:
    """Thin the readings of whole logs, warn of what would spoil a map, and resolve `config` for them."""
    kept_laser = _kept(config, laser, "laser", config.laser.max_range)
    kept_sonar = _kept(config, sonar, "sonar", config.sonar.max_range)
    if laser is not None and config.laser.max_range is None and math.isfinite(default_max_range(laser)):
        # Of the whole log: what is left after thinning may hold no "no return" at all.
        config = config.replace(max_range=default_max_range(laser))
    driven = [log for log in (laser, sonar) if log is not None] if config.driven.poses == "all" else None
    return prepare(config, kept_laser, kept_sonar, observed, driven)


def _kept(config: Configuration, readings: Readings | None, kind: Kind, max_range: float | None) -> Readings | None:
    """Return the scans and beams of a whole log that are asked for."""
    if readings is None:
        return None
    chosen = config.readings
    kept = thin(readings, chosen.every_scan, chosen.every_beam, chosen.scans, chosen.skip_scans)
    warn_of_spoiling(readings, kept, kind, max_range)
    return kept


def start(
    logs: list[str],
    prepared: Prepared,
    folder: Path | None,
    seed: int,
    threads: int,
    scheduler: str | None = None,
    sources: Mapping[str, str] = MappingProxyType({}),
) -> Session:
    """Return a fresh session on prepared logs, which steps on the workers of a `scheduler` if there is one.

    Without a `folder` nothing is written. The manifest keeps `sources`: who asked for which value of the configuration.
    """
    sampler = make_sampler(prepared.config, prepared.settings, seed, threads, scheduler)
    beams, cones, points = prepared.beams, prepared.cones, prepared.points
    counts = {
        "n_beams": 0 if beams is None else len(beams.range),
        "n_beams_thinned": prepared.n_beams_thinned,
        "n_cones": 0 if cones is None else len(cones.range),
        "n_outside": prepared.n_outside,
        "n_points": 0 if points is None else len(points.value),
        "n_points_outside": prepared.n_points_outside,
    }
    process = {**describe_process(logs), "sources": dict(sources), **counts}
    return Session(sampler, Output(folder, process, prepared.config, seed, beams, cones, points))


def make_sampler(
    config: Configuration, settings: Settings, seed: int, threads: int, scheduler: str | None = None
) -> Sampler:
    """Return fresh chains of a resolved configuration, which step in threads, or on the workers of a scheduler."""
    if scheduler is not None and config.sampler.is_tempered:
        raise ConfigError("scheduler: tempered chains step in threads alone. Leave out sampler.rungs or the scheduler.")
    generators = spawn_generators(seed, config.sampler.chains)
    remote = None if scheduler is None else Remote(scheduler, settings)
    return Sampler(settings, generators, threads, remote, ladder_plan(config), config.sampler.start or "empty")


def resume(
    folder: Path,
    logs: dict[str, str],
    asked: Loaded[Configuration],
    seed: int | None,
    threads: int,
    scheduler: str | None = None,
) -> Session:
    """Return a session that goes on from the checkpoint in `folder`."""
    run = read_run(folder, parts=(names.READINGS, names.POSTERIOR))
    if run.sensors is None and run.points is None:
        raise InputError(f"{folder}: readings.npz is missing. Sample anew with --force.")
    config, stored_seed = stored_config(run, folder)
    refuse_changes(config, asked, stored_seed, seed)
    for flag, log in logs.items():
        refuse_other_log(run, flag, log)
    if run.manifest.get("versions") != versions():
        logger.warning("this run was begun with other versions of the packages: bit for bit may not hold")
    seen = None if run.image is None else run.image.seen
    settings = dataclasses.replace(make_settings(config, run.beams, run.cones, run.points), seen=seen, way=run.way)
    sampler = make_sampler(config, settings, stored_seed, threads, scheduler)
    process = {key: run.manifest[key] for key in PROCESS_KEYS if key in run.manifest}
    output = Output(folder, process, config, stored_seed, run.beams, run.cones, run.points)
    load_checkpoint(folder, sampler, output.identity())
    return Session(sampler, output, float(run.manifest.get("seconds", 0.0)), is_resumed=True)


def stored_config(run: Run, folder: Path) -> tuple[Configuration, int]:
    """Return the configuration and the seed of a run."""
    try:
        return Configuration.of(**{"start": "empty", **run.manifest["configuration"]}), int(run.manifest["seed"])
    except (KeyError, TypeError, ValueError, ConfigError) as error:
        raise InputError(f"{folder}/manifest.json: configuration is damaged ({error}). Sample anew.") from error


def refuse_changes(config: Configuration, asked: Loaded[Configuration], seed: int, asked_seed: int | None) -> None:
    """Raise ConfigError naming the first field that is asked for with another value than the run has."""
    if asked_seed is not None and asked_seed != seed:
        raise ConfigError(f"--seed {asked_seed}: the run to resume has {seed}. Leave it out, or sample anew.")
    for place, source in asked.sources.items():
        if place.partition(".")[0] in IN_MANIFEST and asked.settings.get(place) != config.get(place):
            raise ConfigError(
                f"{source} {asked.settings.get(place)}: the run to resume has {config.get(place)}. Leave it out, or "
                "sample anew."
            )


def refuse_other_log(run: Run, flag: str, log: str | os.PathLike[str]) -> None:
    """Raise InputError if `log`, given by the option `flag`, is no file that the run was made from."""
    found = describe_input(log)
    known = [given.get("sha256") for given in run.manifest.get("inputs", [])]
    if found["sha256"] not in known:
        raise InputError(f"{log}: not the log that the run was made from. Leave {flag} out, or sample anew.")


def needs_compiling() -> bool:
    """Return whether the first step will compile the kernels, which takes some seconds."""
    return not CACHE.is_compiled(f"step.{step.run.__name__}")
