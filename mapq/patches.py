"""`Patches`: a cloud cut into plane patches, which are the nodes of the random field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud

NO_PATCH = -1
"""Patch number of a point that belongs to none."""

PLAUSIBLE, SUSPICIOUS, UNLABELLED = 0, 1, 255
"""Labels of a patch; `UNLABELLED` also marks points without a patch in a result."""

FROM_NOBODY, FROM_FIELD, FROM_HAND = 0, 1, 2
"""Where a label comes from: those set by hand outrank those from a field."""


@dataclass(frozen=True)
class Patches:
    """A cloud cut into plane patches.

    Attributes
    ----------
    cloud : PointCloud
        All points, in the order of the file.
    patch : (n,) int32
        Patch of each point, `NO_PATCH` for none. Patches are numbered from 0, largest first.
    normal : (m, 3) float64
        Unit normal of each patch's plane; its sign carries no meaning.
    centroid : (m, 3) float64
        Mean of each patch's points, in the frame of ``cloud.xyz``.
    label : (m,) uint8
        `PLAUSIBLE`, `SUSPICIOUS` or `UNLABELLED`.
    label_source : (m,) uint8
        `FROM_NOBODY`, `FROM_FIELD` or `FROM_HAND`.
    parameters : mapping
        What the segmentation used, estimated or given: numbers, in metres and degrees, and the up direction.
    report : mapping
        What the segmentation found: counts of points dropped and why.
    """

    cloud: PointCloud
    patch: NDArray[np.int32]
    normal: NDArray[np.float64]
    centroid: NDArray[np.float64]
    label: NDArray[np.uint8]
    label_source: NDArray[np.uint8]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    report: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def unlabelled(
        cls,
        cloud: PointCloud,
        patch: NDArray[np.int32],
        normal: NDArray[np.float64],
        centroid: NDArray[np.float64],
        parameters: Mapping[str, Any],
        report: Mapping[str, Any],
    ) -> Patches:
        """Return patches as a segmentation leaves them."""
        n_patches = len(normal)
        label = np.full(n_patches, UNLABELLED, np.uint8)
        return cls(cloud, patch, normal, centroid, label, np.zeros(n_patches, np.uint8), parameters, report)

    def __len__(self) -> int:
        """Return the number of patches."""
        return len(self.normal)

    @cached_property
    def members(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Points of all patches, patch after patch, each patch's in ascending order; and where each patch begins.

        The points of patch i are ``points[start[i]:start[i + 1]]``.
        """
        order = np.argsort(self.patch, kind="stable")
        n_without = int(np.count_nonzero(self.patch == NO_PATCH))
        start = np.zeros(len(self) + 1, np.int64)
        np.cumsum(self.counts, out=start[1:])
        return order[n_without:], start

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Number of points (m,) of each patch."""
        return np.bincount(self.patch[self.patch != NO_PATCH], minlength=len(self)).astype(np.int64)
