"""Calling a kernel keeps no hold of a random generator: over a day of calls that would fill the memory."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys

import numpy as np

import prf.kernels
from prf.kernels import constants as c
from prf.kernels.step import run
from prf.model.coloring import Coloring
from prf.model.window import Window
from prf.sampler.target import Target, make_chain

ROOM = Window(0.0, 0.0, 10.0, 10.0)


def kernels():
    for module in pkgutil.walk_packages(prf.kernels.__path__, "prf.kernels."):
        for name, found in vars(importlib.import_module(module.name)).items():
            if getattr(found, "__module__", "") == module.name and hasattr(found, "targetoptions"):
                yield f"{module.name}.{name}", found


def test_no_entry_without_reference_counts_takes_a_generator():
    entries = {
        name: set(inspect.signature(kernel.py_func).parameters)
        for name, kernel in kernels()
        if kernel.targetoptions.get("_nrt") is False and not kernel.targetoptions.get("no_cpython_wrapper")
    }
    assert len(entries) > 20
    assert [name for name, parameters in entries.items() if "rng" in parameters] == []


def test_a_generator_is_let_go_after_every_call():
    chain, rng = make_chain(Target(ROOM, 0.2), Coloring.empty(ROOM)), np.random.default_rng(1)
    before = sys.getrefcount(rng)
    for _ in range(50):
        run(chain, rng, int(chain.graph.counts[c.STEP]) + 3)
    assert int(chain.graph.counts[c.STEP]) == 150
    assert sys.getrefcount(rng) == before
