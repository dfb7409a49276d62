"""The files of a labelled map: the cloud, and a JSON with how it was made."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mapq.io.write import check_name, write_cloud
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.perturb.build import Built
from prf.shell.cli.files import STREAM, atomic_write, together
from prf.shell.cli.outputs import claim_output
from prf.shell.cli.storage import dump_object
from prf.shell.errors import UsageError

SCHEMA = "mapq.perturb/1"


def target_files(output: str | None, force: bool) -> tuple[str, str]:
    """Return the names of the map and of its JSON, both of them free to be written."""
    if output is None:
        raise UsageError("the map has no name. Give one with -o MAP.ply.")
    name = Path(output)
    if output == STREAM or name.suffix == ".json":
        raise UsageError("a labelled map is a PLY and a JSON of the same name. Name the PLY with -o MAP.ply.")
    check_name(output)
    targets = str(name if name.suffix else name.with_suffix(".ply")), str(name.with_suffix(".json"))
    for target in targets:
        claim_output(target, force)
    return targets


def write_map(targets: tuple[str, str], built: Built, head: Mapping[str, Any]) -> dict[str, Any]:
    """Write both files, which take their places together, and return the content of the JSON: `head` and the report."""
    path, beside = targets
    label = built.cloud.fields["suspicious"]
    kinds = {"suspicious": SUSPICIOUS, "plausible": PLAUSIBLE, "without_label": UNLABELLED}
    counts = {f"n_{name}": int(np.count_nonzero(label == kind)) for name, kind in kinds.items()}
    content = {**head, **built.report, "files": [{"path": path, "n_points": len(built.cloud), **counts}]}
    with together():
        write_cloud(path, built.cloud)
        with atomic_write(beside) as stream:
            stream.write(dump_object(SCHEMA, content) + "\n")
    return content
