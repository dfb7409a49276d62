"""What a path holds: PATCHES, a result (one cloud with a JSON beside it, or a folder of tiles), or a bare cloud."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content
from mapq.io.patches import holds_patches, parse_patches
from mapq.io.results import RESULT_FIELDS, json_beside, read_result_json
from mapq.io.tiles import MapFiles, is_result_folder, open_result_folder
from mapq.labels import LABEL_TOLERANCE, NO_PATCH
from mapq.patches import Patches
from prf.shell.errors import InputError

Row = Mapping[str, Any]


def read_input(path: str, options: ReadOptions = AS_IT_IS) -> Patches | PointCloud:
    """Read PATCHES or a cloud, whichever `path` is; ``-`` is standard input.

    Raises InputError as :func:`mapq.io.read_patches` and :func:`mapq.io.read_cloud`; UsageError if options are given
    for PATCHES.
    """
    content = Content(path)
    if holds_patches(content):
        options.refuse_given(path)
        return parse_patches(content.data(), path)
    return parse_cloud(content, options)[1]


class StoredResult(NamedTuple):
    """A RESULT; the points of a folder are read a piece at a time, as they may not fit into memory."""

    path: str
    points: PointCloud | MapFiles

    @property
    def json(self) -> Path:
        """The file with the patches."""
        return self.points.json if isinstance(self.points, MapFiles) else Path(json_beside(self.path))

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields of all points."""
        return tuple(self.points.fields)

    def pieces(self, *names: str) -> Iterator[PointCloud]:
        """Yield the points with the fields of a result, and those named."""
        if isinstance(self.points, PointCloud):
            yield self.points
        else:
            yield from (piece for _, piece in self.points.pieces((*RESULT_FIELDS, *names)))

    def content(self) -> tuple[dict[str, Any], Iterator[Row]]:
        """Return the JSON without the patches, and an iterator over these."""
        if not self.json.exists():
            raise InputError(
                f"{self.path}: the JSON of this result is not beside it ({self.json}). Run mapq classify again."
            )
        return read_result_json(self.json)

    @property
    def tolerance(self) -> float:
        """Metres at which the result is, as its JSON says; without one that of labels."""
        if not self.json.exists():
            return LABEL_TOLERANCE
        return float(self.content()[0].get("tolerance", LABEL_TOLERANCE))

    def inside(self, piece: PointCloud, n_patches: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return which points (k,) of a piece are in patches, and in which of those that the JSON has."""
        number = np.asarray(piece.fields[RESULT_FIELDS[0]])
        rows = np.flatnonzero((number != NO_PATCH) & piece.finite())
        patch = number[rows].astype(np.int64)
        if len(patch) and not 0 <= int(patch.min()) <= int(patch.max()) < n_patches:
            raise self.mismatch("patches")
        return rows, patch

    def mismatch(self, what: str) -> InputError:
        """Return the error that the JSON describes another cloud."""
        return InputError(f"{self.json}: not the JSON of {self.path}, which has other {what}. Run mapq classify again.")


def read_map(path: str, options: ReadOptions = AS_IT_IS) -> Patches | StoredResult | PointCloud:
    """Read PATCHES, a result, or a cloud without labels, whichever `path` is."""
    if is_result_folder(path):
        return StoredResult(path, open_result_folder(path, options))
    found = read_input(path, options)
    if isinstance(found, PointCloud) and set(RESULT_FIELDS) <= set(found.fields):
        return StoredResult(path, found)
    return found
