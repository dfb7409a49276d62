"""The grids on a public log, against figures that another program of the same definitions gave for it.

The Intel lab, 910 scans; beams of 40 m and more left out; every tenth scan held out (docs/scores.md).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prf.readings import Readings, read_readings
from prf.results.occupancy import build_grid, occupied_probability
from prf.results.score import GridMap, HeldOut, classification_scores, hold_out, score
from tests.factories import grid_settings, score_settings

pytestmark = pytest.mark.slow

ALL = {"skip_scans": "5::10"}
TENTH = {"every_scan": 10}


@pytest.fixture(scope="module")
def intel(shared_data: Path) -> Readings:
    return read_readings(str(shared_data / "prf" / "carmen" / "intel-corrected.log.gz"))


def points_of_the_figures(beams: HeldOut) -> tuple[np.ndarray, np.ndarray]:
    """Return points and states as those figures had them: at least one free point a beam, up to 0.1 m short."""
    rng = np.random.default_rng(1)
    n_free = np.maximum(1, (beams.range / 2.0).astype(int))
    beam = np.repeat(np.arange(len(n_free)), n_free)
    along = rng.random(len(beam)) * np.maximum(0.0, beams.range[beam] - 0.1)
    free = beams.origin[beam] + along[:, None] * beams.direction[beam]
    return np.vstack([beams.returns(), free]), np.arange(len(n_free) + len(beam)) < len(n_free)


@pytest.mark.parametrize(
    ("options", "beam_nll", "auc", "nll", "brier"),
    [
        ({**ALL}, -0.85, 0.9932, 0.298, 0.095),
        ({**ALL, "method": "log-odds"}, -0.10, 0.928, 0.272, 0.069),
        ({**TENTH, "resolution": 0.2}, 0.49, 0.969, 0.337, 0.110),
        ({**TENTH}, 0.76, 0.963, 0.371, 0.120),
        ({**TENTH, "resolution": 0.05}, 1.77, 0.928, 0.449, 0.148),
    ],
)
def test_figures_of_the_intel_lab(
    intel: Readings, options: dict[str, Any], beam_nll: float, auc: float, nll: float, brier: float
) -> None:
    grid = build_grid(intel, None, grid_settings(max_range=40.0, **options))[0]
    beams = hold_out(intel, score_settings(max_range=40.0, scans="5::10"))
    xy, occupied = points_of_the_figures(beams)
    found = classification_scores(occupied_probability(grid, xy), occupied)
    assert score(GridMap(grid), beams, 1)["beam_nll"] == pytest.approx(beam_nll, abs=0.12)
    assert found["auc"] == pytest.approx(auc, abs=0.02)
    assert found["nll"] == pytest.approx(nll, abs=0.035)
    assert found["brier"] == pytest.approx(brier, abs=0.015)
