"""`classify`, and the `Result` that says which patches of a map are suspicious, and why."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapq import assess
from mapq import patches as plain
from mapq.api.clouds import Path, point_cloud
from mapq.api.patches import Patches, cut_reported, plan_view
from mapq.assess.reasons import Reason
from mapq.assess.regions import Region
from mapq.cloud import PointCloud
from mapq.crf.operating import with_false_alarms
from mapq.io.models import read_default_model, read_model
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.results import json_beside, write_result
from mapq.model import Model
from mapq.patches import UNLABELLED
from mapq.render.colours import label_colours
from mapq.report import MOST_POINTS, Palette, read_findings, write_report
from mapq.segmentation import SegmentSettings
from mapq.settings import Asked
from prf.shell.errors import ArgumentError, UsageError
from prf.shell.files import refuse_existing
from prf.shell.manifest import describe_process
from prf.shell.notebook import ProgressCallback, card

logger = logging.getLogger(__name__)

N_REGIONS = 5
"""Regions that a card lists."""

Map = plain.Patches | PointCloud | ArrayLike | Path


class Origin(NamedTuple):
    """What a result was made from.

    Attributes
    ----------
    name : str
        Of the map, for messages.
    model : str
        "default", the model's file, or "given".
    files : tuple of str
        Whose digests a written result has.
    """

    name: str
    model: str
    files: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What a model says of a map.

    Attributes
    ----------
    assessment : mapq.assess.Result
        Features, labelling, terms: all that the rest follows from.
    origin : Origin
    """

    assessment: assess.Result
    origin: Origin

    @cached_property
    def patches(self) -> Patches:
        """The patches of the map."""
        return Patches.of(self.assessment.patches)

    @property
    def patch(self) -> NDArray[np.int32]:
        """Patch of each point (n,), -1 for none."""
        return self.assessment.patches.patch

    @cached_property
    def suspicious(self) -> NDArray[np.uint8]:
        """Of each point (n,): 1 in a suspicious patch, 0 in a plausible one, 255 in none."""
        return np.append(self.label, np.uint8(UNLABELLED))[self.patch]

    @cached_property
    def p_suspicious(self) -> NDArray[np.float32]:
        """Probability (n,) that the patch of each point is suspicious; nan where there is none."""
        return np.append(self.probability, np.float32(np.nan))[self.patch].astype(np.float32)

    @property
    def label(self) -> NDArray[np.uint8]:
        """Of each patch (m,): 1 suspicious, 0 plausible."""
        return self.assessment.labelling.label

    @property
    def probability(self) -> NDArray[np.float32]:
        """Probability (m,) that each patch is suspicious."""
        return self.assessment.labelling.probability

    @property
    def regions(self) -> list[Region]:
        """Regions of connected suspicious patches, the most severe first."""
        return self.assessment.regions

    @property
    def counts(self) -> dict[str, Any]:
        """How much of the map is suspicious: patches, points, m², and their shares."""
        return self.assessment.counts()

    def reasons(self, patch: int, n_most: int = 3) -> list[Reason]:
        """Return what speaks most for the label of a patch, in words and in log-odds.

        Raises
        ------
        ArgumentError
            If there is no such patch.
        """
        if not 0 <= patch < len(self.label):
            raise ArgumentError(f"patch {patch}: must be from 0 to {len(self.label) - 1}.")
        return self.assessment.reasons(patch, n_most)

    def verdict(self, fail_over: float | None = None, *, min_coverage: float = assess.MIN_COVERAGE) -> dict[str, Any]:
        """Return whether the map passes: no more than a share of its area suspicious, and enough of it judged.

        Parameters
        ----------
        fail_over : float, optional
            The share, such as 0.05; without one "passed" is None.
        min_coverage : float
            Share of the points on planes of any tilt that must be in judged patches, where that is known.

        Raises
        ------
        ArgumentError
            If one is no share.
        """
        for name, share in (("fail_over", fail_over), ("min_coverage", min_coverage)):
            if share is not None and not 0.0 <= share <= 1.0:
                raise ArgumentError(f"{name} {share}: must be a share between 0 and 1.")
        return self.assessment.verdict(fail_over, min_coverage)

    def cloud(self) -> PointCloud:
        """Return all points with their fields and those of a result: patch, suspicious, p_suspicious, colours."""
        return self.assessment.cloud()

    def head(self, fail_over: float | None = None, min_coverage: float = assess.MIN_COVERAGE) -> dict[str, Any]:
        """Return the JSON of a result but for its patches (docs/results.md)."""
        made = {**self._process, "model": self.origin.model, **self.assessment.head()}
        return {**made, "verdict": self.verdict(fail_over, min_coverage=min_coverage)}

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the patches as the JSON of a result has them, with reasons and terms."""
        return self.assessment.patch_rows()

    def save(
        self,
        path: Path,
        *,
        fail_over: float | None = None,
        min_coverage: float = assess.MIN_COVERAGE,
        force: bool = False,
    ) -> None:
        """Write RESULT as mapq classify does: all points (PLY, LAS or LAZ), and a JSON of the same name.

        Raises
        ------
        OutputError
            If one of them stands already and may not be replaced (`force`), or cannot be written.
        """
        target = os.fspath(path)
        for name in (target, json_beside(target)):
            refuse_existing(name, force)
        write_result(target, self.cloud(), self.head(fail_over, min_coverage), self.rows())

    def report(
        self,
        path: Path,
        *,
        title: str | None = None,
        palette: Palette = "blue-red",
        max_points: int = MOST_POINTS,
        force: bool = False,
    ) -> None:
        """Write a report: one page of HTML that opens without a network. It needs the extra prf-mapq[report].

        Raises
        ------
        OutputError
            If the file stands already and may not be replaced (`force`), or cannot be written.
        UsageError
            If plotly is not installed.
        """
        refuse_existing(path, force)
        with TemporaryDirectory() as folder:
            copy = os.path.join(folder, "map.ply")
            self.save(copy)
            findings = read_findings(copy)._replace(path=self.origin.name)
        write_report(os.fspath(path), findings, title, palette, max_points)

    @cached_property
    def _process(self) -> Mapping[str, Any]:
        return describe_process(self.origin.files)

    def __repr__(self) -> str:
        """Return the result in a line."""
        return f"<mapq.Result: {self._words}>"

    @property
    def _words(self) -> str:
        counts = self.counts
        share = counts["share_of_area"]
        area = "" if share != share else f", {share:.1%} of the area"
        return f"{counts['n_suspicious']:,} of {counts['n_patches']:,} patches suspicious{area}"

    @cached_property
    def _picture(self) -> bytes | None:
        scheme = label_colours(self.suspicious, self.patch)
        return plan_view(self.assessment.patches.cloud, scheme, "Plausible and suspicious patches", self._words)

    def _repr_png_(self) -> bytes | None:
        """Return the plan view that a notebook shows; None without a point."""
        return self._picture

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows, with the worst regions."""
        facts = {"suspicious": self._words, "model": self.origin.model}
        for number, region in enumerate(self.regions[:N_REGIONS]):
            where = " ".join(f"{x:.1f}" for x in region.centre.tolist())
            facts[f"region {number}"] = f"{len(region.patches)} patches, {region.area:.1f} m² at {where}"
        return card("Plausibility of the map", facts, self._picture)


def classify(
    map: Map,
    model: Model | Path | None = None,
    *,
    max_false_alarms: float | None = None,
    segmentation: SegmentSettings | Asked | None = None,
    options: ReadOptions = AS_IT_IS,
    progress: bool | ProgressCallback = True,
) -> Result:
    """Label the patches of a map plausible or suspicious, and say why.

    Parameters
    ----------
    map : Patches, PointCloud, (n, 3) array, or path
        A cloud is segmented first.
    model : Model or path, optional
        None: the model that ships with the package.
    max_false_alarms : float, optional
        Call as many suspicious as this share of the plausible patches allows, such as 0.02.
    segmentation : SegmentSettings or Asked, optional
        For a cloud. What is asked by a settings file (:func:`mapq.settings.ask`) is passed over where there is none.
    options : ReadOptions
        For the file of a cloud.
    progress : bool or callable
        Of the segmentation, as :func:`mapq.segment`.

    Returns
    -------
    Result

    Raises
    ------
    ArgumentError
        If the array is no cloud, or `max_false_alarms` no share.
    UsageError
        If the model has no operating points, or segmentation settings are given for patches.
    InputError
        If a file cannot be read, the points make no plane, or the model does not fit this release.
    """
    if max_false_alarms is not None and not 0.0 <= max_false_alarms <= 1.0:
        raise ArgumentError(f"max_false_alarms {max_false_alarms}: must be a share between 0 and 1.")
    used, model_name = _model(model)
    if max_false_alarms is not None:
        used = with_false_alarms(used, max_false_alarms, _words_for(model))
    found, name = _read(map, options)
    if isinstance(found, PointCloud):
        patches = cut_reported(found, segmentation, progress)
    elif segmentation.by_option if isinstance(segmentation, Asked) else segmentation is not None:
        raise UsageError(f"{name} is segmented already: settings of a segmentation are for clouds.")
    else:
        patches = found
    warnings = patches.report.get("warnings", ())
    for warning in warnings or (() if len(patches) else ("no plane patch was found, so nothing is labelled",)):
        logger.warning("%s: %s", name, warning)
    files = [os.fspath(each) for each in (map, model) if isinstance(each, str | os.PathLike)]
    return Result(assess.assess(patches, used), Origin(name, model_name, tuple(files)))


def _model(model: Model | Path | None) -> tuple[Model, str]:
    """Return a model and what a result calls it."""
    if isinstance(model, Model):
        return model, "given"
    return (read_default_model(), "default") if model is None else (read_model(model), os.fspath(model))


def _words_for(model: Model | Path | None) -> str:
    if isinstance(model, Model):
        return "the model"
    return "the model of the package" if model is None else os.fspath(model)


def _read(map: Map, options: ReadOptions) -> tuple[plain.Patches | PointCloud, str]:
    """Return patches or a cloud, and a name for messages."""
    if isinstance(map, str | os.PathLike):
        return assess.read_input(os.fspath(map), options), os.fspath(map)
    if isinstance(map, plain.Patches):
        return map, map.cloud.source or "the map"
    cloud = map if isinstance(map, PointCloud) else point_cloud(map)
    return cloud, cloud.source or "the map"
