from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
import shapely
import shapely.geometry

from prf.readings import describe, read_readings


@pytest.fixture(scope="module")
def readings(data_dir):
    return read_readings(str(data_dir / "demo-office.log.gz"))


@pytest.fixture(scope="module")
def plan(data_dir):
    feature = json.loads((data_dir / "demo-office.geojson").read_text())
    return shapely.geometry.shape(feature["geometry"])


def test_the_files_are_what_the_script_makes(data_dir, tmp_path, readings):
    subprocess.run([sys.executable, str(data_dir / "make_demo_log.py"), str(tmp_path)], check=True)
    made = read_readings(str(tmp_path / "demo-office.log.gz"))
    # Another machine's sine may turn a centimetre over, no more.
    np.testing.assert_allclose(made.range, readings.range, atol=0.011)
    np.testing.assert_allclose(made.origin, readings.origin, atol=1e-4)
    assert (tmp_path / "demo-office.geojson").read_text() == (data_dir / "demo-office.geojson").read_text()


def test_it_is_small_and_unsuspicious(data_dir, readings):
    summary = describe(readings, "demo")
    assert (summary.n_scans, summary.n_beams, summary.suspicions) == (31, 5580, ())
    assert (data_dir / "demo-office.log.gz").stat().st_size < 1e6


def test_the_plan_is_valid_and_the_robot_drives_through_free_space(readings, plan):
    assert plan.is_valid
    assert shapely.distance(plan, shapely.points(readings.origin)).min() > 0.3


def test_readings_agree_with_the_plan_but_for_outliers_and_misses(readings, plan):
    direction = np.column_stack((np.cos(readings.angle), np.sin(readings.angle)))
    rays = shapely.linestrings(np.stack((readings.origin, readings.origin + 30 * direction), axis=1))
    distance = shapely.distance(shapely.points(readings.origin), shapely.intersection(rays, plan))
    error = readings.range - np.where(np.isnan(distance), 81.83, distance)
    near = np.abs(error) < 0.15
    assert error[near].std() == pytest.approx(0.03, rel=0.05)
    assert 0.02 < np.mean(~near) < 0.06
    missed = readings.range == 81.83
    assert 0.01 < np.mean(missed[np.isfinite(distance)]) < 0.03
