from __future__ import annotations

import numpy as np
import pytest

from prf.readings import describe, read_readings, write_table
from tests.readings.sonar_sets import ARENA_WALLS, arena_readings, corridor8_readings


def test_corridor(shared_data, tmp_path):
    readings = corridor8_readings(shared_data / "prf/sonar/corridor8")
    assert (readings.n_scans, readings.n_beams) == (413, 413 * 8)
    assert readings.range.min() == 0.4
    assert np.isinf(readings.range).mean() > 0.2
    assert np.ptp(readings.time) == pytest.approx(92.8, abs=0.1)
    summary = describe(readings, "corridor8")
    assert (summary.kind, summary.devices) == ("sonar", ("table",))
    write_table(tmp_path / "corridor8.csv", readings)
    again = read_readings(str(tmp_path / "corridor8.csv"), "sonar")
    np.testing.assert_array_equal(again.range, readings.range)
    np.testing.assert_array_equal(again.cone, readings.cone)


def test_arena(shared_data):
    readings = arena_readings(shared_data / "prf/sonar/arena_known_map")
    assert (readings.n_scans, readings.n_beams) == (5, 900)
    assert np.isinf(readings.range).reshape(5, -1).sum(axis=1).tolist() == [0, 13, 10, 20, 12]
    # No echo comes from nearer than the nearest wall, give or take what the placing by hand leaves.
    a, b = ARENA_WALLS[:, 0], ARENA_WALLS[:, 1]
    along = np.clip(np.sum((readings.origin[:, None] - a) * (b - a), axis=2) / np.sum((b - a) ** 2, axis=1), 0, 1)
    nearest = np.linalg.norm(a + along[..., None] * (b - a) - readings.origin[:, None], axis=2).min(axis=1)
    assert np.mean(readings.range > nearest - 0.06) > 0.98
