"""The decorator of every kernel; machine code lives in a folder that a digest of all kernel sources names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from prf.shell.jit.cache import KernelCache
from prf.shell.jit.parts import PartCompiler, share_integers

FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "cache": True, "no_cfunc_wrapper": True}
"""``nogil`` lets tiles run in threads; ``numpy`` errors make a division by zero give inf, not raise inside a loop.

``fastmath`` stays off: it would drop the nan and inf that the predicates rely on, and change results with the CPU.
"""
PART_FLAGS: dict[str, Any] = {**FLAGS, "cache": False, "no_cpython_wrapper": True, "pipeline_class": PartCompiler}
CORE_FLAGS: dict[str, Any] = {**PART_FLAGS, "_nrt": False}
"""``_nrt`` off leaves reference counts out, as in prf."""

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Codes = NDArray[np.uint64]
Bytes = NDArray[np.uint8]
Bools = NDArray[np.bool_]

_Function = TypeVar("_Function", bound=Callable[..., Any])

CACHE = KernelCache("mapq", Path(__file__).parent, FLAGS)
"""Of these sources."""


def jit(function: _Function) -> _Function:
    """Compile `function` in nopython mode with the project's flags, cached under :data:`CACHE`.

    For kernels that Python calls, and for parts of them that are called from several entries.
    """
    with CACHE.own():
        compiled: _Function = numba.njit(**FLAGS)(function)
    return share_integers(compiled)


def part(function: _Function) -> _Function:
    """Compile a part of a kernel: inlined or called by entries only, without a cache file of its own."""
    compiled: _Function = numba.njit(**PART_FLAGS)(function)
    return share_integers(compiled)


def core(function: _Function) -> _Function:
    """Compile a part of a kernel that makes no arrays and returns none, without counting references to any.

    Counting takes an atomic instruction for each array, and each row of one, that a loop names.
    """
    compiled: _Function = numba.njit(**CORE_FLAGS)(function)
    return share_integers(compiled)
