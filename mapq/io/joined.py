"""Fields of the scans of one file, joined into those of one cloud."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mapq.io.fields import Array, warn_dropped

SCAN = "scan"
"""Field that numbers the scans of a file that has several."""


def joined_fields(parts: Sequence[Mapping[str, Array]], counts: Sequence[int], source: str) -> dict[str, Array]:
    """Return the fields that all scans have in one shape, and `scan` if there are several and none is called so.

    Parameters
    ----------
    parts : sequence of mapping of str to (n, ...) array
        Fields of each scan.
    counts : sequence of int
        Its points.
    source : str
        Name of the file; a warning names the fields that are dropped.
    """
    fields = common_fields(parts, source)
    if len(parts) > 1 and SCAN not in fields:
        fields[SCAN] = np.repeat(np.arange(len(parts), dtype=np.int32), counts)
    return fields


def common_fields(parts: Sequence[Mapping[str, Array]], source: str) -> dict[str, Array]:
    """Return the fields (n, ...) that all scans have in one shape, scan after scan; a warning names the others."""
    fields, dropped = {}, []
    for name in dict.fromkeys(name for part in parts for name in part):
        values = [part[name] for part in parts if name in part]
        if len(values) == len(parts) and len({each.shape[1:] for each in values}) == 1:
            fields[name] = np.concatenate(values)
        else:
            dropped.append(name)
    warn_dropped(dropped, source, "not alike in every scan")
    return fields
