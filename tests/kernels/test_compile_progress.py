"""What is shown of compiling, and the code of parts: compiled once, linked into what calls them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import event

from prf.shell.cli import console
from prf.shell.jit.cache import KernelCache
from prf.shell.jit.parts import PartCompiler, share_integers

FLAGS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
SOURCE = """
@part
def lowest(x, n):
    return x + n

@part
def middle(x, n):
    return lowest(lowest(x, n), 1)

@njit
def entry(values, few):
    return middle(values[0], few[0]) + lowest(0.0, len(values))
"""
ARGUMENTS = np.array([2.5, 0.0]), np.array([3], np.int32)


def make_kernels() -> tuple[Any, Any]:
    """Return a kernel with two levels of parts, and the lowest part, which is called with integers of three kinds."""
    njit: Any = numba.njit
    names = {
        "__name__": "toy.kernels.sums",
        "njit": njit,
        "part": lambda function: share_integers(njit(**FLAGS, pipeline_class=PartCompiler)(function)),
    }
    exec(SOURCE, names)
    return names["entry"], names["lowest"]


def test_parts_are_compiled_once_for_integers_of_all_kinds() -> None:
    entry, lowest = make_kernels()
    assert entry(*ARGUMENTS) == 2.5 + 3 + 1 + 2
    assert len(lowest.signatures) == 1


def test_kernels_are_counted_while_they_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    entry, _ = make_kernels()
    monkeypatch.setattr(console.settings, "command", "")
    monkeypatch.setenv("TOY_CACHE_DIR", str(tmp_path))
    cache = KernelCache("toy", tmp_path, {})
    with caplog.at_level(logging.INFO):
        entry(*ARGUMENTS)
        entry(*ARGUMENTS)
    unregister: Any = event.unregister
    unregister("numba:compile", cache)
    assert len(cache.compiled) == 3
    assert caplog.messages == [
        "compiling what this call needs for such an input, once on this machine; toy warm compiles all ahead ..."
    ]
