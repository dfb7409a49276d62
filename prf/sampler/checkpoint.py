"""What is kept of a run beside its draws: checkpoints, what it was made from, and how far its chains agree.

A checkpoint has all that decides the future of chains. A resumed run repeats an uninterrupted one bit for bit.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.configuration import IN_MANIFEST, Configuration, PoseOptions
from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.image import count_edges, settle_all
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring
from prf.output.run import Run
from prf.poses.model import Closures, LocalReadings, PoseModel, PosePrior
from prf.results import PosteriorImage, names
from prf.results.convergence import outlook, verdict
from prf.sampler.bends import Fields
from prf.sampler.chain import ChainRun, Draw
from prf.sampler.ensemble import Ensemble
from prf.sampler.prepare import Prepared
from prf.sampler.schedules import Ladder
from prf.sampler.target import Target, with_graph
from prf.shell.cli.settings import Loaded
from prf.shell.cli.storage import damaged, describe_input, describe_process, load_arrays, save_arrays
from prf.shell.errors import ConfigError, InputError

SCHEMA = names.CHECKPOINT_SCHEMA
LADDER = ("powers", "tried", "rate_sum", "came_from_hottest")
TIMES = ("black_time", "mixed_time")
POSES = ("pose", "spread", "outcomes")
OF_WALLS = ("prior", "wall_density", "wall_length", "wall_thickness", "free_end", "crossing")
DRAW_ARRAYS = ("vertex_offsets", "xy", "side", "edge_offsets", "edges", "anchor_black")

Arrays = dict[str, NDArray[Any]]


def save_checkpoint(folder: Path, ensemble: Ensemble, identity: str) -> None:
    """Write the state of all chains into the RUN directory `folder`; `identity` is that of the run."""
    arrays: Arrays = {"run": np.array(identity)}
    if ensemble.target.poses is not None:
        arrays |= prefixed("model.", model_arrays(ensemble.target.poses))
    for i, chain in enumerate(ensemble.chains):
        arrays |= prefixed(f"chain{i}.", chain_arrays(chain))
    save_arrays(folder / names.CHECKPOINT, SCHEMA, arrays)


def load_checkpoint(folder: Path, ensemble: Ensemble, identity: str) -> None:
    """Put the chains of a fresh ensemble into the state that was saved for the run `identity`."""
    path = folder / names.CHECKPOINT
    arrays = load_arrays(path, SCHEMA)
    if str(arrays.pop("run", "")) != identity:
        raise InputError(
            f"{path}: belongs to a run of other readings or configuration, or was written by another release. "
            "Sample anew with --force."
        )
    try:
        if "chain0.ladder.powers" in arrays:
            ensemble.temper()
        for i, chain in enumerate(ensemble.chains):
            restore(chain, under(f"chain{i}.", arrays))
    except (KeyError, ValueError, IndexError, TypeError, OverflowError) as error:
        raise damaged(path, f"does not fit this run: {error}") from error


def model_arrays(model: PoseModel) -> Arrays:
    """Return which poses are uncertain, their prior and their readings."""
    arrays: Arrays = {"scan": model.scan, "time": model.time, "start": model.start}
    arrays |= prefixed("prior.", model.prior._asdict()) | prefixed("disputed.", model.disputed._asdict())
    for name, part in (("laser.", model.laser), ("sonar.", model.sonar)):
        arrays |= {} if part is None else prefixed(name, part._asdict())
    return arrays


def load_pose_model(folder: Path) -> PoseModel:
    """Return the uncertain poses of the run in a folder."""
    path = folder / names.CHECKPOINT
    arrays = under("model.", load_arrays(path, SCHEMA))
    try:
        parts = [under(name, arrays) for name in ("laser.", "sonar.")]
        laser, sonar = (LocalReadings(**part) if part else None for part in parts)
        kept = under("prior.", arrays)
        given, noise = kept["given"], np.broadcast_to(kept["noise"], (len(kept["given"]), 2))  # of earlier releases one
        prior = PosePrior(given, noise, kept["motion"], kept["spread"], float(kept["slip"]))
        disputed = Closures(**under("disputed.", arrays))
        return PoseModel(prior, arrays["scan"], arrays["time"], arrays["start"], laser, sonar, disputed=disputed)
    except (KeyError, TypeError) as error:
        raise damaged(path, f"has no poses: {error}") from error


def prefixed(prefix: str, arrays: Arrays) -> Arrays:
    """Return arrays with a prefix before their names."""
    return {prefix + name: array for name, array in arrays.items()}


def under(prefix: str, arrays: Arrays) -> Arrays:
    """Return the arrays whose names have a prefix, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def chain_arrays(run: ChainRun) -> Arrays:
    """Return what decides the future of a chain, and what it has recorded.

    Of draws in the burn-in, which grows but never shrinks, only functionals and colours are read again: their maps are
    left out.
    """
    chain, record = run.chain, run.record
    settle_all(chain.image, run.step)
    arrays = state_arrays(chain, run.rng) | {
        "image.black": chain.image.black,
        **{f"image.{name}": getattr(chain.image, name) for name in TIMES},
        "times.starts": np.array([record.start, record.previous_start]),
        "times.previous_black": record.previous_black,
        "times.previous_mixed": record.previous_mixed,
        "record.thin": np.array(record.thin),
        "record.from": np.array(run.recorded_from),
        "targets.cumulative": chain.targets.cumulative,
        "doubts.count": run.n_unexplained,
        "doubts.looks": np.array(run.n_looks),
    }
    if run.ladder is not None:
        arrays |= ladder_arrays(run.ladder)
    if run.poses is not None:
        arrays |= {f"poses.{name}": getattr(run.poses.state, name) for name in (*POSES, "field_grid", "fields")}
    without = Coloring.empty(run.target.window, False)
    draws = [draw if draw.step > run.burn_in else dataclasses.replace(draw, coloring=without) for draw in record.draws]
    best = [] if record.best is None else [record.best]
    return arrays | prefixed("draws.", draw_arrays(draws, run)) | prefixed("best.", draw_arrays(best, run))


def restore(run: ChainRun, arrays: Arrays) -> None:
    """Put a fresh chain into a stored state: the graph as it was, all that follows from it recomputed."""
    if run.poses is not None:
        for name in POSES:
            getattr(run.poses.state, name)[:] = arrays[f"poses.{name}"]
        run.poses.bend(Fields(arrays["poses.field_grid"], arrays["poses.fields"]))
        run.chain = run.poses.place(run.chain, arrays["poses.pose"])
    run.chain = restored_state(run.chain, run.rng, run.target, arrays)
    restore_image(run, arrays)
    if run.ladder is not None:
        restore_ladder(run.ladder, arrays)
    run.chain.targets.cumulative[:] = arrays["targets.cumulative"]
    run.n_unexplained = np.array(arrays["doubts.count"])
    run.n_looks = float(arrays["doubts.looks"])
    run.recorded_from = int(arrays["record.from"])
    run.record.thin = int(arrays["record.thin"])
    run.record.draws = restored_draws(under("draws.", arrays), run)
    run.record.best = next(iter(restored_draws(under("best.", arrays), run)), None)


def draw_arrays(draws: list[Draw], run: ChainRun) -> Arrays:
    """Return draws as ragged arrays."""
    stored = Draws.from_colorings([draw.coloring for draw in draws], run.target.window)
    n_functionals, n_probes = (len(draws[0].functionals), len(draws[0].probe_black)) if draws else (0, 0)
    return {name: getattr(stored, name) for name in DRAW_ARRAYS} | {
        "step": np.array([draw.step for draw in draws], np.int64),
        "functionals": np.array([draw.functionals for draw in draws]).reshape(len(draws), n_functionals),
        "probe_black": np.array([draw.probe_black for draw in draws], np.bool_).reshape(len(draws), n_probes),
        **({} if run.poses is None else {"poses": np.array([draw.poses for draw in draws], np.float32)}),
    }


def restored_draws(arrays: Arrays, run: ChainRun) -> list[Draw]:
    """Return the draws that :func:`draw_arrays` stored."""
    stored = Draws(run.target.window, *(arrays[name] for name in DRAW_ARRAYS))
    poses = arrays.get("poses", np.full(len(arrays["step"]), None))
    rows = zip(arrays["step"].tolist(), stored, arrays["functionals"], arrays["probe_black"], poses, strict=True)
    return [Draw(step, Coloring(*coloring), values, black, at) for step, coloring, values, black, at in rows]


def state_arrays(chain: Chain, rng: np.random.Generator) -> Arrays:
    """Return the map of a chain, the outcomes of its moves, and its generator."""
    graph = prefixed("graph.", chain.graph._asdict())
    return graph | {"lines": chain.lines, "outcomes": chain.outcomes, "generator": generator_array(rng)}


def restored_state(chain: Chain, rng: np.random.Generator, target: Target, arrays: Arrays) -> Chain:
    """Return the chain at the map of :func:`state_arrays`, and put its generator there too."""
    if arrays["outcomes"].shape != chain.outcomes.shape:
        raise ValueError("its moves are those of another version of prf")
    graph = chain.graph._replace(**{name: arrays[f"graph.{name}"] for name in chain.graph._fields})
    rng.bit_generator.state = json.loads(str(arrays["generator"]))
    return with_graph(chain._replace(lines=arrays["lines"], outcomes=arrays["outcomes"]), target, graph)


def generator_array(rng: np.random.Generator) -> NDArray[Any]:
    """Return the state of a generator as an array."""
    return np.array(json.dumps(rng.bit_generator.state))


def ladder_arrays(ladder: Ladder) -> Arrays:
    """Return what decides the future of the hot chains and of the swaps."""
    arrays = {f"ladder.{name}": getattr(ladder, name) for name in LADDER} | {
        "ladder.round_trips": np.array(ladder.round_trips),
        "ladder.first_step": np.array(ladder.first_step),
        "ladder.generator": generator_array(ladder.swap_rng),
    }
    for k, (chain, rng) in enumerate(zip(ladder.hot, ladder.generators, strict=True), 1):
        arrays |= prefixed(f"hot{k}.", state_arrays(chain, rng))
    return arrays


def restore_ladder(ladder: Ladder, arrays: Arrays) -> None:
    """Put fresh hot chains into a stored state."""
    for name in LADDER:
        setattr(ladder, name, arrays[f"ladder.{name}"])
    ladder.round_trips = int(arrays["ladder.round_trips"])
    ladder.first_step = int(arrays["ladder.first_step"])
    ladder.swap_rng.bit_generator.state = json.loads(str(arrays["ladder.generator"]))
    ladder.hot = [
        restored_state(chain, rng, ladder.target, under(f"hot{k}.", arrays))
        for k, (chain, rng) in enumerate(zip(ladder.hot, ladder.generators, strict=True), 1)
    ]
    ladder.apply_powers()


def restore_image(run: ChainRun, arrays: Arrays) -> None:
    """Put the image of a restored chain and its epochs into the stored state."""
    image, record = run.chain.image, run.record
    image.black[:] = arrays["image.black"]
    image.black_since[:] = run.step
    image.mixed_since[:] = run.step
    count_edges(image, read_coloring(run.chain.graph).segments(), run.step)
    for name in TIMES:
        getattr(image, name)[:] = arrays[f"image.{name}"]
    record.start, record.previous_start = (int(start) for start in arrays["times.starts"])
    record.previous_black = arrays["times.previous_black"]
    record.previous_mixed = arrays["times.previous_mixed"]


COUNTS = ("n_beams", "n_beams_thinned", "n_cones", "n_outside", "n_points", "n_points_outside")
PROCESS_KEYS = (
    *("versions", "platform", "command", "created", "inputs", "sources", "logs", "extends", "forgotten"),
    *COUNTS,
)


def describe_start(logs: list[str], prepared: Prepared, sources: Mapping[str, str]) -> dict[str, Any]:
    """Return what a manifest keeps of the start of a run; `sources`: what has set each value of the configuration."""
    laser, sonar, points = prepared.target.laser, prepared.target.sonar, prepared.target.points
    made, before = describe_process(logs), dict(prepared.before)
    parts = {"laser": laser, "sonar": sonar}
    return {
        **made,
        **before,
        "inputs": [*before.get("inputs", []), *made["inputs"]],
        "logs": {kind: list(part.readings.names) for kind, part in parts.items() if part is not None},
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
        "suggested_least": None if suggested is None else suggested[0],
        "suggested_seconds": None if suggested is None else suggested[1],
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
    if not config.prior.is_walls:  # as before there were any
        kept = {name: value for name, value in kept.items() if name not in OF_WALLS}
    digest = hashlib.sha256(json.dumps([kept, seed], sort_keys=True).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def stored_config(run: Run, folder: Path | str) -> tuple[Configuration, int]:
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
