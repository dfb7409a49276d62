"""The JSON of a result, read a patch at a time: that of a million patches has gigabytes, too much to hold at once."""

from __future__ import annotations

import json
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.io.results import CLOUD_UNIT, OPENING, SCHEMA, json_beside
from prf.shell.errors import InputError
from prf.shell.files import open_input
from prf.shell.storage import check_schema, damaged, load_object

Row = dict[str, Any]

MOST_DIGITS = 300
"""Of a whole number, so that it fits a float."""


def read_result_json(path: Path) -> tuple[Row, Iterator[Row]]:
    """Return the JSON of a result but for its patches, and an iterator over these.

    A result has a patch a line, and is read so. JSON that was laid out anew by another program is read at once.

    Raises
    ------
    InputError
        If the file is missing, damaged, or of another schema; of a patch when the iterator comes to it.
    """
    try:
        with open_input(path) as stream:
            first = stream.readline().decode("utf-8")
    except UnicodeDecodeError:  # said below
        first = ""
    if first.rstrip().endswith(OPENING):
        head = _parse(path, 1, first.rstrip() + "]}")
        check_schema(path, str(head.get("schema", "")), SCHEMA)
        del head["patches"]
        return head, _lines(path)
    head = load_object(path, SCHEMA, _whole_number)
    rows = head.pop("patches", None)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise damaged(path, "no list of patches")
    return head, iter(rows)


def unit_beside(path: str) -> NDArray[np.float64] | None:
    """Return the metres (3,) in a unit of the cloud of the result `path`, as the JSON beside it says, or None."""
    if path.endswith(".json"):
        return None
    return stated_unit(Path(json_beside(path)))


def stated_unit(path: Path) -> NDArray[np.float64] | None:
    """Return the metres (3,) in a unit of the cloud of a result, as its JSON says; None if that says nothing.

    What else is wrong with the JSON is for those to tell who need more of it.

    Raises
    ------
    InputError
        If what it says is no unit.
    """
    try:
        found = read_result_json(path)[0].get(CLOUD_UNIT) if path.is_file() else None
    except (InputError, OSError):  # of a name that is one letter too long, too
        return None
    if found is None:
        return None
    is_row = isinstance(found, list) and len(found) == 3 and all(isinstance(each, int | float) for each in found)
    if not is_row or not all(0.0 < each < float("inf") for each in found):
        raise damaged(path, f"{CLOUD_UNIT} is no unit of three axes")
    return np.array(found, np.float64)


def patch_counts(path: Path, head: Row) -> tuple[int, int]:
    """Return how many patches a result has, and how many of these are suspicious, by the counts in its JSON.

    Raises
    ------
    InputError
        If there are none.
    """
    counts = head.get("counts")
    found = [counts.get(name) if isinstance(counts, dict) else None for name in ("n_patches", "n_suspicious")]
    n_patches, n_suspicious = found
    if not (isinstance(n_patches, int) and isinstance(n_suspicious, int) and 0 <= n_suspicious <= n_patches):
        raise damaged(path, "no counts of patches")
    return n_patches, n_suspicious


def _lines(path: Path) -> Iterator[Row]:
    """Yield the patches of a file whose first line was read and is well."""
    with open_input(path) as source, TextIOWrapper(source, encoding="utf-8") as stream:
        stream.readline()
        line, number = "", 1
        for number, line in enumerate(_decoded(path, stream), 2):
            if line.rstrip() == "]}":
                break
            row = line.rstrip()
            yield _parse(path, number, row.removesuffix(","))
        if line.rstrip() != "]}" or stream.read(1):
            raise InputError(f"{path}:{number}: damaged (the list of patches does not end). Run mapq classify again.")


def _decoded(path: Path, stream: TextIOWrapper) -> Iterator[str]:
    try:
        while line := stream.readline():
            yield line
    except UnicodeDecodeError as error:
        raise damaged(path, "not UTF-8 text") from error


def _whole_number(text: str) -> int:
    """Return a whole number of JSON; ValueError for one that no float holds, which arithmetic would stumble on."""
    if len(text) >= MOST_DIGITS:
        raise ValueError("a whole number beyond all floats")
    return int(text)


def _parse(path: Path, number: int, text: str) -> Row:
    try:
        found = json.loads(text, parse_int=_whole_number)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise InputError(f"{path}:{number}: damaged (not a JSON object). Run mapq classify again.")
    return found
