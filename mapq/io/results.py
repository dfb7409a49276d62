"""A result: a cloud with the label of every point, and beside it a JSON with the patches and why; docs/results.md.

The JSON has a patch a line and is read so: that of a million patches has gigabytes.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.content import damage_in_one_line
from mapq.io.fields import COLOURS, original_names
from mapq.io.write import check_name, write_cloud
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from prf.shell.cli.files import STREAM, atomic_write, open_input, together
from prf.shell.cli.outputs import claim_output
from prf.shell.cli.storage import check_schema, dump_object, jsonable, load_object
from prf.shell.errors import InputError, UsageError

Row = dict[str, Any]

SCHEMA = "mapq.result/1"
OPENING = '"patches": ['
"""End of the first line of the JSON; a patch a line follows."""

CLOUD_UNIT = "cloud_unit"
"""Key of the JSON: metres in a unit of the cloud, axis by axis."""

PATCH, LABEL, PROBABILITY = "patch", "suspicious", "p_suspicious"
RESULT_FIELDS = (PATCH, LABEL, PROBABILITY)
"""The fields that make a cloud a result."""
CAUSE = "cause"
"""Of maps whose points have times."""

_RGB = {PLAUSIBLE: (31, 98, 184), SUSPICIOUS: (214, 26, 28), UNLABELLED: (140, 148, 153)}


def json_beside(path: str) -> str:
    """Return the name of the JSON of the result `path`: the same name with .json; of the null device, itself."""
    if path == os.devnull:  # for those who want the exit code alone
        return path
    beside = str(Path(path).with_suffix(".json")) if path != STREAM else STREAM
    if beside in (path, STREAM):
        raise UsageError("a result is a cloud and a JSON of the same name. Name the cloud with -o RESULT.ply.")
    return beside


def claim_result(path: str, force: bool) -> None:
    """Refuse or hold both files of the result, as :func:`prf.shell.cli.outputs.claim_output`."""
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
        Fields of its own with the names of a result's are kept (:func:`mapq.io.fields.original_names`). Fields of
        an earlier result, its colours included, are replaced.
    patch : (n,) int32
    label, probability : (m,)
        Of each patch; points without one get 255 and nan.
    cause : (m,), optional
        Of each patch, 255 where it is plausible; None: no such field.
    """
    own = (*RESULT_FIELDS, *COLOURS, CAUSE)
    is_result = set(RESULT_FIELDS) <= set(cloud.fields)
    kept = {name: values for name, values in cloud.fields.items() if not (is_result and name in own)}
    fields = original_names(kept, own)
    labels = np.append(label, np.uint8(UNLABELLED))[patch]
    table = np.zeros((256, 3), np.uint8)
    table[list(_RGB)] = list(_RGB.values())
    fields[PATCH] = patch
    fields[LABEL] = labels
    fields[PROBABILITY] = np.append(probability, np.float32(np.nan))[patch].astype(np.float32)
    if cause is not None:
        fields[CAUSE] = np.append(cause, np.uint8(UNLABELLED))[patch]
    fields |= {name: table[labels, index] for index, name in enumerate(COLOURS)}
    return replace(cloud, fields=fields)


def write_result(path: str, cloud: PointCloud, head: Mapping[str, Any], patches: Iterable[Mapping[str, Any]]) -> None:
    """Write both files of a result, which take their places together. Nothing is written to the null device."""
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
    """Return a patch as JSON; converting its numbers first takes three times as long, and few need it."""
    try:
        return json.dumps(patch, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError):
        return json.dumps(jsonable(patch), allow_nan=False, ensure_ascii=False)


def read_result_json(path: Path) -> tuple[Row, Iterator[Row]]:
    """Return the JSON of a result but for its patches, and an iterator over these.

    JSON in another layout, as another program writes it, is read at once.
    """
    with open_input(path) as stream:
        first = stream.readline().decode("utf-8", "replace").rstrip()
    is_ours = first.endswith(OPENING)
    with damage_in_one_line(str(path)):
        head = dict(json.loads(first + "]}")) if is_ours else load_object(path, SCHEMA)
        check_schema(path, str(head.get("schema", "")), SCHEMA)
        rows = head.pop("patches")
    return head, _patches(path) if is_ours else iter(rows)


def _patches(path: Path) -> Iterator[Row]:
    """Yield the patches of a file from its second line on."""
    with open_input(path) as source, TextIOWrapper(source, encoding="utf-8", errors="replace") as stream:
        stream.readline()
        number = 1
        for number, line in enumerate(stream, 2):
            if line.rstrip() == "]}":
                return
            try:
                row = dict(json.loads(line.rstrip().removesuffix(",")))
            except (ValueError, TypeError):
                raise InputError(f"{path}:{number}: damaged (not a JSON object). Run mapq classify again.") from None
            yield row
    raise InputError(f"{path}:{number}: damaged (the list of patches does not end). Run mapq classify again.")


def stated_unit(path: Path) -> NDArray[np.float64] | None:
    """Return the metres (3,) in a unit of the cloud of a result, as its JSON states; None without such a JSON."""
    try:
        found = read_result_json(path)[0].get(CLOUD_UNIT)
    except InputError:  # reported by those who need more of it
        return None
    with damage_in_one_line(str(path)):
        return None if found is None else np.array(found, np.float64).reshape(3)


def patch_counts(path: Path, head: Row) -> tuple[int, int]:
    """Return the numbers of patches and of suspicious ones that the JSON of a result counts."""
    with damage_in_one_line(str(path)):
        return int(head["counts"]["n_patches"]), int(head["counts"]["n_suspicious"])
