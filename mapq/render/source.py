"""What to draw of a file: a result with its labels, patches with theirs or in colours of their own, a bare cloud."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.patches import holds_patches, parse_patches
from mapq.io.result_folder import is_result_folder, open_result_folder, thinned
from mapq.io.result_json import patch_counts, read_result_json
from mapq.io.results import RESULT_FIELDS
from mapq.patches import NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.render.colours import Scheme, label_colours, patch_colours, probability_colours
from prf.shell.errors import InputError

Colour = Literal["label", "probability", "patch", "field"]
"""What the colour of a point shows."""


MOST_DRAWN = 4_000_000
"""Points of a result in tiles that are drawn: as many as a picture has room for."""


class Picture(NamedTuple):
    """Points and their colours, with the words over them.

    Attributes
    ----------
    xyz : (n, 3) float64
        World coordinates, metres.
    scheme : Scheme
    title, subtitle : str
    """

    xyz: NDArray[np.float64]
    scheme: Scheme
    title: str
    subtitle: str


class _Points(NamedTuple):
    """What of a file a picture may need.

    The cloud, the patch of each point, its label, its probability if known; and of a result in tiles, of which not all
    points are drawn, how many points, patches and suspicious patches it has.
    """

    cloud: PointCloud
    patch: NDArray[np.int32]
    label: NDArray[np.uint8]
    probability: NDArray[np.float32] | None
    counts: tuple[int, int, int] | None = None


def read_picture(
    path: str, colour: Colour | None = None, field: str | None = None, options: ReadOptions = AS_IT_IS
) -> Picture:
    """Read what `path` holds and colour its points.

    Parameters
    ----------
    path : str
        A result of ``mapq classify`` (one cloud, or a folder of tiles), a PATCHES file, or a cloud.
    colour : Colour, optional
        Default: labels where there are any, else patches.
    field : str, optional
        For colour ``field``: a 0/1 point field, 1 shown as suspicious.
    options : ReadOptions
        As for :func:`mapq.io.read_cloud`.

    Raises
    ------
    InputError
        If the file has not what the colour needs.
    """
    points = _read_points(path, options, field)
    chosen: Colour = colour or ("label" if np.any(points.label != UNLABELLED) else "patch")
    scheme = _scheme(path, points, chosen, field)
    words = f"{PurePath(path).name}  ·  {_words(points, chosen)}"
    titles = {
        "label": "Plausible and suspicious patches",
        "probability": "Probability that a patch is suspicious",
        "patch": "Plane patches",
        "field": f"Field {field}",
    }
    return Picture(points.cloud.metric_of(points.cloud.xyz), scheme, titles[chosen], words)


def _words(points: _Points, colour: Colour) -> str:
    """Return how much of what is drawn."""
    suspicious = (points.patch != NO_PATCH) & (points.label == SUSPICIOUS)
    n_points, n_patches, n_suspicious = points.counts or (
        len(points.cloud),
        _count_patches(points.patch[points.patch != NO_PATCH]),
        _count_patches(points.patch[suspicious]),
    )
    drawn = "" if len(points.cloud) == n_points else f"{len(points.cloud):,} of "
    words = f"{drawn}{n_points:,} points  ·  {n_patches:,} patches"
    return words + (f"  ·  {n_suspicious:,} suspicious" if colour == "label" else "")


def _read_folder(path: str, options: ReadOptions, field: str | None) -> _Points:
    """Return a part of the points of a result in tiles."""
    folder = open_result_folder(path, options)
    wanted = (*RESULT_FIELDS, *((field,) if field is not None and field in folder.fields else ()))
    points = _of_cloud(thinned(folder, wanted, MOST_DRAWN))
    counts = patch_counts(folder.json, read_result_json(folder.json)[0])
    return points._replace(counts=(folder.n_points, *counts))


def _read_points(path: str, options: ReadOptions, field: str | None) -> _Points:
    if is_result_folder(path):
        return _read_folder(path, options, field)
    content = Content(path)
    if holds_patches(content):
        options.refuse_unit(path)
        patches = parse_patches(content.data(), path)
        label = np.append(patches.label, np.uint8(UNLABELLED))[patches.patch]
        return _Points(patches.cloud, patches.patch, label, None)
    return _of_cloud(parse_cloud(content, options)[1])


def _of_cloud(cloud: PointCloud) -> _Points:
    none = np.full(len(cloud), NO_PATCH, np.int32)
    number = _whole(cloud.fields.get("patch", none), NO_PATCH, np.iinfo(np.int32).max)
    marked = _whole(cloud.fields.get("suspicious", none), UNLABELLED, SUSPICIOUS)
    return _Points(cloud, number.astype(np.int32), marked.astype(np.uint8), cloud.fields.get("p_suspicious"))


def _whole(values: NDArray[Any], otherwise: int, most: int) -> NDArray[np.int64]:
    """Return numbers (n,) as whole ones; what is not from 0 to `most`, or many a point, is `otherwise`."""
    if values.ndim != 1:
        return np.full(len(values), otherwise, np.int64)
    with np.errstate(invalid="ignore"):
        known = (values >= 0) & (values <= most)
    return np.where(known, values, otherwise).astype(np.int64)


def _scheme(path: str, points: _Points, colour: Colour, field: str | None) -> Scheme:
    if colour == "label":
        return label_colours(points.label, points.patch)
    if colour == "patch":
        return patch_colours(points.patch)
    if colour == "probability":
        if points.probability is None:
            raise InputError(
                f"{path}: no field p_suspicious. Draw a result of mapq classify, or choose another colour."
            )
        return probability_colours(points.probability, points.patch)
    if field is None or field not in points.cloud.fields:
        known = ", ".join(points.cloud.fields) or "none"
        raise InputError(f"{path}: no point field {field!r} (fields: {known}). Choose one with --field.")
    marked = np.asarray(points.cloud.fields[field])
    label = np.where(marked == 1, SUSPICIOUS, np.where(marked == 0, PLAUSIBLE, UNLABELLED)).astype(np.uint8)
    return label_colours(label, np.zeros(len(label), np.int32))


def _count_patches(patch: NDArray[np.int32]) -> int:
    """Return of how many patches points (k,) are: fewer than the largest number where a part of a result is drawn."""
    return len(np.unique(patch))
