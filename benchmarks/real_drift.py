"""Graded errors on scans with right poses: how much of what is displaced by how much is found."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import real_data
from benchmarks.real_methods import say
from mapq.model import Model
from mapq.patches import SUSPICIOUS
from mapq.perturb import PoseErrors, build
from mapq.segmentation import segment

OFFSETS = (0.05, 0.1, 0.2, 0.5, 1.0)
TURNS = (0.5, 1.0, 2.0, 5.0)
"""Metres and degrees by which the second half of the scans is displaced together."""
BINS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Metres: bounds between which patches are counted by how far they are displaced along their normal."""
UNMOVED = 0.02
"""Metres: less is no error."""


class Level(NamedTuple):
    """Patches of maps with one size of error: metres displaced (m,), and whether each method calls them suspicious."""

    source: str
    name: str
    metres: np.ndarray
    called: dict[str, np.ndarray]


def measure(data: Path, models: dict[str, Model], seeds: int) -> list[Level]:
    """Return all levels of all sets; none of them first."""
    sets = {"quad": real_data.quad(data), "hall": real_data.hall(data), "kitti": real_data.kitti(data).every(5)}
    errors = {"0": PoseErrors()}
    errors |= {f"{size:g} m": PoseErrors(missed_loop=(size, 0.0)) for size in OFFSETS}
    errors |= {f"{size:g} deg": PoseErrors(missed_loop=(0.0, size)) for size in TURNS}
    found = []
    for source, scans in sets.items():
        for name, error in errors.items():
            # The large set has patches enough in one map.
            n_maps = 1 if error.is_none or source == "kitti" else seeds
            maps = [
                segment(build(scans, error, reference=scans.poses, seed=seed).cloud) for seed in range(1, n_maps + 1)
            ]
            metres = np.concatenate([real_data.disagreement_of(patches) for patches in maps])
            called = {
                method: np.concatenate([say(patches, method, model).label == SUSPICIOUS for patches in maps])
                for method, model in models.items()
            }
            found.append(Level(source, name, metres, called))
    return found


def summary(levels: list[Level]) -> dict[str, Any]:
    """Return, for JSON, each level's counts and rates, and the curve over all of them."""
    rows = []
    for level in levels:
        unmoved, moved = level.metres < UNMOVED, level.metres >= UNMOVED
        rates = {
            method: {"false_alarms": _share(called[unmoved]), "found": _share(called[moved])}
            for method, called in level.called.items()
        }
        flags = {"unmoved": unmoved, "moved": moved, "not_known": np.isnan(level.metres)}
        counts = {name: int(np.count_nonzero(flag)) for name, flag in flags.items()}
        rows.append({"set": level.source, "error": level.name, **counts, "rates": rates})
    return {"levels": rows, "curve": {source: _curve(levels, source) for source in (*_sources(levels), "all")}}


def _sources(levels: list[Level]) -> list[str]:
    return list(dict.fromkeys(level.source for level in levels))


def _curve(levels: list[Level], source: str) -> dict[str, Any]:
    """Return the share called suspicious in each bin of displacement."""
    some = [level for level in levels if source in (level.source, "all")]
    metres = np.concatenate([level.metres for level in some])
    place = np.digitize(metres, BINS)
    places = [(place == number) & ~np.isnan(metres) for number in range(len(BINS) + 1)]
    curve: dict[str, Any] = {"n": [int(np.count_nonzero(inside)) for inside in places]}
    for method in some[0].called:
        called = np.concatenate([level.called[method] for level in some])
        curve[method] = [_share(called[inside]) for inside in places]
    return curve


def _share(flags: np.ndarray) -> float:
    return float(flags.mean()) if len(flags) else float("nan")


def lines(result: dict[str, Any], main: str) -> Iterator[str]:
    """Yield the curve of every method, and the levels of the main one."""
    edges = ["<" + f"{BINS[0]:g}", *(f"{a:g}-{b:g}" for a, b in pairwise(BINS)), f">{BINS[-1]:g}"]
    for source, curve in result["curve"].items():
        yield f"{source}: share called suspicious, by metres displaced along the normal"
        yield f"  {'':34}" + "".join(f"{edge:>10}" for edge in edges)
        yield f"  {'patches':34}" + "".join(f"{count:>10}" for count in curve["n"])
        for method in curve:
            if method != "n":
                yield f"  {method:34}" + "".join(f"{value:>10.3f}" for value in curve[method])
    yield f"{main}: {'':10}{'unmoved':>9}{'false alarms':>14}{'moved':>9}{'found':>9}"
    for row in result["levels"]:
        rates = row["rates"][main]
        yield (
            f"  {row['set']:8}{row['error']:>10}{row['unmoved']:>12}{rates['false_alarms']:>14.3f}{row['moved']:>9}"
            f"{rates['found']:>9.3f}"
        )
