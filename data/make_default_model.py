"""Train the model that ships with mapq, on simulated maps of many kinds: ``make model``, half an hour on two cores.

Half of the maps are right: those of users are right for the most part, and a model that has hardly seen such maps calls
too much suspicious. Worlds of `data.training_worlds` are seen by several sensors from 2 to 60 places, at 1 to 1/20 of
their points; drives through `mapq simulate`'s city come beside them. Each map counts a second time as if nobody knew
when and from where its points were seen, as most maps of users are. Labels are metres: how far apart the scans that see
a surface truly are.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from data.training_worlds import training_patches
from mapq.configuration import SimulateSettings, TrainSettings
from mapq.crf.calibration import with_false_alarms
from mapq.io.models import write_model
from mapq.patches import Patches, label_from_field
from mapq.segmentation import segment
from mapq.simulate import simulate
from mapq.training import train_maps

MODEL = Path(__file__).resolve().parent.parent / "mapq" / "models" / "default.json"

N_WORLDS = 160
"""Seeds from 0: those of even number are right maps, odd ones wrong."""
STREET = {"variety": 1.0, "all_round": True}
BUSY = {"variety": 3.0, "look_alikes": 2.0, "all_round": True}
LOOK_ALIKES = {"variety": 1.0, "look_alikes": 3.0}
SPARSE = {"n_points": 250_000}
CITIES: tuple[tuple[int, float, float, dict[str, Any]], ...] = (
    # seed, standard deviation of ranges in metres, drift in times the usual, world
    (101, 0.010, 1.0, STREET),
    (102, 0.015, 1.0, {"variety": 0.0}),
    (104, 0.030, 1.0, STREET),
    (105, 0.050, 1.5, {"variety": 2.0, "all_round": True}),
    (107, 0.030, 0.6, STREET | SPARSE),
    (110, 0.010, 0.0, LOOK_ALIKES | STREET),
    (112, 0.050, 0.0, BUSY),
    (113, 0.015, 0.0, BUSY),
    (117, 0.010, 0.0, BUSY | SPARSE),
    (119, 0.030, 0.0, LOOK_ALIKES | SPARSE),
)
MOST_FALSE_ALARMS = 0.03
"""Of the plausible patches that were kept out."""


def world(seed: int) -> Patches:
    """Return the labelled patches of a training world."""
    return training_patches(seed, bool(seed % 2))


def city(row: tuple[int, float, float, dict[str, Any]]) -> Patches:
    """Return the labelled patches of a drive through the simulated city."""
    seed, noise, drift, given = row
    patches = segment(simulate(SimulateSettings(noise=noise, drift=drift, **given), seed))
    return label_from_field(patches, "disagreement", f"city, seed {seed}")[0]


def main() -> None:
    """Write the model."""
    MODEL.parent.mkdir(exist_ok=True)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        maps = [*pool.map(world, range(N_WORLDS)), *pool.map(city, CITIES)]
    maps = [each for each in maps if len(each)]
    model = train_maps(maps, TrainSettings(class_weight="none"))
    model = with_false_alarms(model, MOST_FALSE_ALARMS, str(MODEL))
    # What is of this run alone goes out: the same seeds give the same bytes.
    rows = [{name: value for name, value in row.items() if name != "sha256"} for row in model.training["maps"]]
    training = {name: value for name, value in model.training.items() if name != "created"} | {"maps": rows}
    write_model(MODEL, replace(model, training=training))
    moved = sorted(model.training["importance"].items(), key=lambda row: -row[1])
    print("wrote", MODEL, "; log-odds move by", ", ".join(f"{name} {np.round(nats, 2)}" for name, nats in moved))


if __name__ == "__main__":
    main()
