"""What is measured of the patches of a map in tiles: features, and why those that are suspicious are so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.assess.visits import Clock, join_stays, visits_from
from mapq.axes import turn
from mapq.features.disagreement import OWNED, WINDOW, window_centres
from mapq.features.provenance import Known
from mapq.features.settings import FeatureSettings
from mapq.graph import PatchFeatures
from mapq.scale.causes import Found, judge_spreads, measure_spreads, plan_causes
from mapq.scale.gather import Part
from mapq.scale.graph import join_measures
from mapq.scale.measure import LARGEST_PATCH, MeasureTask, measure_patches, share_out
from mapq.scale.patches import Whole
from mapq.scale.spool import Spooled
from mapq.scale.stages import Stages
from mapq.scale.tiling import Tiling

Ints = NDArray[np.int64]


class Seen(NamedTuple):
    """Which fields say where and when points were seen: those for the features, and those for causes."""

    known: Known
    clock: Clock | None

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of all of them."""
        return tuple(dict.fromkeys((*self.known.fields, *(self.clock.fields if self.clock is not None else ()))))


class Cutting(NamedTuple):
    """A map that is cut into patches.

    Attributes
    ----------
    whole : Whole
        Like all files of the work folder in the map's own axes.
    quarter : int
        Quarters by which those are turned against the axes of its files; see :mod:`mapq.axes`.
    parameters, report : dict
        Of the segmentation, in the axes of the files.
    tiling : Tiling
    seen : Seen
        Which fields say where and when points were seen.
    spooled : list of Spooled
        By range.
    starts : dict
        By tile and range, where its points begin in the tile's file of regions.
    """

    whole: Whole
    quarter: int
    parameters: dict[str, Any]
    report: dict[str, Any]
    tiling: Tiling
    seen: Seen
    spooled: list[Spooled]
    starts: dict[tuple[int, int], int]


class Measuring:
    """The measuring of the patches of a map.

    Parameters
    ----------
    cutting : Cutting
    settings : FeatureSettings
        With the noise of the map.
    up : list of float
        Unit vector in the axes of the files.
    stages : Stages
    tile_points : int
        That a task measures, about, with what lies over their patches.
    folder : str
        The work folder.
    """

    def __init__(
        self,
        cutting: Cutting,
        settings: FeatureSettings,
        up: list[float],
        stages: Stages,
        tile_points: int,
        folder: str,
    ) -> None:
        x, y, z = turn(np.array(up), cutting.quarter).tolist()
        self._cutting, self._settings, self._up = cutting, replace(settings, up=(x, y, z)), up
        self._stages, self._folder = stages, folder
        # Points of no patch that lie about them are loaded too: as many as there are of them in the whole map.
        in_patches, others = (
            int((each[:, 2] - each[:, 1]).sum()) for each in (cutting.whole.piece, cutting.whole.rest)
        )
        self._most = max(1, tile_points * in_patches // max(in_patches + others, 1))
        several = len(share_out(cutting.whole, self._most, None)) > 1
        self._largest = LARGEST_PATCH if several else None
        self._groups = share_out(cutting.whole, self._most, self._largest) or [np.zeros(0, np.int64)]

    def features(self) -> PatchFeatures:
        """Return the features of all patches and pairs."""
        known = self._cutting.seen.known
        part = self._part(known.fields)
        whole, boxes = self._cutting.whole, self._cutting.tiling.boxes
        centres = window_centres(whole.centroid, np.argsort(np.lexsort((*whole.centroid.T[::-1], -whole.n_points))))
        owner, given = cKDTree(centres).query(whole.centroid)[1], (self._settings, part, known, boxes)
        tasks = []
        for group in self._groups:
            away = cKDTree(centres[np.unique(owner[group])]).query(centres)[0]
            tasks.append(MeasureTask(group, *given, centres[away <= WINDOW + OWNED], self._most))
        measured = self._stages.each("measuring", measure_patches, tasks)
        return join_measures(measured, len(self._cutting.whole.n_points), self._settings, self._up)

    def causes(self, features: PatchFeatures, suspicious: NDArray[np.bool_]) -> Found | None:
        """Return why suspicious patches (a mask) are so; None where the map does not say when it was seen."""
        clock = self._cutting.seen.clock
        parts = [each.stays for each in self._cutting.spooled if each.stays is not None]
        if clock is None or not parts:
            return None
        stays, part = join_stays(parts), self._part(clock.fields)
        visits = visits_from(clock, stays, np.zeros(0, np.int64), None)
        tasks = plan_causes(self._groups, suspicious, features, (clock, stays.value, visits, part))
        return judge_spreads(tasks, self._stages.each("finding causes", measure_spreads, tasks), features, visits)

    def _part(self, fields: tuple[str, ...]) -> Part:
        return Part(fields, self._largest, self._folder)
