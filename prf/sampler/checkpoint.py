"""Checkpoints: all that decides the future of chains. A resumed run repeats an uninterrupted one bit for bit."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.kernels.state.chain import Chain
from prf.kernels.state.image import count_edges, settle_all
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring
from prf.poses.model import LocalReadings, PoseModel, PosePrior
from prf.results import names
from prf.sampler.chain import ChainRun, Draw
from prf.sampler.ensemble import Ensemble
from prf.sampler.state import with_graph
from prf.sampler.target import Target
from prf.sampler.tempering import Ladder
from prf.shell.cli.storage import damaged, load_arrays, save_arrays
from prf.shell.errors import InputError

SCHEMA = names.CHECKPOINT_SCHEMA
LADDER = ("powers", "tried", "rate_sum", "came_from_hottest")
TIMES = ("black_time", "mixed_time")
POSES = ("pose", "spread", "outcomes")
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
    arrays |= prefixed("prior.", model.prior._asdict())
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
        prior = PosePrior(**under("prior.", arrays))
        return PoseModel(prior, arrays["scan"], arrays["time"], arrays["start"], laser, sonar)
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
        arrays |= {f"poses.{name}": getattr(run.poses.state, name) for name in POSES}
    without = Coloring.empty(run.target.window, False)
    draws = [draw if draw.step > run.burn_in else dataclasses.replace(draw, coloring=without) for draw in record.draws]
    best = [] if record.best is None else [record.best]
    return arrays | prefixed("draws.", draw_arrays(draws, run)) | prefixed("best.", draw_arrays(best, run))


def restore(run: ChainRun, arrays: Arrays) -> None:
    """Put a fresh chain into a stored state: the graph as it was, all that follows from it recomputed."""
    if run.poses is not None:
        for name in POSES:
            getattr(run.poses.state, name)[:] = arrays[f"poses.{name}"]
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
    return graph | {"outcomes": chain.outcomes, "generator": generator_array(rng)}


def restored_state(chain: Chain, rng: np.random.Generator, target: Target, arrays: Arrays) -> Chain:
    """Return the chain at the map of :func:`state_arrays`, and put its generator there too."""
    if arrays["outcomes"].shape != chain.outcomes.shape:
        raise ValueError("its moves are those of another version of prf")
    graph = chain.graph._replace(**{name: arrays[f"graph.{name}"] for name in chain.graph._fields})
    rng.bit_generator.state = json.loads(str(arrays["generator"]))
    return with_graph(chain._replace(outcomes=arrays["outcomes"]), target, graph)


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
