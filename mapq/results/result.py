"""`Result`: what a model infers about a map, patch by patch, region by region, and as a whole."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib import recfunctions
from numpy.typing import ArrayLike, NDArray

from mapq.cloud import PointCloud
from mapq.configuration import SURFACES
from mapq.crf import Labelling, Terms, classify, explain
from mapq.features import patch_features
from mapq.features.compute import feature_settings
from mapq.features.table import PatchFeatures
from mapq.io.maps import StoredResult
from mapq.io.models import read_default_model
from mapq.io.results import json_beside, result_cloud, write_result
from mapq.labels import SUSPICIOUS, UNLABELLED
from mapq.model import Model
from mapq.patches import Patches
from mapq.picture import Picture, picture_of_points
from mapq.posed.check_poses import CheckedPoses
from mapq.report.findings import findings_of
from mapq.report.page import write_report
from mapq.results.causes import CAUSES, Cause, find_causes
from mapq.results.content import counts_of, head_of, patch_rows, share_of
from mapq.results.evaluate import Scores, score_labels
from mapq.results.reasons import Reason, Reasons, Region, find_regions, largest_median, medians_by_kind
from mapq.results.verdict import MIN_COVERAGE, resolution_of, tolerance_of, verdict_of
from mapq.results.visits import Visits, visits_of
from mapq.segmentation.parameters import refuse_other_unit
from prf.shell.cli.console import Report
from prf.shell.cli.outputs import refuse_existing
from prf.shell.cli.pictures import card
from prf.shell.cli.storage import describe_process, jsonable
from prf.shell.errors import ArgumentError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AREA = "area_m2"
"""Name of the area of a patch, in m², among the shape measures."""

N_REASONS = 3
"""Reasons of each patch in the JSON of a result."""
N_LISTED = 5
"""Regions that the card in a notebook lists."""


class Origin(NamedTuple):
    """Inputs of a result."""

    name: str = "the map"  # of the map, for messages
    model: str = "default"  # "default", the model's file, or "given"
    files: tuple[str, ...] = ()  # whose digests a written result has


class Seen(NamedTuple):
    """When a map was seen, without its points (None: not known), and the cause of each suspicious patch."""

    visits: Visits | None
    causes: dict[int, Cause]


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """Labels of the patches of a map, with probabilities and reasons.

    Attributes
    ----------
    patches : Patches
    features : PatchFeatures
    model : Model
    labelling : Labelling
    terms : Terms
        Why each patch has its label.
    tolerance : float
        Metres: suspicious is what is farther apart along its normal.
    origin : Origin
    seen : Seen or None
        None: found from the points.
    poses : CheckedPoses
        Scans and edges that are wrong.
    """

    patches: Patches
    features: PatchFeatures
    model: Model
    labelling: Labelling
    terms: Terms
    tolerance: float
    origin: Origin = field(default_factory=Origin)
    seen: Seen | None = None
    poses: CheckedPoses = field(default_factory=CheckedPoses)

    @property
    def label(self) -> NDArray[np.uint8]:
        """Of each patch (m,): 1 suspicious, 0 plausible."""
        return self.labelling.label

    @property
    def probability(self) -> NDArray[np.float32]:
        """Probability (m,) that each patch is suspicious."""
        return self.labelling.probability

    @property
    def patch(self) -> NDArray[np.int32]:
        """Patch of each point (n,), -1 for none."""
        return self.patches.patch

    @cached_property
    def suspicious(self) -> NDArray[np.uint8]:
        """Of each point (n,): 1 in a suspicious patch, 0 in a plausible one, 255 in none."""
        return np.append(self.label, np.uint8(UNLABELLED))[self.patch]

    @cached_property
    def p_suspicious(self) -> NDArray[np.float32]:
        """Probability (n,) that the patch of each point is suspicious; nan where there is none."""
        return np.append(self.probability, np.float32(np.nan))[self.patch].astype(np.float32)

    def table(self) -> NDArray[np.void]:
        """Return a row a patch (m,), a structured array that ``pandas.DataFrame`` takes.

        Columns are those of `features.nodes`, x, y, z of the middle in world coordinates, label, p_suspicious,
        difference (nats) and region (-1: none).
        """
        region = np.full(len(self.patches), -1, np.int32)
        for number, found in enumerate(self.regions):
            region[found.patches] = number
        middle = self.patches.cloud.world_of(self.patches.centroid)
        columns: dict[str, NDArray[Any]] = {
            **dict(zip("xyz", middle.T, strict=True)),
            "label": self.label,
            "p_suspicious": self.probability,
            "difference": self.labelling.difference,
            "region": region,
        }
        names, values = list(columns), list(columns.values())
        return np.asarray(recfunctions.append_fields(self.features.nodes, names, values, usemask=False))

    def cloud(self) -> PointCloud:
        """Return all points with the fields of a result."""
        found = self.patches
        return result_cloud(found.cloud, found.patch, self.label, self.probability, self.cause_codes())

    def cause_codes(self) -> NDArray[np.uint8] | None:
        """Return the place of each patch's cause (m,) among `CAUSES`, 255 where it is plausible; None if unknown."""
        if self.visits is None:
            return None
        codes = np.full(len(self.patches), UNLABELLED, np.uint8)
        for patch, found in self.causes.items():
            codes[patch] = CAUSES.index(found.kind)
        return codes

    @cached_property
    def is_suspicious(self) -> NDArray[np.bool_]:
        """Return which patches (m,) are suspicious."""
        return np.asarray(self.labelling.label == SUSPICIOUS)

    @cached_property
    def area(self) -> NDArray[np.float64]:
        """Return the area (m,) of each patch in m²; nan where the features do not have it."""
        if AREA not in self.features.shape_names:
            return np.full(len(self.patches), np.nan)
        return self.features.shape[:, self.features.shape_names.index(AREA)]

    @property
    def coverage(self) -> float:
        """Share of the points on planes of any kind that are in patches, and so judged; nan where that is not known."""
        others = self.patches.report.get("not_judged")
        if not isinstance(others, Mapping):
            return float("nan")
        judged = int(self.patches.counts.sum())
        return judged / max(judged + sum(int(each["points"]) for each in others.values()), 1)

    @property
    def counts(self) -> dict[str, Any]:
        """How much of the map is suspicious: patches, points and area, and their shares (nan of nothing).

        The expected share is the mean of p_suspicious over the area: what is wrong if p is right.
        """
        return counts_of(self)

    def worst(self, n_most: int) -> list[int]:
        """Return the most severe suspicious patches, at most `n_most`: by area (else points) times probability."""
        size = self.area if np.isfinite(self.area).all() else self.patches.counts
        candidates = np.flatnonzero(self.is_suspicious)
        order = np.argsort(-(size * self.probability.astype(np.float64))[candidates], kind="stable")
        return [int(patch) for patch in candidates[order[:n_most]]]

    @cached_property
    def regions(self) -> list[Region]:
        """Return the regions of connected suspicious patches, the most severe first."""
        return find_regions(self.patches, self.features, self.is_suspicious, self.labelling.probability, self.area)

    @cached_property
    def visits(self) -> Visits | None:
        """Return when the points were seen; None where the cloud does not record it."""
        return self.seen.visits if self.seen is not None else visits_of(self.patches.cloud)

    @cached_property
    def causes(self) -> dict[int, Cause]:
        """Return what made each suspicious patch so, as far as it is known, by its number."""
        if self.seen is not None and self.seen.visits is not None:
            return self.seen.causes
        return find_causes(self.patches, self.features, self.is_suspicious, self.visits, self.poses)

    @property
    def disagreement(self) -> float:
        """Metres by which scans disagree: mean over the area of patches where it is known, nan of none."""
        metres = self.features.disagreement[:, 1]
        weight = np.where(np.isfinite(metres) & np.isfinite(self.area), self.area, 0.0)
        return share_of(float(np.nan_to_num(metres) @ weight), float(weight.sum()))

    @property
    def scans_apart(self) -> float:
        """Metres by which scans disagree: the larger of the medians over the area of walls and of floors."""
        return largest_median(self.features.disagreement[:, 1], self.area, self.patches.kinds)

    @property
    def scans_apart_surface(self) -> str | None:
        """Kind of surface whose median that is; None where it is not known."""
        medians = medians_by_kind(self.features.disagreement[:, 1], self.area, self.patches.kinds)
        return SURFACES[max(medians, key=lambda kind: medians[kind])] if medians else None

    def area_by_cause(self, some: NDArray[np.int64] | None = None) -> dict[str, float]:
        """Return the area in m² of suspicious patches (some: of those alone) by cause, the largest first."""
        area = dict.fromkeys(CAUSES, 0.0)
        for patch in self.causes if some is None else some:
            area[self.causes[int(patch)].kind] += float(np.nan_to_num(self.area[patch]))
        return dict(sorted(area.items(), key=lambda item: -item[1]))

    def reasons(self, patch: int, n_most: int = N_REASONS) -> list[Reason]:
        """Return the main reasons for the label of a patch, in words and in log-odds.

        Raises
        ------
        ArgumentError
            If there is no such patch.
        """
        if not 0 <= patch < len(self.label):
            raise ArgumentError(f"patch {patch}: must be from 0 to {len(self.label) - 1}.")
        return self._reasons.of(patch, 1.0 if self.is_suspicious[patch] else -1.0, n_most)

    @cached_property
    def _reasons(self) -> Reasons:
        return Reasons(self.features, self.terms)

    @property
    def resolution(self) -> float:
        """Metres that scans resolve: median half width of the bounds of what they disagree by; nan unknown."""
        return resolution_of(self.features)

    def verdict(
        self, fail_over: float | None = None, min_coverage: float = MIN_COVERAGE, fail_apart: float | None = None
    ) -> dict[str, Any]:
        """Return whether the map passes: enough of it judged, and little of that suspicious.

        A map without a patch never passes. Without `fail_over` and `fail_apart` "passed" is None.

        Parameters
        ----------
        fail_over : float, optional
            Largest share of the area that may be suspicious, such as 0.05.
        min_coverage : float
            Share of the points on planes of any kind that must be in judged patches, where that is known.
        fail_apart : float, optional
            Metres by which scans may disagree in the median, of walls and of floors; where that is not known, a map
            does not pass.

        Raises
        ------
        ArgumentError
            If a limit is not a share, or not a length.
        """
        return verdict_of(self, fail_over, min_coverage, fail_apart)

    @cached_property
    def _process(self) -> Mapping[str, Any]:
        return describe_process(self.origin.files)

    def head(self, **limits: Any) -> dict[str, Any]:
        """Return the JSON of a result without its patches (docs/results.md); `limits` as :meth:`verdict`."""
        return head_of(self, self._process, self.verdict(**limits))

    def patch_rows(self) -> Iterator[dict[str, Any]]:
        """Yield each patch with its label, its probability, its geometry in metres, and its terms."""
        return patch_rows(self)

    def evaluate(self, truth: ArrayLike | str = "truth") -> Scores:
        """Return how well the labels agree with the truth.

        `truth` (m,): 1 suspicious, 0 plausible, 255 unknown; or the name of a point field whose majority counts, of
        metres apart at the tolerance.
        """
        known = replace(self.patches, label_tolerance=self.tolerance).labelled(truth)
        return score_labels(self.label, known.label, self.probability)

    def save(self, path: str | os.PathLike[str], *, force: bool = False, **limits: Any) -> None:
        """Write RESULT as mapq classify does: all points (PLY, LAS or LAZ), and a JSON of the same name.

        `limits` as :meth:`verdict`.

        Raises
        ------
        OutputError
            If one of them exists and may not be replaced (`force`), or cannot be written.
        """
        target = os.fspath(path)
        for name in (target, json_beside(target)):
            refuse_existing(name, force)
        write_result(target, self.cloud(), self.head(**limits), self.patch_rows())

    def report(
        self,
        path: str | os.PathLike[str],
        *,
        title: str | None = None,
        max_points: int = 120_000,
        force: bool = False,
    ) -> None:
        """Write a report: one page of HTML that opens without a network.

        Raises
        ------
        OutputError
            If the file exists and may not be replaced (`force`), or cannot be written.
        """
        refuse_existing(path, force)
        in_memory = StoredResult(self.origin.name, self.cloud())
        findings = findings_of(in_memory, jsonable(self.head()), (jsonable(row) for row in self.patch_rows()))
        write_report(os.fspath(path), findings, title, max_points)

    def plot(self, views: tuple[str, ...] = ("plan",)) -> Figure:
        """Return a picture, plausible blue and suspicious red; views "plan" and "3d"."""
        return self._picture.draw(views)

    @property
    def _picture(self) -> Picture:
        cloud = self.patches.cloud
        xyz = cloud.metric_of(cloud.xyz)
        return picture_of_points(self.origin.name, xyz, self.patch, self.suspicious, self.p_suspicious)

    def __repr__(self) -> str:
        """Return the result in a line."""
        return f"<mapq.Result: {self._words}>"

    @property
    def _words(self) -> str:
        counts = self.counts
        share = counts["share_of_area"]
        area = "" if share != share else f", {share:.1%} of the area"
        return f"{counts['n_suspicious']:,} of {counts['n_patches']:,} patches suspicious{area}"

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows, with the worst regions."""
        facts = {"suspicious": self._words, "model": self.origin.model}
        for number, region in enumerate(self.regions[:N_LISTED]):
            where = self.patches.cloud.place_words(region.centre)
            facts[f"region {number}"] = f"{len(region.patches)} patches, {region.area:.1f} m² at {where}"
        return card("Plausibility of the map", facts, self._picture.png())


def assess(
    patches: Patches,
    model: Model | None = None,
    progress: Report | None = None,
    origin: Origin | None = None,
    tolerance: float | None = None,
) -> Result:
    """Return the labels of patches by a model (None: the model that ships with the package).

    `tolerance`: metres; None: chosen for the map (:func:`mapq.results.verdict.tolerance_of`).

    Raises InputError if the points are too far apart to be in metres, the model asks for features that this release
    does not have, or there is no default model; ArgumentError if it did not learn the tolerance.
    """
    refuse_other_unit(patches.parameters.get("spacing", 0.0), patches.cloud.source or "the map")
    model = model or read_default_model()
    features = patch_features(patches, feature_settings(model), progress)
    used = tolerance_of(features, model, tolerance)
    labelling = classify(features, model, used)
    terms = explain(features, model, labelling.label, used)
    return Result(patches, features, model, labelling, terms, used, origin or Origin())
