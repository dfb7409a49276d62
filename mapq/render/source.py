"""Contents of a picture: a result with its labels, patches with theirs or in colours of their own, a bare cloud."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.result_folder import thinned
from mapq.io.results import RESULT_FIELDS, patch_counts
from mapq.patches import NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED, Patches
from mapq.render.colours import Scheme, label_colours, patch_colours, probability_colours
from mapq.render.picture import Picture
from mapq.results.inputs import read_map
from prf.shell.errors import InputError

if TYPE_CHECKING:
    from mapq.results import Result

Colour = Literal["label", "probability", "patch", "field"]
"""What the colour of a point shows."""
TITLES = {
    "label": "Plausible and suspicious patches",
    "probability": "Probability that a patch is suspicious",
    "patch": "Plane patches",
}
MARK = "suspicious"
"""Field that a cloud without patches is drawn by, where it has it."""
MOST_DRAWN = 4_000_000
"""Points of a result in tiles that are drawn."""


class _Points(NamedTuple):
    """Points of a picture: patch, label and probability of each; points, patches and suspicious patches in all."""

    name: str
    cloud: PointCloud
    patch: NDArray[np.int32]
    label: NDArray[np.uint8]
    probability: NDArray[np.float32] | None = None
    counts: tuple[int, int, int] | None = None


def read_picture(
    path: str, colour: Colour | None = None, field: str | None = None, options: ReadOptions = AS_IT_IS
) -> Picture:
    """Read a result (one cloud, or a folder of tiles), a PATCHES file or a cloud, and colour its points.

    `colour`: default: labels where there are any, those of points too, else patches. `field`: for colour ``field``: a
    0/1 point field, 1 shown as suspicious. `options`: as for :func:`mapq.io.read_cloud`. Raises InputError if the file
    has not what the colour needs.
    """
    points = _read_points(path, options, field)
    is_bare = points.probability is None and bool((points.patch == NO_PATCH).all())
    if colour is None and is_bare and MARK in points.cloud.fields:  # as in a map of mapq perturb
        return _picture(points, "field", MARK)
    return _picture(points, colour, field)


def picture_of(map: PointCloud | Patches | Result) -> Picture:
    """Return the picture of a cloud, patches or a result in memory."""
    if isinstance(map, PointCloud):
        return _picture(_of_cloud(map, map.source or "arrays"))
    if isinstance(map, Patches):
        return _picture(_of_patches(map, map.cloud.source or "arrays"))
    return _picture(_Points(map.origin.name, map.patches.cloud, map.patch, map.suspicious, map.p_suspicious))


def _picture(points: _Points, colour: Colour | None = None, field: str | None = None) -> Picture:
    chosen: Colour = colour or ("label" if np.any(points.label != UNLABELLED) else "patch")
    scheme = _scheme(points, chosen, field)
    words = f"{PurePath(points.name).name}  ·  {_words(points, chosen)}"
    title = TITLES.get(chosen, f"Field {field}")
    return Picture(points.cloud.metric_of(points.cloud.xyz), scheme, title, words)


def _words(points: _Points, colour: Colour) -> str:
    """Return how much is drawn."""
    inside = points.patch != NO_PATCH
    n_points, n_patches, n_suspicious = points.counts or (
        len(points.cloud),
        len(np.unique(points.patch[inside])),
        len(np.unique(points.patch[inside & (points.label == SUSPICIOUS)])),
    )
    drawn = "" if len(points.cloud) == n_points else f"{len(points.cloud):,} of "
    words = f"{drawn}{n_points:,} points  ·  {n_patches:,} patches"
    return words + (f"  ·  {n_suspicious:,} suspicious" if colour == "label" else "")


def _read_points(path: str, options: ReadOptions, field: str | None) -> _Points:
    found = read_map(path, options)
    if isinstance(found, Patches):
        return _of_patches(found, path)
    if isinstance(found, PointCloud):
        return _of_cloud(found, path)
    if isinstance(found.points, PointCloud):
        return _of_result(found.points, path)
    folder = found.points
    wanted = (*RESULT_FIELDS, *((field,) if field is not None and field in folder.fields else ()))
    points = _of_result(thinned(folder, wanted, MOST_DRAWN), path)
    return points._replace(counts=(folder.n_points, *patch_counts(folder.json, found.content()[0])))


def _of_cloud(cloud: PointCloud, name: str) -> _Points:
    return _Points(name, cloud, np.full(len(cloud), NO_PATCH, np.int32), np.full(len(cloud), UNLABELLED, np.uint8))


def _of_patches(patches: Patches, name: str) -> _Points:
    label = np.append(patches.label, np.uint8(UNLABELLED))[patches.patch]
    return _Points(name, patches.cloud, patches.patch, label)


def _of_result(cloud: PointCloud, name: str) -> _Points:
    number, label, probability = (cloud.fields[field] for field in RESULT_FIELDS)
    return _Points(name, cloud, number.astype(np.int32), label.astype(np.uint8), probability)


def _scheme(points: _Points, colour: Colour, field: str | None) -> Scheme:
    if colour == "label":
        return label_colours(points.label, points.patch)
    if colour == "patch":
        return patch_colours(points.patch)
    if colour == "probability":
        if points.probability is None:
            raise InputError(
                f"{points.name}: no field p_suspicious. Draw a result of mapq classify, or choose another colour."
            )
        return probability_colours(points.probability, points.patch)
    if field is None or field not in points.cloud.fields:
        known = ", ".join(points.cloud.fields) or "none"
        raise InputError(f"{points.name}: no point field {field!r} (fields: {known}). Choose one with --field.")
    marked = np.asarray(points.cloud.fields[field])
    label = np.where(marked == 1, SUSPICIOUS, np.where(marked == 0, PLAUSIBLE, UNLABELLED)).astype(np.uint8)
    return label_colours(label, np.zeros(len(label), np.int32))
