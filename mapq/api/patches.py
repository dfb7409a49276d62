"""`Patches` with what is measured on them, and how a cloud is cut into them."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapq import patches as plain
from mapq.api.clouds import Path, cloud_of
from mapq.cloud import PointCloud
from mapq.features import FeatureSettings, patch_features
from mapq.features.compute import N_STEPS
from mapq.features.table import Table, edge_table, node_table
from mapq.graph import PatchFeatures
from mapq.io.patches import read_patches as read_file
from mapq.io.patches import write_patches
from mapq.labels import label_from_field
from mapq.patches import FROM_HAND, FROM_NOBODY, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.render import render_views
from mapq.render.colours import label_colours, patch_colours
from mapq.segmentation import STAGES, SegmentSettings
from mapq.segmentation import segment as cut
from mapq.settings import Asked, segment_settings
from prf.shell.errors import ArgumentError
from prf.shell.files import refuse_existing
from prf.shell.notebook import ProgressCallback, card, reported

logger = logging.getLogger(__name__)


class Features(NamedTuple):
    """What is measured on patches and on pairs of neighbours.

    Attributes
    ----------
    nodes : (m,) structured array
        A row a patch: ``nodes["thickness_m"]``; ``nodes.dtype.names`` lists the columns.
    edges : (k,) structured array
        A row a pair of neighbours ``i``, ``j``: ``edges["plausibility"]`` is x_ij of the paper, low where walls are
        doubled or cross.
    units : mapping of str to str
        Of each column.
    arrays : PatchFeatures
        The same as the random field sees it, and the parameters that were used.
    """

    nodes: NDArray[np.void]
    edges: NDArray[np.void]
    units: Mapping[str, str]
    arrays: PatchFeatures

    @classmethod
    def of(cls, arrays: PatchFeatures) -> Features:
        """Return features as named columns."""
        nodes, edges = node_table(arrays), edge_table(arrays)
        units = {name: unit for table in (nodes, edges) for name, unit in zip(table.names, table.units, strict=True)}
        return cls(_structured(nodes), _structured(edges), units, arrays)

    def __repr__(self) -> str:
        """Return the features in a line."""
        return f"<mapq.Features: {len(self.nodes):,} patches, {len(self.edges):,} pairs>"


@dataclass(frozen=True, repr=False)
class Patches(plain.Patches):
    """A cloud cut into plane patches, and what is measured on them.

    Attributes
    ----------
    cloud, patch, normal, centroid, label, parameters, report, ...
        As :class:`mapq.patches.Patches` has them: `patch` (n,) is the patch of each point, -1 for none.
    """

    @classmethod
    def of(cls, patches: plain.Patches) -> Patches:
        """Return the patches with what is measured on them."""
        return cls(**{field.name: getattr(patches, field.name) for field in fields(plain.Patches)})

    @cached_property
    def features(self) -> Features:
        """The features of patches and pairs, with the default settings."""
        return self.measured(progress=False)

    def measured(
        self, settings: FeatureSettings | None = None, *, progress: bool | ProgressCallback = True
    ) -> Features:
        """Return the features of patches and pairs.

        Parameters
        ----------
        settings : FeatureSettings, optional
        progress : bool or callable
            As :func:`segment`.
        """
        with reported(progress, N_STEPS, "features") as reporter:
            return Features.of(patch_features(self, settings, reporter))

    def labelled(self, labels: ArrayLike | str) -> Patches:
        """Return the patches with labels, for :func:`mapq.train`.

        Parameters
        ----------
        labels : (m,) array or str
            Of each patch: 1 suspicious, 0 plausible, 255 not known. A name: by the majority of the points, of the
            field of the cloud that has it.

        Raises
        ------
        ArgumentError
            If the labels have another shape, or another value.
        InputError
            If there is no such field, or it is none of 0, 1 and 255.
        """
        if isinstance(labels, str):
            found, _ = label_from_field(self, labels, self.cloud.source or "the cloud", overwrite_hand=True)
            return Patches.of(found)
        label = np.asarray(labels)
        if label.shape != (len(self),):
            raise ArgumentError(f"labels: has shape {label.shape}, must be ({len(self)},), one a patch.")
        if not np.isin(label, (PLAUSIBLE, SUSPICIOUS, UNLABELLED)).all():
            raise ArgumentError("labels: must be 0 (plausible), 1 (suspicious) or 255 (not known).")
        source = np.where(label == UNLABELLED, FROM_NOBODY, FROM_HAND).astype(np.uint8)
        return replace(self, label=label.astype(np.uint8), label_source=source)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the patches with all points and fields, as mapq segment does.

        Raises
        ------
        OutputError
            If the file stands already and may not be replaced (`force`), or cannot be written.
        """
        refuse_existing(path, force)
        write_patches(path, self)

    def __repr__(self) -> str:
        """Return the patches in a line."""
        return f"<mapq.Patches: {self._words}>"

    @property
    def _words(self) -> str:
        known = int((self.label != UNLABELLED).sum())
        labelled = f", {known:,} labelled" if known else ""
        return f"{len(self):,} patches of {int(self.counts.sum()):,} points{labelled}"

    @cached_property
    def _picture(self) -> bytes | None:
        has_labels = bool((self.label != UNLABELLED).any())
        label = np.append(self.label, np.uint8(UNLABELLED))[self.patch]
        scheme = label_colours(label, self.patch) if has_labels else patch_colours(self.patch)
        return plan_view(self.cloud, scheme, "Plane patches", self._words)

    def _repr_png_(self) -> bytes | None:
        """Return the plan view that a notebook shows; None without a point."""
        return self._picture

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows."""
        facts = {
            "patches": f"{len(self):,}",
            "points": f"{int(self.counts.sum()):,} in patches, {len(self.cloud):,} in all",
            "labels": f"{int((self.label == SUSPICIOUS).sum()):,} suspicious, "
            f"{int((self.label == PLAUSIBLE).sum()):,} plausible, {int((self.label == UNLABELLED).sum()):,} not known",
            "source": self.cloud.source or "arrays",
        }
        warnings = " ".join(self.report.get("warnings", ()))
        return card("Plane patches", facts | ({"warning": warnings} if warnings else {}), self._picture)


def segment(
    cloud: PointCloud | ArrayLike | Path,
    settings: SegmentSettings | None = None,
    *,
    progress: bool | ProgressCallback = True,
) -> Patches:
    """Cut a cloud into plane patches by region growing.

    Parameters
    ----------
    cloud : PointCloud, (n, 3) array, or path
    settings : SegmentSettings, optional
        What it leaves open is estimated from the cloud.
    progress : bool or callable
        Show a bar, in notebooks too. A callable is told the share that is done, and a mapping of words beside it.

    Returns
    -------
    Patches
        Largest first. There may be none: then the report has a warning, which is logged.

    Raises
    ------
    ArgumentError
        If the array is no cloud.
    InputError
        If the file cannot be read, or the points make no plane.
    UsageError
        If a setting is outside its domain.
    """
    patches = cut_reported(cloud_of(cloud), settings, progress)
    for warning in patches.report["warnings"]:
        logger.warning(warning)
    return Patches.of(patches)


def cut_reported(
    cloud: PointCloud, settings: SegmentSettings | Asked | None, progress: bool | ProgressCallback
) -> plain.Patches:
    """Return the patches of a cloud, with progress; their report says who asked for what."""
    asked = settings if isinstance(settings, Asked) else Asked({}, {})
    used = segment_settings(settings.values) if isinstance(settings, Asked) else settings
    with reported(progress, len(STAGES), "segmenting") as reporter:
        patches = cut(cloud, used, reporter)
    return replace(patches, report={**patches.report, "sources": asked.places}) if asked.places else patches


def read_patches(path: Path) -> Patches:
    """Read what mapq segment or :meth:`Patches.save` wrote, with the labels that were set since.

    Raises
    ------
    InputError
        If it is missing, damaged, or no PATCHES file.
    """
    return Patches.of(read_file(path))


def plan_view(cloud: PointCloud, scheme: Any, title: str, subtitle: str) -> bytes | None:
    """Return the picture of a cloud from above, PNG; None without a finite point."""
    if not cloud.finite().any():
        return None
    buffer = io.BytesIO()
    render_views(cloud.metric_of(cloud.xyz), scheme, buffer, title=title, subtitle=subtitle, views=("plan",))
    return buffer.getvalue()


def _structured(table: Table) -> NDArray[np.void]:
    """Return a table as an array with named columns."""
    kinds = [(name, column.dtype) for name, column in zip(table.names, table.columns, strict=True)]
    found: NDArray[np.void] = np.zeros(len(table.columns[0]), dtype=kinds)
    for name, column in zip(table.names, table.columns, strict=True):
        found[name] = column
    return found
