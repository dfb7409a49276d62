"""The decorators of every kernel; machine code lives in a folder that a digest of all kernel sources names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np

from prf.shell.jit.cache import KernelCache
from prf.shell.jit.parts import LoopCompiler, PartCompiler, share_integers

FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "cache": True, "no_cfunc_wrapper": True}
"""``nogil`` lets chains run in threads; ``numpy`` errors make a division by zero give inf, not raise inside a chain.

``fastmath`` stays off: it would drop the nan and inf that the predicates rely on, and change results with the CPU.
"""

CORE_FLAGS: dict[str, Any] = {**FLAGS, "_nrt": False}
"""Flags of the sampler's kernels: ``_nrt`` off leaves reference counts out.

``_nrt`` is private to numba, hence the upper bound of its version in pyproject.toml. A numba that drops the flag raises
KeyError ("Unrecognized options") at the first call; without the flag all works, a step nine times slower.
One that changes its meaning crashes or leaks in a kernel that allocates: `python -m tests.warm_kernels prf` and
tests/kernels/test_jit_cache.py show both.
"""

PART_FLAGS: dict[str, Any] = {**CORE_FLAGS, "no_cpython_wrapper": True, "cache": False, "pipeline_class": PartCompiler}
"""Flags of the sampler's kernels that only other kernels call."""

Array = np.ndarray
Rng = np.random.Generator

_Function = TypeVar("_Function", bound=Callable[..., Any])

CACHE = KernelCache("prf", Path(__file__).parent, CORE_FLAGS)
"""Of these sources."""


def jit(function: _Function) -> _Function:
    """Compile `function` in nopython mode with the project's flags, cached under :data:`CACHE`."""
    with CACHE.own():
        compiled: _Function = numba.njit(**FLAGS)(function)
    return share_integers(compiled)


def loop(function: _Function) -> _Function:
    """Compile the loop of the sampler's steps: as :func:`jit`, and optimised twice."""
    with CACHE.own():
        compiled: _Function = numba.njit(**FLAGS, pipeline_class=LoopCompiler)(function)
    return share_integers(compiled)


def core(function: _Function) -> _Function:
    """Compile a part of the sampler that only other kernels call: calling it from Python crashes the interpreter.

    Without reference counts (it must not allocate) a step is nine times faster: a chain is a tuple of some eighty
    arrays, each of which would be counted at every call. The cache file of the entry that calls it holds its code.
    """
    compiled: _Function = numba.njit(**PART_FLAGS)(function)
    return share_integers(compiled)


def spine(function: _Function) -> _Function:
    """Compile a part of the sampler that has one caller and takes whole chains: as :func:`core`, always inlined.

    A chain is some six hundred words when it is passed on; copying them at every call of a step took two fifths of it.
    """
    compiled: _Function = numba.njit(**PART_FLAGS, forceinline=True)(function)
    return share_integers(compiled)


def core_entry(function: _Function) -> _Function:
    """Compile a part of the sampler that Python calls: as :func:`core`, with an entry and cached.

    It must not take a random generator: numba wraps one at every call in what reference counts alone set free, 64 bytes
    a call. A function of :func:`jit` that takes it calls a :func:`core` in turn.
    """
    with CACHE.own():
        compiled: _Function = numba.njit(**CORE_FLAGS)(function)
    return share_integers(compiled)
