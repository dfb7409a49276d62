"""The result of a map in tiles: what a model says of its patches, without their points."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.assess.causes import Cause
from mapq.assess.regions import Region, find_regions
from mapq.assess.result import MIN_COVERAGE, Result
from mapq.assess.visits import Visits
from mapq.cloud import PointCloud
from mapq.patches import Patches
from mapq.scale.causes import Found
from mapq.scale.patches import Whole


@dataclass(frozen=True)
class TiledPatches(Patches):
    """Patches whose points are not at hand; `patch` is empty, and the cloud has places without a value.

    Attributes
    ----------
    sizes : (m,) int64
        Points of each patch.
    """

    sizes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Number of points (m,) of each patch."""
        return self.sizes


@dataclass(frozen=True)
class TiledResult(Result):
    """What a model says of a map in tiles.

    Attributes
    ----------
    whole : Whole or None
        Its patches.
    n_tiles : int
    found : Found or None
        What is known of when the map was seen.
    """

    whole: Whole | None = None
    n_tiles: int = 0
    found: Found | None = None

    @cached_property
    def visits(self) -> Visits | None:
        """Return how long visits of the map last, without points; None where it does not say."""
        return None if self.found is None else self.found.visits

    @cached_property
    def causes(self) -> dict[int, Cause]:
        """Return what made each suspicious patch so, as far as it is known, by its number."""
        return super().causes if self.found is None else self.found.causes

    @cached_property
    def regions(self) -> list[Region]:
        """Return the regions of connected suspicious patches, the most severe first.

        Their boxes are found from those of the patches, as if these had two points each.
        """
        whole = self.whole
        assert whole is not None
        n_patches = len(whole.n_points)
        corners = np.concatenate([whole.low, whole.high])
        cloud = PointCloud(corners, self.patches.cloud.shift, unit=self.patches.cloud.unit)
        number = np.tile(np.arange(n_patches, dtype=np.int32), 2)
        boxes = Patches.unlabelled(cloud, number, whole.normal, whole.centroid, {}, {})
        found = find_regions(boxes, self.features, self.is_suspicious, self.labelling.probability, self.area)
        return [self._corrected(region, whole) for region in found]

    def _corrected(self, region: Region, whole: Whole) -> Region:
        """Return a region with the number and the mean of its points."""
        weight = whole.n_points[region.patches]
        middle = weight @ whole.centroid[region.patches] / max(int(weight.sum()), 1)
        return region._replace(n_points=int(weight.sum()), centre=self.patches.cloud.world_of(middle))

    def head(self, fail_over: float | None = None, min_coverage: float = MIN_COVERAGE) -> dict[str, Any]:
        """Return the JSON of a result without its patches, and in how many tiles the map was cut."""
        return {**super().head(fail_over, min_coverage), "tiles": self.n_tiles}


def tiled_patches(
    whole: Whole,
    frame: PointCloud,
    n_points: int,
    parameters: dict[str, Any],
    report: dict[str, Any],
) -> TiledPatches:
    """Return the patches of a map without its points.

    Parameters
    ----------
    whole : Whole
    frame : PointCloud
        Whose shift, unit and name are those of the map.
    n_points : int
        Of the map.
    parameters, report : dict
        Of the segmentation.
    """
    nowhere = np.broadcast_to(np.full((1, 3), np.nan), (n_points, 3))
    cloud = PointCloud(nowhere, frame.shift, source=frame.source, unit=frame.unit)
    plain = Patches.unlabelled(cloud, np.zeros(0, np.int32), whole.normal, whole.centroid, parameters, report)
    named = {name: getattr(plain, name) for name in Patches.__dataclass_fields__}
    return TiledPatches(**named, sizes=whole.n_points)
