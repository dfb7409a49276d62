"""Picture of a file: a result with its labels, patches with theirs or in colours of their own, a bare cloud."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io.maps import Row, read_map
from mapq.io.results import RESULT_FIELDS, patch_counts
from mapq.io.tiles import thinned
from mapq.labels import NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.patches import Patches
from mapq.picture import Colour, Picture, picture_of_cloud, picture_of_points
from prf.shell.errors import InputError

MARK = "suspicious"
"""Field that a cloud without patches is drawn by, where it has it."""
MOST_DRAWN = 4_000_000
"""Points of a result in tiles that are drawn."""


def read_picture(
    path: str, colour: Colour | None = None, field: str | None = None, options: ReadOptions = AS_IT_IS
) -> Picture:
    """Read a result (one cloud, or a folder of tiles), a PATCHES file or a cloud, and colour its points.

    `colour`: default: labels where there are any, those of points too, else patches, of a bare cloud none. `field`: for
    colour ``field``: a 0/1 point field, 1 shown as suspicious. `options`: as for :func:`mapq.io.read_cloud`. Raises
    InputError if the file has not what the colour needs.
    """
    found, counts, probability, verdict = read_map(path, options), None, None, ""
    if isinstance(found, Patches):
        cloud, patch = found.cloud, found.patch
        label = np.append(found.label, np.uint8(UNLABELLED))[patch]
    elif isinstance(found, PointCloud):
        cloud = found
        patch, label = np.full(len(cloud), NO_PATCH, np.int32), np.full(len(cloud), UNLABELLED, np.uint8)
    else:
        if isinstance(found.points, PointCloud):
            cloud = found.points
        else:
            folder = found.points
            wanted = (*RESULT_FIELDS, *((field,) if field is not None and field in folder.fields else ()))
            cloud = thinned(folder, wanted, MOST_DRAWN)
            counts = (folder.n_points, *patch_counts(folder.json, found.content()[0]))
        verdict = _verdict(found.content()[0]) if found.json.exists() else ""
        number, suspicious, probability = (cloud.fields[name] for name in RESULT_FIELDS)
        patch, label = number.astype(np.int32), suspicious.astype(np.uint8)
    is_bare = probability is None and bool((patch == NO_PATCH).all())
    if colour is None and is_bare and MARK in cloud.fields:  # as in a map of mapq perturb
        colour, field = "field", MARK
    xyz = cloud.metric_of(cloud.xyz)
    if colour is None and isinstance(found, PointCloud):
        return picture_of_cloud(path, xyz)
    if colour == "field":
        label = _marks(path, cloud, field)
    how: dict[str, Any] = {"colour": colour, "field": field or "", "counts": counts, "verdict": verdict}
    return picture_of_points(path, xyz, patch, label, probability, **how)


def _verdict(head: Row) -> str:
    """Return the share of the area that is suspicious, at what tolerance and from what probability, by a JSON."""
    share, p = (
        (head.get(part) or {}).get(name) for part, name in (("counts", "share_of_area"), ("threshold", "p_suspicious"))
    )
    if share is None or p is None or "tolerance" not in head:
        return ""
    return f"{share:.1%} of the area at {head['tolerance']:.2f} m, from p {p:.2f}"


def _marks(path: str, cloud: PointCloud, field: str | None) -> NDArray[np.uint8]:
    """Return the label (n,) of each point by a 0/1 field."""
    if field is None or field not in cloud.fields:
        known = ", ".join(cloud.fields) or "none"
        raise InputError(f"{path}: no point field {field!r} (fields: {known}). Choose one with --field.")
    marked = np.asarray(cloud.fields[field])
    return np.where(marked == 1, SUSPICIOUS, np.where(marked == 0, PLAUSIBLE, UNLABELLED)).astype(np.uint8)
