"""From a cloud or its patches to a result: labels, probabilities, and the terms that led to them."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.crf import Labelling, Terms, classify, explain
from mapq.crf.explain import NEIGHBOUR_LABEL
from mapq.features import FeatureSettings, patch_features
from mapq.graph import PatchFeatures
from mapq.io.clouds import parse_cloud, read_bytes
from mapq.io.models import read_default_model
from mapq.io.patches import holds_patches, parse_patches
from mapq.io.results import result_cloud
from mapq.model import Model
from mapq.patches import SUSPICIOUS, Patches
from prf.shell.errors import ConfigError, InputError
from prf.shell.progress import Reporter

AREA = "area_m2"
"""Name of the area of a patch, in m², among the shape measures."""

MEASURES = {
    "fit": ("rms_m", "rms %.3g m"),
    "tilt": ("tilt_deg", "%.3g degrees from vertical"),
    "thickness": ("thickness_m", "%.3g m"),
}
"""Node feature to the shape measure that says the same to people, and how to say it."""

LABELS = ("plausible", "suspicious")
DECIMALS = 9
"""Of numbers in the JSON of a result: sums of terms stay exact to a billionth."""
LARGEST_SETTING = 1e6
"""Of a model's feature settings, in metres or patches: a map is smaller."""


@dataclass(frozen=True)
class Result:
    """What a model says of a map.

    Attributes
    ----------
    patches : Patches
    features : PatchFeatures
    model : Model
    labelling : Labelling
    terms : Terms
        Why each patch has its label.
    """

    patches: Patches
    features: PatchFeatures
    model: Model
    labelling: Labelling
    terms: Terms

    def cloud(self) -> PointCloud:
        """Return all points with the fields of a result."""
        return result_cloud(self.patches.cloud, self.patches.patch, self.labelling.label, self.labelling.probability)

    @cached_property
    def suspicious(self) -> NDArray[np.bool_]:
        """Return which patches (m,) are suspicious."""
        return np.asarray(self.labelling.label == SUSPICIOUS)

    @cached_property
    def area(self) -> NDArray[np.float64]:
        """Return the area (m,) of each patch in m²; nan where the features do not have it."""
        if AREA not in self.features.shape_names:
            return np.full(len(self.patches), np.nan)
        return self.features.shape[:, self.features.shape_names.index(AREA)]

    def counts(self) -> dict[str, Any]:
        """Return how much of the map is suspicious: patches, points and area, and their shares (nan of nothing)."""
        counts, bad = self.patches.counts, self.suspicious
        n_points, area = int(counts.sum()), float(self.area.sum())
        return {
            "n_patches": len(self.patches),
            "n_suspicious": int(bad.sum()),
            "share_of_patches": _share(float(bad.sum()), len(self.patches)),
            "n_points": len(self.patches.cloud),
            "n_points_in_patches": n_points,
            "n_points_suspicious": int(counts[bad].sum()),
            "share_of_points": _share(float(counts[bad].sum()), n_points),
            "area_m2": area,
            "area_suspicious_m2": float(self.area[bad].sum()),
            "share_of_area": _share(float(self.area[bad].sum()), area),
        }

    def worst(self, n_most: int) -> list[int]:
        """Return the suspicious patches that are most surely so, at most `n_most`, larger ones first among equals."""
        candidates = np.flatnonzero(self.suspicious)
        order = np.lexsort((candidates, -self.patches.counts[candidates], -self.labelling.difference[candidates]))
        return [int(patch) for patch in candidates[order[:n_most]]]

    def world_centroid(self, patch: int) -> list[float]:
        """Return the mean of a patch's points in world coordinates (3)."""
        return _rounded(self.patches.centroid[patch] + self.patches.cloud.shift)

    def reasons(self, patch: int, n_most: int) -> list[str]:
        """Return the largest terms that speak for suspicious, at most `n_most`, in words and metres."""
        speaking = [row for row in self.term_rows(patch) if row["contribution"] > 0.0]
        return [self._reason(patch, row) for row in speaking[:n_most]]

    def _reason(self, patch: int, row: dict[str, Any]) -> str:
        name, value, gain = row["name"], row["value"], f"{row['contribution']:+.2f}"
        measure, words = MEASURES.get(name, ("", ""))
        if name == NEIGHBOUR_LABEL:
            return f"{gain}  neighbour {row['other']} is {LABELS[int(value)]}"
        if "other" in row:
            return f"{gain}  {name} {value:.2f} with patch {row['other']}"
        if measure in self.features.shape_names:
            known = self.features.shape[patch, self.features.shape_names.index(measure)]
            return f"{gain}  {name}: {words % known}"
        return f"{gain}  {name} {value:.3g}"

    def head(self) -> dict[str, Any]:
        """Return the JSON of a result but for its patches."""
        return {
            "counts": self.counts(),
            "edge_model": self.model.edge_model,
            "temperature": self.model.temperature,
            "features": {**self.features.parameters, "n_clipped": self.features.n_clipped},
            "segmentation": {"parameters": self.patches.parameters, "report": self.patches.report},
        }

    def patch_rows(self) -> Iterator[dict[str, Any]]:
        """Yield each patch with its label, its probability, its geometry in metres, and its terms."""
        starts = self.terms.starts(len(self.patches))
        centroids = self.patches.centroid + self.patches.cloud.shift
        for patch in range(len(self.patches)):
            span = slice(int(starts[patch]), int(starts[patch + 1]))
            shape = zip(self.features.shape_names, self.features.shape[patch].tolist(), strict=True)
            yield {
                "patch": patch,
                "label": LABELS[int(self.labelling.label[patch])],
                "p_suspicious": float(self.labelling.probability[patch]),
                "difference": round(float(self.labelling.difference[patch]), DECIMALS),
                "n_points": int(self.patches.counts[patch]),
                "centroid": _rounded(centroids[patch]),
                "normal": _rounded(self.patches.normal[patch]),
                **{name: round(value, DECIMALS) for name, value in shape if name != "n_points"},
                "log_odds": round(float(self.terms.contribution[span].sum()), DECIMALS),
                "terms": self.term_rows(patch, int(starts[patch]), int(starts[patch + 1])),
            }

    def term_rows(self, patch: int, begin: int | None = None, end: int | None = None) -> list[dict[str, Any]]:
        """Return the terms of a patch, largest first; `begin` and `end` where they stand, if known."""
        if begin is None or end is None:
            begin, end = (int(place) for place in np.searchsorted(self.terms.patch, (patch, patch + 1)))
        rows = []
        for place in range(begin, end):
            row: dict[str, Any] = {
                "name": self.terms.names[int(self.terms.name[place])],
                "value": round(float(self.terms.value[place]), DECIMALS),
                "contribution": round(float(self.terms.contribution[place]), DECIMALS),
            }
            if self.terms.other[place] >= 0:
                row["other"] = int(self.terms.other[place])
            rows.append(row)
        return rows


def assess(patches: Patches, model: Model | None = None, progress: Reporter | None = None) -> Result:
    """Return what a model says of patches (None: the model that ships with the package).

    Raises
    ------
    InputError
        If the model asks for features that this release does not have, or there is no default model.
    """
    model = model or read_default_model()
    features = patch_features(patches, feature_settings(model), progress)
    labelling = classify(features, model)
    return Result(patches, features, model, labelling, explain(features, model, labelling.label))


def feature_settings(model: Model) -> FeatureSettings:
    """Return the settings with which the model's features were measured.

    Raises
    ------
    InputError
        If one is missing, unknown, or outside its domain.
    """
    known = {field.name for field in fields(FeatureSettings)}
    for name in sorted(known ^ set(model.features)):
        state = "is missing" if name in known else "is not known to this release"
        raise InputError(f"the model's feature setting {name} {state}. Train the model anew.")
    values: dict[str, Any] = dict(model.features)
    for name, default in asdict(FeatureSettings()).items():
        if not _is_of_kind(values[name], default):
            raise InputError(
                f"the model's feature setting {name} cannot be used ({values[name]!r}). Train the model anew."
            )
    try:
        values["up"] = None if values["up"] is None else tuple(values["up"])
        return FeatureSettings(**values)
    except (TypeError, ConfigError) as error:
        raise InputError(f"the model's feature settings cannot be used ({error}). Train the model anew.") from error


def read_input(path: str, bin_columns: int = 4) -> Patches | PointCloud:
    """Read PATCHES or a cloud, whichever `path` is; ``-`` is standard input.

    Raises
    ------
    InputError
        As :func:`mapq.io.read_patches` and :func:`mapq.io.read_cloud`.
    """
    data = read_bytes(path)
    if holds_patches(io.BytesIO(data)):
        return parse_patches(data, path)
    return parse_cloud(data, path, bin_columns)[1]


def _is_of_kind(value: Any, default: Any) -> bool:
    """Return whether a setting of a model file has the type of its default; null, a length or direction or null."""
    if default is None:
        return value is None or isinstance(value, list | tuple) or _is_of_kind(value, 0.0)
    if isinstance(default, bool | str):
        return isinstance(value, type(default))
    whole = isinstance(value, int) and not isinstance(value, bool)
    return (whole or (isinstance(default, float) and isinstance(value, float))) and abs(value) <= LARGEST_SETTING


def _share(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [round(value, 6) for value in values.tolist()]
