"""`Patches`: a cloud cut into plane patches, which are the nodes of the random field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapq.cloud import PointCloud
from mapq.configuration import SURFACES
from mapq.labels import (
    FROM_FIELD,
    FROM_HAND,
    FROM_NOBODY,
    LABEL_TOLERANCE,
    NO_PATCH,
    PLAUSIBLE,
    SUSPICIOUS,
    UNLABELLED,
    are_metres,
    conservative_labels,
    majority_labels,
    metres_of,
    truth_values,
)
from mapq.picture import Picture, picture_of_points
from prf.shell.cli.pictures import card
from prf.shell.errors import ArgumentError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEEP, FLAT = np.sin(np.radians([30.0, 60.0]))
"""|up . normal| up to which a plane is upright, and from which it is level."""
FEW_FLAT = 0.4
"""Share of neighbourhoods that show a plane below which little is known of a map: right ones, cut at the level that
shows most, have half or more, unless most of them is vegetation; smeared as a whole a quarter to two fifths."""
WIDE_REGION = 30.0
"""Metres of a region's longest side from which its middle is no place to look at, but that of its worst patch is."""
DOUBT, MUCH_DOUBT = 0.1, 0.1
"""Probability above which what is called plausible is in doubt, and the share of the area of which that is much."""


def surface_kinds(
    normal: NDArray[np.float64], up: ArrayLike, bend: NDArray[np.float64] | None = None
) -> NDArray[np.uint8]:
    """Return the place in `SURFACES` of the kind (m,) of patches with unit normals (m, 3); `up` (3,) of any length.

    `bend` (m, 3): as :class:`Patches` has it.
    """
    direction = np.asarray(up, np.float64)
    lean = np.abs(normal @ (direction / np.linalg.norm(direction)))
    upright, level, tilted, curved = range(len(SURFACES))
    kinds = np.where(lean <= STEEP, upright, np.where(lean >= FLAT, level, tilted))
    if bend is not None:
        kinds = np.where(bend.any(axis=1), curved, kinds)
    return kinds.astype(np.uint8)


@dataclass(frozen=True, eq=False, repr=False)
class Patches:
    """A cloud cut into plane patches.

    Attributes
    ----------
    cloud : PointCloud
        All points, in the order of the file.
    patch : (n,) int32
        Patch of each point, `NO_PATCH` for none. Patches are numbered from 0, largest first.
    normal : (m, 3) float64
        Unit normal of each patch's plane; its sign carries no meaning. Of a curved patch at its centroid,
        away from its axis.
    centroid : (m, 3) float64
        Mean of each patch's points, in the frame of ``cloud.xyz``; of a curved patch a place of its surface in their
        midst.
    label : (m,) uint8
        `PLAUSIBLE`, `SUSPICIOUS` or `UNLABELLED`.
    label_source : (m,) uint8
        `FROM_NOBODY`, `FROM_FIELD` or `FROM_HAND`.
    parameters : mapping
        What the segmentation used, estimated or given: numbers, in metres and degrees, and the up direction.
    report : mapping
        What the segmentation found: counts of points dropped and why.
    apart : (m,) float64 or None
        Metres by which each patch is truly apart, nan where not known; None where no field said so.
    label_tolerance : float
        Metres: a label says whether a patch is farther apart than this.
    bend : (m, 3) float64 or None
        Axis of a curved patch (a part of a cylinder), as long as it is bent, in 1/m: one over its radius; 0 for planes.
        None: all are planes.
    """

    cloud: PointCloud
    patch: NDArray[np.int32]
    normal: NDArray[np.float64]
    centroid: NDArray[np.float64]
    label: NDArray[np.uint8]
    label_source: NDArray[np.uint8]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    report: Mapping[str, Any] = field(default_factory=dict)
    apart: NDArray[np.float64] | None = None
    label_tolerance: float = LABEL_TOLERANCE
    bend: NDArray[np.float64] | None = None

    @classmethod
    def unlabelled(
        cls,
        cloud: PointCloud,
        patch: NDArray[np.int32],
        normal: NDArray[np.float64],
        centroid: NDArray[np.float64],
        parameters: Mapping[str, Any],
        report: Mapping[str, Any],
        bend: NDArray[np.float64] | None = None,
    ) -> Patches:
        """Return patches as a segmentation leaves them."""
        n_patches = len(normal)
        label, source = np.full(n_patches, UNLABELLED, np.uint8), np.zeros(n_patches, np.uint8)
        return cls(cloud, patch, normal, centroid, label, source, parameters, report, bend=bend)

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

    @cached_property
    def kinds(self) -> NDArray[np.uint8]:
        """Place (m,) of each patch's kind in :data:`mapq.configuration.SURFACES`."""
        return surface_kinds(self.normal, self.parameters.get("up", (0.0, 0.0, 1.0)), self.bend)

    def label_at(self, tolerance: float) -> NDArray[np.uint8]:
        """Return the labels (m,) that are known at a tolerance in metres: suspicious is what is farther apart.

        By metres where they are known and no label was set by hand. A label alone says at which tolerances it holds:
        suspicious up to `label_tolerance`, plausible from there on.
        """
        holds = np.where(self.label == SUSPICIOUS, tolerance <= self.label_tolerance, tolerance >= self.label_tolerance)
        label = np.where(holds, self.label, np.uint8(UNLABELLED))
        if self.apart is None:
            return label
        measured = np.isfinite(self.apart) & (self.label_source != FROM_HAND)
        return np.where(measured, np.where(self.apart > tolerance, SUSPICIOUS, PLAUSIBLE), label).astype(np.uint8)

    def extent(self, group: NDArray[np.int64]) -> tuple[int, NDArray[np.float64]]:
        """Return the number of points of some patches, and lowest corner, highest corner and mean (3, 3) of them."""
        points, start = self.members
        mine = np.concatenate([points[start[patch] : start[patch + 1]] for patch in group])
        xyz = self.cloud.xyz[mine]
        xyz = xyz[np.isfinite(xyz).all(axis=1)]
        if len(xyz) == 0:
            xyz = self.centroid[group]
        return len(mine), np.array([xyz.min(axis=0), xyz.max(axis=0), np.sort(xyz, axis=0).mean(axis=0)])

    def labelled(self, labels: ArrayLike | str) -> Patches:
        """Return the patches with labels, for :func:`mapq.train`.

        Parameters
        ----------
        labels : (m,) array or str
            1 suspicious, 0 plausible, 255 unknown; or the name of a point field whose majority counts.

        Raises
        ------
        ArgumentError
            If the labels have another shape, or another value.
        InputError
            If there is no such field, or it is not one of 0, 1 and 255.
        """
        if isinstance(labels, str):
            return label_from_field(self, labels, self.cloud.source or "the cloud", overwrite_hand=True)[0]
        label = np.asarray(labels)
        if label.shape != (len(self),):
            raise ArgumentError(f"labels: has shape {label.shape}, must be ({len(self)},), one a patch.")
        if not np.isin(label, (PLAUSIBLE, SUSPICIOUS, UNLABELLED)).all():
            raise ArgumentError("labels: must be 0 (plausible), 1 (suspicious) or 255 (unknown).")
        source = np.where(label == UNLABELLED, FROM_NOBODY, FROM_HAND).astype(np.uint8)
        return replace(self, label=label.astype(np.uint8), label_source=source, apart=None)

    def plot(self, views: tuple[str, ...] = ("plan",)) -> Figure:
        """Return a picture: labels if there are any, else a colour for each patch; views "plan" and "3d"."""
        return self.picture().draw(views)

    def picture(self) -> Picture:
        """Return what :meth:`plot` draws."""
        label = np.append(self.label, np.uint8(UNLABELLED))[self.patch]
        return picture_of_points(self.cloud.source or "arrays", self.cloud.metric_of(self.cloud.xyz), self.patch, label)

    def __repr__(self) -> str:
        """Return the patches in a line."""
        known = int((self.label != UNLABELLED).sum())
        labelled = f", {known:,} labelled" if known else ""
        return f"<mapq.Patches: {len(self):,} patches of {int(self.counts.sum()):,} points{labelled}>"

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows."""
        n_suspicious, n_plausible = (int((self.label == label).sum()) for label in (SUSPICIOUS, PLAUSIBLE))
        facts = {
            "patches": f"{len(self):,}",
            "points": f"{int(self.counts.sum()):,} in patches, {len(self.cloud):,} in all",
            "labels": f"{n_suspicious:,} suspicious, {n_plausible:,} plausible",
            "source": self.cloud.source or "arrays",
        }
        warnings = " ".join(self.report.get("warnings", ()))
        return card("Plane patches", facts | ({"warning": warnings} if warnings else {}), self.picture().png())


@dataclass(frozen=True, eq=False, repr=False)
class PatchesOnDisk(Patches):
    """Patches of a map in tiles, whose points are not in memory: `patch` is empty, and places of the cloud are nan.

    Attributes
    ----------
    sizes : (m,) int64
        Points of each patch.
    low, high : (m, 3) float64
        Box of the points.
    """

    sizes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    low: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    high: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Number of points (m,) of each patch."""
        return self.sizes

    def extent(self, group: NDArray[np.int64]) -> tuple[int, NDArray[np.float64]]:
        """As :meth:`Patches.extent`, from boxes and means of patches."""
        weight = self.sizes[group]
        n_points = int(weight.sum())
        mean = weight @ self.centroid[group] / max(n_points, 1)
        return n_points, np.array([self.low[group].min(axis=0), self.high[group].max(axis=0), mean])


def label_from_field(
    patches: Patches, name: str, where: str, overwrite_hand: bool = False, conservative: bool = False
) -> tuple[Patches, dict[str, int]]:
    """Return the patches of file `where` labelled by a point field, and how many there are of each kind then.

    By the majority of the points, or with `conservative` as :func:`conservative_labels`. Of a field of floats, which is
    metres apart, the median of each patch is kept too.

    Labels set by hand stay unless `overwrite_hand`; labels of an earlier field are replaced, also by none. `n_ties`
    counts patches with as many points of either kind, which became suspicious; `n_kept` those whose label stays.

    Raises InputError as :func:`truth_values`.
    """
    values = truth_values(patches.cloud.fields, name, patches.patch, where, patches.label_tolerance)
    given = np.asarray(patches.cloud.fields[name])
    # A conservative label is no median, and holds at its own tolerance alone.
    by_metres = are_metres(given) and not conservative
    apart = metres_of(patches.patch, len(patches), given) if by_metres else None
    rule = conservative_labels if conservative else majority_labels
    label, ties = rule(patches.patch, len(patches), values)
    source = np.where(label == UNLABELLED, FROM_NOBODY, FROM_FIELD).astype(np.uint8)
    kept = (patches.label_source == FROM_HAND) & (not overwrite_hand)
    label, source = np.where(kept, patches.label, label), np.where(kept, patches.label_source, source)
    n_suspicious, n_plausible = (int(np.count_nonzero(label == kind)) for kind in (SUSPICIOUS, PLAUSIBLE))
    counts = {
        "n_patches": len(patches),
        "n_suspicious": n_suspicious,
        "n_plausible": n_plausible,
        "n_unlabelled": len(patches) - n_suspicious - n_plausible,
        "n_ties": int(np.count_nonzero(ties & ~kept)),
        "n_kept": int(np.count_nonzero(kept)),
    }
    return replace(patches, label=label, label_source=source, apart=apart), counts


def caveat(verdict: Mapping[str, Any]) -> str:
    """Return words that say of a verdict, of this release or one before, that it says little, where it does."""
    flat = verdict.get("flat_share")
    little = flat is not None and flat < FEW_FLAT
    return f"; it says little, as only {flat:.0%} of neighbourhoods are flat at any scale tried" if little else ""


def in_doubt(label: NDArray[np.uint8], probability: ArrayLike, area: ArrayLike) -> str:
    """Return words that say of how much of the area (m,) in m² labels (m,) are in doubt by p (m,); empty of little."""
    is_open = (label != SUSPICIOUS) & (np.asarray(probability) > DOUBT)
    total = np.nansum(area)
    share = float(np.nansum(np.asarray(area)[is_open]) / total) if total else 0.0
    return f"{share:.0%} of the area is in doubt (p above {DOUBT:g})" if share >= MUCH_DOUBT else ""


def large_share(counts: Mapping[str, Any]) -> float:
    """Return the share of all points that lie in patches of any kind, be they judged; nan where that is not known.

    `counts`: those of a result, or of its JSON. The others lie in no plane, or in patches too small to judge.
    """
    judged, coverage, n_points = (counts.get(name) for name in ("n_points_in_patches", "coverage", "n_points"))
    return float(judged / (coverage * n_points)) if judged and coverage and n_points else float("nan")


def apart_words(metres: float, resolution: float) -> str:
    """Return how far scans lie apart; of less than they resolve only that. Both in metres."""
    return f"less than {resolution:.3f} m (what scans resolve)" if metres < resolution else f"{metres:.3f} m"
