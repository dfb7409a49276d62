"""Files of the work folder: arrays by name, whole or absent, so that a task may be done twice."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray


def save_arrays(path: str, **arrays: NDArray[Any]) -> None:
    """Write arrays by name; what stood there is replaced at once."""
    made = f"{path}.{os.getpid()}.tmp"
    with open(made, "wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]
    os.replace(made, path)


def save_array(path: str, values: NDArray[Any]) -> None:
    """Write one array, of which slices can be read; what stood there is replaced at once."""
    made = f"{path}.{os.getpid()}.tmp"
    with open(made, "wb") as stream:
        np.save(stream, values)
    os.replace(made, path)
