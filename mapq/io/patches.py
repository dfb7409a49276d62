"""The PATCHES file: a cloud with all its fields, cut into plane patches, with their labels."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from mapq.cloud import PointCloud
from mapq.io.content import Content, damage_in_one_line
from mapq.io.fields import Array
from mapq.io.journal import with_journal
from mapq.io.npy import ZIP_MAGIC
from mapq.labels import LABEL_TOLERANCE, NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.patches import Patches
from prf.shell.cli.files import STREAM, open_output
from prf.shell.cli.storage import check_schema, damaged, jsonable, take_array
from prf.shell.errors import InputError

SCHEMA = "mapq.patches/1"

_TYPES: dict[str, type[np.float32 | np.float64]] = {"float32": np.float32, "float64": np.float64}


def write_patches(path: str | os.PathLike[str], patches: Patches) -> None:
    """Write patches with all points and fields, whole or not at all; ``-`` is standard output.

    Arrays are stored as they are, to the last bit; numbers of `parameters` and `report` that are not finite become
    null.

    Raises
    ------
    OutputError
        If the file cannot be written, or standard output is a terminal.
    """
    cloud = patches.cloud
    arrays: dict[str, Any] = {
        "xyz": cloud.xyz,
        "shift": cloud.shift,
        "coordinate_type": np.str_(np.dtype(cloud.coordinate_type).name),
        "source": np.str_(cloud.source),
        "unit": cloud.unit,
        "las_header": np.frombuffer(cloud.las_header, np.uint8),
        "field_names": _text(list(cloud.fields)),
        **{f"field_{number}": values for number, values in enumerate(cloud.fields.values())},
        **{name: getattr(patches, name) for name in ("patch", "normal", "centroid", "label", "label_source")},
        "label_tolerance": patches.label_tolerance,
        **{name: values for name in ("apart", "bend") if (values := getattr(patches, name)) is not None},
        "parameters": _text(patches.parameters),
        "report": _text(patches.report),
    }
    with open_output(path, binary=True) as stream:
        np.savez(stream, schema=np.str_(SCHEMA), **arrays)


def read_patches(path: str | os.PathLike[str]) -> Patches:
    """Read a PATCHES file, with the labels of the journal beside it if there is one.

    Raises
    ------
    InputError
        If it is missing, damaged, of another schema or version, or contradicts itself; likewise its journal.
    """
    return parse_patches(Content(os.fspath(path)).data(), path)


def parse_patches(data: bytes, path: str | os.PathLike[str]) -> Patches:
    """Return the patches in the bytes of a PATCHES file; `path` and errors as :func:`read_patches`."""
    patches = parse_stored(data, path)
    return patches if os.fspath(path) == STREAM else with_journal(patches, path)


def parse_stored(data: bytes, path: str | os.PathLike[str]) -> Patches:
    """Return the patches in the bytes of a PATCHES file, without its journal; else as :func:`parse_patches`."""
    file = Path(path)
    if not data.startswith(ZIP_MAGIC):
        raise InputError(f"{path}: expected a PATCHES file. Make one with mapq segment.")
    with damage_in_one_line(str(path)):
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        check_schema(file, str(arrays.pop("schema", "")), SCHEMA)
        normal = take_array(file, arrays, "normal", np.float64, (None, 3))
        cloud = _take_cloud(file, arrays)
        patches = Patches(
            cloud,
            take_array(file, arrays, "patch", np.int32, (len(cloud),)),
            normal,
            take_array(file, arrays, "centroid", np.float64, (len(normal), 3)),
            take_array(file, arrays, "label", np.uint8, (len(normal),)),
            take_array(file, arrays, "label_source", np.uint8, (len(normal),)),
            dict(json.loads(str(arrays["parameters"]))),
            dict(json.loads(str(arrays["report"]))),
            take_array(file, arrays, "apart", np.float64, (len(normal),)) if "apart" in arrays else None,
            float(arrays.get("label_tolerance", LABEL_TOLERANCE)),
            take_array(file, arrays, "bend", np.float64, (len(normal), 3)) if "bend" in arrays else None,
        )
    _check(file, patches)
    return patches


def is_patches(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a PATCHES file, of whatever version; False where there is no file, or a damaged one."""
    try:
        return holds_patches(Content(os.fspath(path)))
    except InputError:
        return False


def holds_patches(content: Content) -> bool:
    """Return whether an input is a PATCHES file; see :func:`is_patches`."""
    if not content.head.startswith(ZIP_MAGIC):
        return False
    try:
        with content.stream() as stream, np.load(stream, allow_pickle=False) as archive:
            schema = str(archive["schema"])
    except Exception:  # of numpy, for an archive that is damaged or not ours
        return False
    return schema.rpartition("/")[0] == SCHEMA.rpartition("/")[0]


def _text(value: Any) -> np.str_:
    return np.str_(json.dumps(jsonable(value), allow_nan=False))


def _take_cloud(file: Path, arrays: dict[str, Array]) -> PointCloud:
    xyz = take_array(file, arrays, "xyz", np.float64, (None, 3))
    shift = take_array(file, arrays, "shift", np.float64, (3,))
    names = [str(name) for name in json.loads(str(arrays["field_names"]))]
    fields = {name: arrays[f"field_{number}"] for number, name in enumerate(names)}
    if any(np.shape(each)[:1] != (len(xyz),) for each in fields.values()):
        raise damaged(file, f"a field has not {len(xyz)} rows")
    unit = take_array(file, arrays, "unit", np.float64, (3,)) if "unit" in arrays else np.ones(3)
    header = take_array(file, arrays, "las_header", np.uint8, (None,)).tobytes() if "las_header" in arrays else b""
    kind = _TYPES[str(arrays["coordinate_type"])]
    return PointCloud(xyz, shift, fields, kind, str(arrays.get("source", "")), unit, header)


def _check(file: Path, patches: Patches) -> None:
    """Refuse content that contradicts itself."""
    n_patches, patch = len(patches), patches.patch
    if len(patch) and (patch.min() < NO_PATCH or patch.max() >= n_patches):
        raise damaged(file, f"patch numbers are not within {NO_PATCH} and {n_patches - 1}")
    if n_patches and patches.counts.min() == 0:
        raise damaged(file, f"patch {int(patches.counts.argmin())} has no points")
    if not (np.isfinite(patches.cloud.xyz[patch != NO_PATCH]).all() and np.isfinite(patches.centroid).all()):
        raise damaged(file, "a point of a patch or a centroid is not finite")
    if not np.isin(patches.label, (PLAUSIBLE, SUSPICIOUS, UNLABELLED)).all():
        raise damaged(file, "a label is neither 0 nor 1 nor 255")
