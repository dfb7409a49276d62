"""Early rejection decides as the sum over all touched beams does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.kernels.step import run
from prf.model.coloring import Coloring
from prf.model.laser import LaserModel
from prf.model.layout import grow
from prf.model.window import Window
from prf.sampler.posterior import Settings, make_chain
from tests.kernels.entries import decide_early
from tests.reference.beams import Sensor
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
MODELS = [LaserModel(6.0), LaserModel(6.0, noise=0.1, noise_relative=0.05), LaserModel(6.0, noise=1.0)]


@pytest.mark.slow  # its entry takes a minute to compile
@pytest.mark.parametrize("model", MODELS)
def test_early_decisions_are_the_same(model: LaserModel) -> None:
    rng = np.random.default_rng(4)
    data = dataclasses.replace(draw_world(0.3, ROOM, Sensor(6.0), 4, 60, rng).data, model=model)
    chain = make_chain(Settings(ROOM, 0.3, data, cell=0.7), Coloring.empty(ROOM))
    counts = np.zeros(4, np.int64)
    for steps in range(2_000, 40_001, 2_000):
        while not run(chain, rng, steps):
            chain = grow(chain)
        decide_early(chain, rng, 500, counts)
    assert counts[0] == 0
    assert counts[1] > 100
    assert counts[2] > 100
    assert counts[3] > 1000
