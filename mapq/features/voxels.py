"""Hash tables of voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.voxels import fill_table


def table_of(key: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the hash table of the places of distinct keys (v,)."""
    table = np.empty(1 << int(2 * len(key)).bit_length(), np.int64)
    fill_table(key, table)
    return table
