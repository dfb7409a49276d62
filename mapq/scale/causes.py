"""Why patches of a map in tiles are wrong: when their points were seen, from the drive of the whole map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.assess.causes import Cause, Spread, cause_of, copies_of, measure_spread, median_apart, some_of
from mapq.assess.visits import Clock, Stays, Visits, to_sensor_of, visits_from
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
    clock : Clock
    value : (k,) float64
        Of the clock at all moments of the map.
    visits : Visits
        Of the map, without points.
    part : Part
    """

    patches: Ints
    copies: list[list[int]]
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
        measure_spread(patches, place, np.searchsorted(chosen, copies).tolist(), visits)
        for place, copies in zip(places, task.copies, strict=True)
    ]


class Found(NamedTuple):
    """What is known of when a map was seen.

    Attributes
    ----------
    visits : Visits
        Of the map, without points.
    causes : dict of int to Cause
        Of suspicious patches.
    scans_apart : float
        Metres by which scans of one visit put a patch apart, in the median.
    """

    visits: Visits
    causes: dict[int, Cause]
    scans_apart: float


def plan_causes(
    groups: list[Ints], suspicious: NDArray[np.bool_], features: PatchFeatures, clock: Clock, stays: Stays, part: Part
) -> list[CauseTask]:
    """Return the tasks: for each group of patches that lie together those of them that are asked."""
    visits = visits_from(clock, stays, np.zeros(0, np.int64), None)
    asked = suspicious.copy()
    asked[some_of(len(suspicious))] = True
    copies = copies_of(features, len(suspicious))
    tasks = []
    for group in groups:
        some = group[asked[group]]
        if len(some):
            several = [copies[patch] for patch in some.tolist()]
            tasks.append(CauseTask(some, several, clock, stays.value, visits, part))
    return tasks


def judge_spreads(tasks: list[CauseTask], spreads: list[list[Spread]], suspicious: NDArray[np.bool_]) -> Found | None:
    """Return the causes that the spreads speak for; None where nothing was asked."""
    if not tasks:
        return None
    visits = tasks[0].visits
    by_patch = {
        patch: spread
        for task, several in zip(tasks, spreads, strict=True)
        for patch, spread in zip(task.patches.tolist(), several, strict=True)
    }
    causes = {int(patch): cause_of(by_patch[int(patch)], visits) for patch in np.flatnonzero(suspicious)}
    return Found(visits, causes, median_apart([by_patch[patch] for patch in some_of(len(suspicious))]))
