"""What is written of a run beside its draws: what it was made from, and how far its chains agree."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from prf.configuration import IN_MANIFEST, Configuration, PoseOptions
from prf.kernels import constants as c
from prf.output.run import Run
from prf.results import PosteriorImage
from prf.results.convergence import outlook, verdict
from prf.sampler.ensemble import Ensemble
from prf.sampler.prepare import Prepared
from prf.sampler.target import Target
from prf.shell.cli.settings import Loaded
from prf.shell.cli.storage import describe_input, describe_process
from prf.shell.errors import ConfigError, InputError

COUNTS = ("n_beams", "n_beams_thinned", "n_cones", "n_outside", "n_points", "n_points_outside")
PROCESS_KEYS = ("versions", "platform", "command", "created", "inputs", "sources", *COUNTS)


def describe_start(logs: list[str], prepared: Prepared, sources: Mapping[str, str]) -> dict[str, Any]:
    """Return what a manifest keeps of the start of a run; `sources`: what has set each value of the configuration."""
    laser, sonar, points = prepared.target.laser, prepared.target.sonar, prepared.target.points
    return {
        **describe_process(logs),
        "sources": dict(sources),
        "n_beams": 0 if laser is None else laser.readings.n_beams,
        "n_beams_thinned": prepared.n_beams_thinned,
        "n_cones": 0 if sonar is None else sonar.readings.n_beams,
        "n_outside": prepared.n_outside,
        "n_points": 0 if points is None else len(points.readings.value),
        "n_points_outside": prepared.n_points_outside,
    }


def diagnostics_of(
    ensemble: Ensemble, image: PosteriorImage, seconds: float, steps_per_second: float
) -> dict[str, Any]:
    """Return agreement, what it would take, acceptance by move and speed, after so many `seconds` of sampling."""
    ground, diagnoses = image.agreement(), ensemble.diagnose()
    found = verdict(diagnoses)
    trend, suggested = outlook(ensemble.diagnose_half(), diagnoses, seconds, ensemble.climbs())
    assert ground is not None
    diagnostics = {
        "converged": found.converged,
        "converged_seen": found.seen,
        "worst": found.worst,
        "reason": found.reason,
        "functionals": {name: each._asdict() for name, each in diagnoses.items()},
        "agreement": ground.document(),
        "trend": trend,
        "suggested_seconds": suggested,
        "acceptance": {
            name: {"proposed": int(counts[c.PROPOSED]), "accepted": int(counts[c.ACCEPTED])}
            for name, counts in ensemble.named_outcomes().items()
        },
        "steps_per_second": steps_per_second,
    }
    swaps = ensemble.swaps()
    return diagnostics | ({"tempering": swaps} if swaps else {})


def identity_of(config: Configuration, seed: int, target: Target) -> str:
    """Return a digest of configuration, seed and readings: a checkpoint of another run is refused by it."""
    arrays = []
    if target.laser is not None:
        laser = target.laser.readings
        arrays += [laser.origin, laser.angle, laser.range]
    if target.sonar is not None:
        sonar = target.sonar.readings
        arrays += [sonar.origin, sonar.angle, sonar.cone, sonar.range]
    if target.points is not None:
        arrays += [target.points.readings.xy, target.points.readings.value]
    flat, poses = config.flat(), PoseOptions.model_fields
    kept = {name: value for name, value in flat.items() if name not in poses or value is not None}
    digest = hashlib.sha256(json.dumps([kept, seed], sort_keys=True).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


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
