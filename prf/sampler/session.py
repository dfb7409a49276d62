"""Chains and their output at the start of a run, or from its checkpoint."""

from __future__ import annotations

import dataclasses
import logging
import math
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from prf.configuration import IN_MANIFEST, Configuration
from prf.kernels import step
from prf.kernels._jit import CACHE
from prf.logs import Kind, PointTable, Readings, read_logs, read_point_data, thin, warn_of_spoiling
from prf.logs.describe import default_max_range
from prf.posterior import Settings
from prf.run import Run, names, read_run
from prf.sampler.chains import Sampler
from prf.sampler.checkpoint import load_checkpoint
from prf.sampler.config import Prepared, ladder_plan, make_settings, prepare
from prf.sampler.output import Output
from prf.shell.errors import ConfigError, InputError
from prf.shell.manifest import describe_input, describe_process, versions
from prf.shell.seeds import spawn_generators
from prf.shell.settings import Loaded

COUNTS = ("n_beams", "n_beams_thinned", "n_cones", "n_outside", "n_points", "n_points_outside")
PROCESS_KEYS = ("versions", "platform", "command", "created", "inputs", "sources", *COUNTS)

logger = logging.getLogger(__name__)


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
    sources: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Sampler, Output]:
    """Return fresh chains on prepared logs, and where they are written.

    Without a `folder` nothing is written. The manifest keeps `sources`: what has set each value of the
    configuration.
    """
    sampler = make_sampler(prepared.config, prepared.settings, seed, threads)
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
    return sampler, Output(folder, process, prepared.config, seed)


def make_sampler(config: Configuration, settings: Settings, seed: int, threads: int) -> Sampler:
    """Return fresh chains of a resolved configuration, which step in threads."""
    generators = spawn_generators(seed, config.sampler.chains)
    return Sampler(settings, generators, threads, ladder_plan(config), config.sampler.start or "empty")


def resume(
    folder: Path, logs: dict[str, str], asked: Loaded[Configuration], seed: int | None, threads: int
) -> tuple[Sampler, Output]:
    """Return the chains of the checkpoint in `folder`, and where they are written."""
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
    settings = dataclasses.replace(make_settings(config, run.laser, run.sonar, run.points), seen=seen, way=run.way)
    sampler = make_sampler(config, settings, stored_seed, threads)
    process = {key: run.manifest[key] for key in PROCESS_KEYS if key in run.manifest}
    seconds = float(run.manifest.get("seconds", 0.0))
    output = Output(folder, process, config, stored_seed, seconds_before=seconds, is_resumed=True)
    load_checkpoint(folder, sampler, output.identity(settings))
    return sampler, output


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
