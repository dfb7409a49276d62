"""Why patches of a map in tiles are wrong: when their points were seen, from the drive of the whole map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.assess.causes import Cause, Spread, cause_of, copies_of, measure_spread, reach_of
from mapq.assess.visits import Clock, Visits, to_sensor_of
from mapq.graph import PatchFeatures
from mapq.scale.gather import Part, gather
from mapq.scale.patches import load_whole

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class CauseTask(NamedTuple):
    """What the search for causes is given.

    Attributes
    ----------
    patches : (c,) int64
        That are asked.
    copies : list of list of int
        Of each the patches that may be copies of its surface.
    reach : list of float
        Of each the metres off it up to which points are looked at.
    clock : Clock
    value : (k,) float64
        Of the clock at all moments of the map.
    visits : Visits
        Of the map, without points.
    part : Part
    """

    patches: Ints
    copies: list[list[int]]
    reach: list[float]
    clock: Clock
    value: Floats
    visits: Visits
    part: Part


def measure_spreads(task: CauseTask) -> list[Spread]:
    """Return how the points of patches and of their copies part."""
    whole = load_whole(task.part.folder)
    chosen = np.unique(np.concatenate([task.patches, *(np.array(each, np.int64) for each in task.copies)]))
    patches = gather(whole, chosen, task.part)
    values = task.clock.values(patches.cloud)
    moment = np.where(np.isfinite(values), np.searchsorted(task.value, values), -1).astype(np.int64)
    visits = task.visits._replace(moment=moment, to_sensor=to_sensor_of(patches.cloud, task.clock))
    places = np.searchsorted(chosen, task.patches).tolist()
    return [
        measure_spread(patches, place, np.searchsorted(chosen, copies).tolist(), visits, reach)
        for place, copies, reach in zip(places, task.copies, task.reach, strict=True)
    ]


class Found(NamedTuple):
    """What is known of when a map was seen.

    Attributes
    ----------
    visits : Visits
        Of the map, without points.
    causes : dict of int to Cause
        Of suspicious patches.
    """

    visits: Visits
    causes: dict[int, Cause]


def plan_causes(
    groups: list[Ints],
    suspicious: NDArray[np.bool_],
    features: PatchFeatures,
    about: tuple[Clock, Floats, Visits, Part],
) -> list[CauseTask]:
    """Return the tasks, each of the suspicious patches of a group that lies together, and what all tasks are given."""
    copies, reach = copies_of(features, len(suspicious)), reach_of(features)
    tasks = []
    for group in groups:
        some = group[suspicious[group]]
        if len(some):
            several = [copies[patch] for patch in some.tolist()]
            tasks.append(CauseTask(some, several, reach[some].tolist(), *about))
    return tasks


def judge_spreads(
    tasks: list[CauseTask], spreads: list[list[Spread]], features: PatchFeatures, visits: Visits
) -> Found:
    """Return the causes that the spreads speak for, by patch in ascending order."""
    causes = {
        patch: cause_of(spread, visits, features.disagreement[patch])
        for task, several in zip(tasks, spreads, strict=True)
        for patch, spread in zip(task.patches.tolist(), several, strict=True)
    }
    return Found(visits, dict(sorted(causes.items())))
