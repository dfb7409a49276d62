"""A result: a PLY with the label of every point, and beside it a JSON with the patches and why; docs/results.md."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.free_names import original_names
from mapq.io.write import check_name, write_cloud
from mapq.patches import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from prf.shell.errors import UsageError
from prf.shell.files import STREAM, atomic_write
from prf.shell.jsonout import dump_object, jsonable
from prf.shell.lock import claim_output
from prf.shell.together import together

SCHEMA = "mapq.result/1"
OPENING = '"patches": ['
"""End of the first line of the JSON; a patch a line follows."""

CLOUD_UNIT = "cloud_unit"
"""Key of the JSON: metres in a unit of the cloud, axis by axis."""

PATCH, LABEL, PROBABILITY = "patch", "suspicious", "p_suspicious"
RESULT_FIELDS = (PATCH, LABEL, PROBABILITY)
"""The fields that make a cloud a result."""
COLOURS = ("red", "green", "blue")
CAUSE = "cause"
"""Of maps that tell when their points were seen."""

_RGB = {PLAUSIBLE: (31, 98, 184), SUSPICIOUS: (214, 26, 28), UNLABELLED: (140, 148, 153)}


def json_beside(path: str) -> str:
    """Return the name of the JSON of the result `path`: the same name with .json; of the null device, itself.

    Raises
    ------
    UsageError
        If `path` is standard output, or that name itself.
    """
    if path == os.devnull:  # for those who want the exit code alone
        return path
    beside = str(Path(path).with_suffix(".json")) if path != STREAM else STREAM
    if beside in (path, STREAM):
        raise UsageError("a result is two files, a PLY and a JSON of the same name. Name the PLY with -o RESULT.ply.")
    return beside


def claim_result(path: str, force: bool) -> None:
    """Refuse or hold both files of the result, as :func:`prf.shell.lock.claim_output`."""
    check_name(path)
    for name in (path, json_beside(path)):
        claim_output(name, force)


def result_cloud(
    cloud: PointCloud,
    patch: NDArray[np.int32],
    label: NDArray[np.uint8],
    probability: NDArray[np.float32],
    cause: NDArray[np.uint8] | None = None,
) -> PointCloud:
    """Return the cloud with the fields of a result.

    Parameters
    ----------
    cloud : PointCloud
        Fields of its own with the names of a result's are kept (:func:`mapq.io.free_names.original_names`). Fields of
        an earlier result, its colours included, are replaced.
    patch : (n,) int32
    label, probability : (m,)
        Of each patch; points without one get 255 and nan.
    cause : (m,), optional
        Of each patch, 255 where it is plausible; None: no such field.
    """
    fields = dict(cloud.fields)
    if set(RESULT_FIELDS) <= set(fields):
        for name in (*RESULT_FIELDS, *COLOURS, CAUSE):
            fields.pop(name, None)
    fields = original_names(fields, (*RESULT_FIELDS, *COLOURS, CAUSE))
    labels = np.append(label, np.uint8(UNLABELLED))[patch]
    table = np.zeros((256, 3), np.uint8)
    for kind, rgb in _RGB.items():
        table[kind] = rgb
    fields[PATCH] = patch
    fields[LABEL] = labels
    fields[PROBABILITY] = np.append(probability, np.float32(np.nan))[patch].astype(np.float32)
    if cause is not None:
        fields[CAUSE] = np.append(cause, np.uint8(UNLABELLED))[patch]
    fields |= {name: table[labels, index] for index, name in enumerate(COLOURS)}
    return replace(cloud, fields=fields)


def write_result(path: str, cloud: PointCloud, head: Mapping[str, Any], patches: Iterable[Mapping[str, Any]]) -> None:
    """Write both files of a result, which take their places together. Nothing is written to the null device.

    Raises
    ------
    OutputError
        If one of them cannot be written.
    """
    if path == os.devnull:
        return
    with together():
        write_cloud(path, cloud)
        with atomic_write(json_beside(path)) as stream:
            stream.writelines(result_lines(head, patches))


def result_lines(head: Mapping[str, Any], patches: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the JSON of a result, a patch a line."""
    yield dump_object(SCHEMA, head)[:-1] + ", " + OPENING
    separator = "\n"
    for patch in patches:
        yield separator + _line(patch)
        separator = ",\n"
    yield "\n]}\n"


def _line(patch: Mapping[str, Any]) -> str:
    """Return a patch as JSON; most are plain, and looking at each of their numbers first takes three times as long."""
    try:
        return json.dumps(patch, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError):
        return json.dumps(jsonable(patch), allow_nan=False, ensure_ascii=False)
