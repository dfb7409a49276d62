"""The files of a labelled map: one PLY, or two parted by place, and a JSON with how they were made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mapq.cloud import PointCloud
from mapq.io.write import check_name, write_cloud
from mapq.patches import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.perturb.build import Built
from mapq.perturb.split import split_by_place
from prf.shell.errors import UsageError
from prf.shell.files import STREAM, atomic_write
from prf.shell.jsonout import dump_object
from prf.shell.lock import claim_output
from prf.shell.together import together

SCHEMA = "mapq.perturb/1"


class Targets(NamedTuple):
    """Names of the files: the map, or its training and its test part, and the JSON."""

    maps: tuple[str, ...]
    report: str


def target_files(output: str | None, is_split: bool, force: bool) -> Targets:
    """Return the names that follow from that of the map, all of them free to be written."""
    if output is None:
        raise UsageError("the map has no name. Give one with -o MAP.ply.")
    name = Path(output)
    if output == STREAM or name.suffix == ".json":
        raise UsageError("a labelled map is a PLY and a JSON of the same name. Name the PLY with -o MAP.ply.")
    check_name(output)
    parts = (".train", ".test") if is_split else ("",)
    maps = tuple(str(name.with_name(f"{name.stem}{part}{name.suffix or '.ply'}")) for part in parts)
    targets = Targets(maps, str(name.with_suffix(".json")))
    for target in (*targets.maps, targets.report):
        claim_output(target, force)
    return targets


def write_map(
    targets: Targets, built: Built, head: Mapping[str, Any], share: float | None, buffer: float
) -> dict[str, Any]:
    """Write the files, which take their places together, and return the content of the JSON, which begins with `head`.

    `share` and `buffer` are those of :func:`mapq.perturb.split.split_by_place`; share None: the map in one.
    """
    parts: Sequence[PointCloud] = (built.cloud,)
    content = {**head, **built.report}
    if share is not None:
        split = split_by_place(built.cloud, share, buffer)
        parts = (split.train, split.test)
        content["split"] = {"axis": "xy"[split.axis], "strip": split.strip, "n_dropped": split.n_dropped}
    content["files"] = [_file_row(*each) for each in zip(targets.maps, parts, strict=True)]
    with together():
        for path, part in zip(targets.maps, parts, strict=True):
            write_cloud(path, part)
        with atomic_write(targets.report) as stream:
            stream.write(dump_object(SCHEMA, content) + "\n")
    return content


def _file_row(path: str, part: PointCloud) -> dict[str, Any]:
    label = part.fields["suspicious"]
    kinds = {"suspicious": SUSPICIOUS, "plausible": PLAUSIBLE, "without_label": UNLABELLED}
    counts = {f"n_{name}": int(np.count_nonzero(label == kind)) for name, kind in kinds.items()}
    return {"path": path, "n_points": len(part), **counts}
