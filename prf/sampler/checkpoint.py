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
from prf.sampler.chain import ChainSampler
from prf.sampler.chain_map import with_graph
from prf.sampler.chains import Sampler
from prf.sampler.posterior import Settings
from prf.sampler.record import Draw
from prf.sampler.tempering import Tempering
from prf.shell.cli.storage import damaged, load_arrays, save_arrays
from prf.shell.errors import InputError

SCHEMA = names.CHECKPOINT_SCHEMA
LADDER = ("powers", "tried", "rate_sum", "came_from_hottest")
TIMES = ("black_time", "mixed_time")
POSES = ("pose", "spread", "outcomes")
DRAW_ARRAYS = ("vertex_offsets", "xy", "side", "edge_offsets", "edges", "anchor_black")

Arrays = dict[str, NDArray[Any]]


def save_checkpoint(folder: Path, sampler: Sampler, identity: str) -> None:
    """Write the state of all chains into the RUN directory `folder`; `identity` is that of the run."""
    arrays: Arrays = {"run": np.array(identity)}
    if sampler.settings.poses is not None:
        arrays |= prefixed("model.", model_arrays(sampler.settings.poses))
    for i, chain in enumerate(sampler.chains):
        arrays |= prefixed(f"chain{i}.", chain_arrays(chain))
    save_arrays(folder / names.CHECKPOINT, SCHEMA, arrays)


def load_checkpoint(folder: Path, sampler: Sampler, identity: str) -> None:
    """Put the chains of a fresh sampler into the state that was saved for the run `identity`."""
    path = folder / names.CHECKPOINT
    arrays = load_arrays(path, SCHEMA)
    if str(arrays.pop("run", "")) != identity:
        raise InputError(
            f"{path}: belongs to a run of other readings or configuration, or was written by another release. "
            "Sample anew with --force."
        )
    try:
        if "chain0.ladder.powers" in arrays:
            sampler.temper()
        for i, chain in enumerate(sampler.chains):
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


def chain_arrays(sampler: ChainSampler) -> Arrays:
    """Return what decides the future of a chain, and what it has recorded.

    Of draws in the burn-in, which grows but never shrinks, only functionals and colours are read again: their maps are
    left out.
    """
    chain, times, record = sampler.chain, sampler.times, sampler.record
    settle_all(chain.image, sampler.step)
    arrays = state_arrays(chain, sampler.rng) | {
        "image.black": chain.image.black,
        **{f"image.{name}": getattr(chain.image, name) for name in TIMES},
        "times.starts": np.array([times.start, times.previous_start]),
        "times.previous_black": times.previous_black,
        "times.previous_mixed": times.previous_mixed,
        "record.thin": np.array(record.thin),
        "record.from": np.array(sampler.recorded_from),
        "targets.cumulative": chain.targets.cumulative,
        "doubts.count": sampler.doubts.count,
        "doubts.looks": np.array(sampler.doubts.looks),
    }
    if sampler.tempering is not None:
        arrays |= tempering_arrays(sampler.tempering)
    if sampler.poses is not None:
        arrays |= {f"poses.{name}": getattr(sampler.poses.state, name) for name in POSES}
    without = Coloring.empty(sampler.settings.window, False)
    draws = [
        draw if draw.step > sampler.burn_in else dataclasses.replace(draw, coloring=without) for draw in record.draws
    ]
    best = [] if record.best is None else [record.best]
    return arrays | prefixed("draws.", draw_arrays(draws, sampler)) | prefixed("best.", draw_arrays(best, sampler))


def restore(sampler: ChainSampler, arrays: Arrays) -> None:
    """Put a fresh chain into a stored state: the graph as it was, all that follows from it recomputed."""
    if sampler.poses is not None:
        for name in POSES:
            getattr(sampler.poses.state, name)[:] = arrays[f"poses.{name}"]
        sampler.chain = sampler.poses.place(sampler.chain, arrays["poses.pose"])
    sampler.chain = restored_state(sampler.chain, sampler.rng, sampler.settings, arrays)
    restore_image(sampler, arrays)
    if sampler.tempering is not None:
        restore_tempering(sampler.tempering, arrays)
    sampler.chain.targets.cumulative[:] = arrays["targets.cumulative"]
    sampler.doubts.count = np.array(arrays["doubts.count"])
    sampler.doubts.looks = float(arrays["doubts.looks"])
    sampler.recorded_from = int(arrays["record.from"])
    sampler.record.thin = int(arrays["record.thin"])
    sampler.record.draws = restored_draws(under("draws.", arrays), sampler)
    sampler.record.best = next(iter(restored_draws(under("best.", arrays), sampler)), None)


def draw_arrays(draws: list[Draw], sampler: ChainSampler) -> Arrays:
    """Return draws as ragged arrays."""
    stored = Draws.from_colorings([draw.coloring for draw in draws], sampler.settings.window)
    n_functionals, n_probes = (len(draws[0].functionals), len(draws[0].probe_black)) if draws else (0, 0)
    return {name: getattr(stored, name) for name in DRAW_ARRAYS} | {
        "step": np.array([draw.step for draw in draws], np.int64),
        "functionals": np.array([draw.functionals for draw in draws]).reshape(len(draws), n_functionals),
        "probe_black": np.array([draw.probe_black for draw in draws], np.bool_).reshape(len(draws), n_probes),
        **({} if sampler.poses is None else {"poses": np.array([draw.poses for draw in draws], np.float32)}),
    }


def restored_draws(arrays: Arrays, sampler: ChainSampler) -> list[Draw]:
    """Return the draws that :func:`draw_arrays` stored."""
    stored = Draws(sampler.settings.window, *(arrays[name] for name in DRAW_ARRAYS))
    poses = arrays.get("poses", np.full(len(arrays["step"]), None))
    rows = zip(arrays["step"].tolist(), stored, arrays["functionals"], arrays["probe_black"], poses, strict=True)
    return [Draw(step, Coloring(*coloring), values, black, at) for step, coloring, values, black, at in rows]


def state_arrays(chain: Chain, rng: np.random.Generator) -> Arrays:
    """Return the map of a chain, the outcomes of its moves, and its generator."""
    graph = prefixed("graph.", chain.graph._asdict())
    return graph | {"outcomes": chain.outcomes, "generator": generator_array(rng)}


def restored_state(chain: Chain, rng: np.random.Generator, settings: Settings, arrays: Arrays) -> Chain:
    """Return the chain at the map of :func:`state_arrays`, and put its generator there too."""
    if arrays["outcomes"].shape != chain.outcomes.shape:
        raise ValueError("its moves are those of another version of prf")
    graph = chain.graph._replace(**{name: arrays[f"graph.{name}"] for name in chain.graph._fields})
    rng.bit_generator.state = json.loads(str(arrays["generator"]))
    return with_graph(chain._replace(outcomes=arrays["outcomes"]), settings, graph)


def generator_array(rng: np.random.Generator) -> NDArray[Any]:
    """Return the state of a generator as an array."""
    return np.array(json.dumps(rng.bit_generator.state))


def tempering_arrays(tempering: Tempering) -> Arrays:
    """Return what decides the future of the hot chains and of the swaps."""
    ladder = tempering.ladder
    arrays = {f"ladder.{name}": getattr(ladder, name) for name in LADDER} | {
        "ladder.round_trips": np.array(ladder.round_trips),
        "ladder.first_step": np.array(tempering.first_step),
        "ladder.generator": generator_array(tempering.swap_rng),
    }
    for k, (chain, rng) in enumerate(zip(tempering.hot, tempering.generators, strict=True), 1):
        arrays |= prefixed(f"hot{k}.", state_arrays(chain, rng))
    return arrays


def restore_tempering(tempering: Tempering, arrays: Arrays) -> None:
    """Put fresh hot chains into a stored state."""
    ladder = tempering.ladder
    for name in LADDER:
        setattr(ladder, name, arrays[f"ladder.{name}"])
    ladder.round_trips = int(arrays["ladder.round_trips"])
    tempering.first_step = int(arrays["ladder.first_step"])
    tempering.swap_rng.bit_generator.state = json.loads(str(arrays["ladder.generator"]))
    tempering.hot = [
        restored_state(chain, rng, tempering.settings, under(f"hot{k}.", arrays))
        for k, (chain, rng) in enumerate(zip(tempering.hot, tempering.generators, strict=True), 1)
    ]
    tempering.apply_powers()


def restore_image(sampler: ChainSampler, arrays: Arrays) -> None:
    """Put the image of a restored chain and its epochs into the stored state."""
    image, times = sampler.chain.image, sampler.times
    image.black[:] = arrays["image.black"]
    image.black_since[:] = sampler.step
    image.mixed_since[:] = sampler.step
    count_edges(image, read_coloring(sampler.chain.graph).segments(), sampler.step)
    for name in TIMES:
        getattr(image, name)[:] = arrays[f"image.{name}"]
    times.start, times.previous_start = (int(start) for start in arrays["times.starts"])
    times.previous_black = arrays["times.previous_black"]
    times.previous_mixed = arrays["times.previous_mixed"]
