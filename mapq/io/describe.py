"""Summary of a file of `mapq`, whatever its kind, for `mapq inspect`."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.cloud import PointCloud
from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content, damage_in_one_line, suffix_of
from mapq.io.fields import Array
from mapq.io.patches import SCHEMA as PATCHES_SCHEMA
from mapq.io.patches import holds_patches, parse_patches
from mapq.io.results import PATCH, RESULT_FIELDS, patch_counts, read_result_json
from mapq.io.tiles import MapFiles, is_result_folder, open_result_folder
from mapq.labels import FROM_FIELD, FROM_HAND, NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.patches import Patches
from prf.shell.cli.files import STREAM
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

SAMPLE = 2000
"""Points whose nearest neighbour is looked for: enough for the median to within a few per cent."""

MOST_LISTED = 64
"""A list of JSON longer than this, or of objects, is summarised by its length."""

NAN = float("nan")
LABELS = {"plausible": PLAUSIBLE, "suspicious": SUSPICIOUS, "unlabelled": UNLABELLED}
SOURCES = {"by hand": FROM_HAND, "from a field": FROM_FIELD}


Summary = dict[str, Any]
"""What `mapq inspect --json` prints, or a part of it (docs/file-formats.md); numbers that are not known are nan."""


def describe(path: str, options: ReadOptions = AS_IT_IS) -> Summary:
    """Return the summary of a cloud, a PATCHES file, a RESULT, or a JSON file of a model or result.

    Its `cloud` is None for a JSON file, its `patches` None but for PATCHES and RESULT. Its `content` are parameters and
    report of PATCHES, the JSON of a model or the one beside a RESULT; of long lists it has the length.

    Parameters
    ----------
    path : str
        The file, recognised by its content, or the folder of a result in tiles; ``-`` is standard input.
    options : ReadOptions
        As for :func:`mapq.io.read_cloud`.

    Raises
    ------
    InputError
        If it is missing, damaged, or none of these.
    """
    if is_result_folder(path):
        return _describe_folder(open_result_folder(path, options))
    found = Content(path)
    if found.head[:64].lstrip().startswith(b"{") and suffix_of(path) != ".bin":
        return _describe_json(found)
    if holds_patches(found):
        options.refuse_given(path)
        patches = parse_patches(found.data(), path)
        content = {"parameters": patches.parameters, "report": patches.report}
        return _described(path, "patches", PATCHES_SCHEMA, _cloud(patches.cloud), _patches(patches), content)
    format_name, cloud = parse_cloud(found, options)
    if not set(RESULT_FIELDS) <= set(cloud.fields):
        return _described(path, "cloud", format_name, _cloud(cloud), None, {})
    return _described(path, "result", format_name, _cloud(cloud), _result(cloud), _beside(path))


def _described(
    path: str, kind: str, format_name: str, cloud: Summary | None, patches: Summary | None, content: Mapping[str, Any]
) -> Summary:
    return {
        "path": path,
        "kind": kind,
        "format": format_name,
        "cloud": cloud,
        "patches": patches,
        "content": _brief(content),
    }


def _describe_json(found: Content) -> Summary:
    with damage_in_one_line(found.source):
        content = dict(json.loads(found.data()))
    schema = str(content.get("schema", "none"))[:40]
    if not schema.startswith(("mapq.model/", "mapq.result/")):
        raise InputError(f"{found.source}: JSON that is neither a model nor a result of mapq (schema {schema}).")
    kind = schema.partition("/")[0].removeprefix("mapq.")
    return _described(found.path, kind, schema, None, None, content)


def _describe_folder(folder: MapFiles) -> Summary:
    """Return the summary of a result in tiles, which is read a piece at a time."""
    head, _ = read_result_json(folder.json)
    n_patches, n_suspicious = patch_counts(folder.json, head)
    parts, n_points = [], np.zeros(n_patches + 1, np.int64)
    for _, piece in folder.pieces(folder.fields):
        patch = piece.fields[PATCH].astype(np.int64)
        if len(patch) and not -1 <= int(patch.min()) <= int(patch.max()) < n_patches:
            raise InputError(f"{folder.json}: not the JSON of {folder.path}, which has other patches.")
        n_points += np.bincount(patch + 1, minlength=n_patches + 1)
        parts.append(_cloud(piece, NAN))
    labels = {"plausible": n_patches - n_suspicious, "suspicious": n_suspicious}
    tiles = f"{len(folder.heads)} tile{'' if len(folder.heads) == 1 else 's'}"
    content = {**head, "patches": f"{n_patches} entries"}
    return _described(folder.path, "result", tiles, _joined(parts), _summary(n_points[1:], labels), content)


def _joined(parts: list[Summary]) -> Summary:
    """Return the summary of all pieces of a cloud."""
    fields = [
        {**several[0], "low": min(each["low"] for each in several), "high": max(each["high"] for each in several)}
        for several in zip(*(part["fields"] for part in parts), strict=True)
    ]
    counts = {name: sum(part[name] for part in parts) for name in ("n_points", "n_finite")}
    low, high = np.min([part["low"] for part in parts], axis=0), np.max([part["high"] for part in parts], axis=0)
    return {**parts[0], **counts, "low": low, "high": high, "fields": fields}


def median_spacing(xyz: NDArray[np.float64]) -> float:
    """Return the median distance to the nearest neighbour, on at most `SAMPLE` of the points (n, 3), all finite.

    The sample depends on the coordinates alone, not on their order.
    """
    if len(xyz) < 2:
        return NAN
    mixed = np.zeros(len(xyz), np.uint64)
    for column in xyz.T:
        mixed = (mixed ^ np.ascontiguousarray(column).view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    chosen = np.argpartition(mixed, SAMPLE)[:SAMPLE] if len(xyz) > SAMPLE else np.arange(len(xyz))
    tree = cKDTree(xyz, balanced_tree=False, compact_nodes=False)
    return float(np.median(tree.query(xyz[chosen], k=2)[0][:, 1]))


def _cloud(cloud: PointCloud, spacing: float | None = None) -> Summary:
    """Return the summary of a cloud; its spacing is measured unless it is given.

    The box (3,) is that of points with three finite coordinates; it and the shift (3,), which is subtracted before all
    work, are in world coordinates. `unit` (3,): metres in a unit of these. `spacing`: median distance in metres of a
    point to its nearest neighbour, on a sample; nan for one point and for tiles.
    """
    xyz = cloud.xyz[cloud.finite()]
    return {
        "n_points": len(cloud),
        "n_finite": len(xyz),
        "low": cloud.world_of(xyz.min(axis=0)),
        "high": cloud.world_of(xyz.max(axis=0)),
        "shift": cloud.shift,
        "unit": cloud.unit,
        "coordinate_type": np.dtype(cloud.coordinate_type).name,
        "fields": [_field(name, values) for name, values in cloud.fields.items()],
        "spacing": median_spacing(xyz) if spacing is None else spacing,
    }


def _field(name: str, values: Array) -> Summary:
    """Return the numbers a point of a field, and the range of the finite ones: nan where there are none."""
    known = values[np.isfinite(values)]
    low, high = (known.min().item(), known.max().item()) if known.size else (NAN, NAN)
    n_values = int(np.prod(values.shape[1:]))
    return {"name": name, "type": values.dtype.name, "n_values": n_values, "low": low, "high": high}


def _patches(patches: Patches) -> Summary:
    return _summary(patches.counts, _counted(patches.label, LABELS), _counted(patches.label_source, SOURCES))


def _result(cloud: PointCloud) -> Summary:
    inside = cloud.fields[PATCH] != NO_PATCH
    _, first, counts = np.unique(cloud.fields[PATCH][inside], return_index=True, return_counts=True)
    labels = _counted(cloud.fields["suspicious"][inside][first], LABELS)
    return _summary(counts, {name: labels[name] for name in ("plausible", "suspicious")})


def _summary(counts: NDArray[np.int64], labels: Mapping[str, int], sources: Mapping[str, int] | None = None) -> Summary:
    """Return the summary of patches with these numbers of points (m,)."""
    return {
        "n_patches": len(counts),
        "n_points_in_patches": int(counts.sum()),
        "points_per_patch": float(np.median(counts)) if len(counts) else NAN,
        "labels": labels,
        "label_sources": sources or {},
    }


def _counted(values: NDArray[Any], kinds: Mapping[str, int]) -> dict[str, int]:
    return {name: int(np.count_nonzero(values == value)) for name, value in kinds.items()}


def _beside(path: str) -> dict[str, Any]:
    """Return the JSON beside a RESULT, empty if there is none."""
    beside = Path(path).with_suffix(".json")
    if path == STREAM or not beside.is_file():
        return {}
    try:
        head, patches = read_result_json(beside)
        return {**head, "patches": f"{sum(1 for _ in patches)} entries"}
    except InputError as error:  # it may be another program's
        logger.warning("%s It is left out", error)
        return {}


def _brief(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return JSON with long lists, and lists of objects, replaced by their length."""
    return {key: _brief_value(value) for key, value in content.items()}


def _brief_value(value: Any) -> Any:
    if isinstance(value, Mapping):
        return _brief(value)
    is_long = isinstance(value, list) and len(value) > MOST_LISTED
    if is_long or (isinstance(value, list) and any(isinstance(item, Mapping | list) for item in value)):
        return f"{len(value)} entries"
    return value
