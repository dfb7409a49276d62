"""States of readings: which scans share one, which are left, and what the odometry says between them."""

from __future__ import annotations

import numpy as np
import pytest

from prf.poses.model import ODOMETRY, pose_model
from prf.readings import Readings
from prf.shell.errors import InputError

N_BEAMS = 6


def drive(n: int, period: float, *, cone: float = 0.0) -> Readings:
    """Return scans a metre apart for each second, without poses in a table."""
    time = period * np.arange(n)
    origin = np.repeat(np.column_stack([time, np.zeros(n)]), N_BEAMS, axis=0)
    angle = np.tile(np.linspace(-1.0, 1.0, N_BEAMS), n)
    scan = np.repeat(np.arange(n), N_BEAMS)
    return Readings.from_arrays(
        origin, angle, np.full(len(angle), 3.0), scan=scan, time=np.repeat(time, N_BEAMS), cone=cone
    )


def test_scans_of_two_sensors_share_states_where_their_times_agree() -> None:
    laser, sonar = drive(5, 1.0), drive(15, 0.3, cone=0.3)
    model = pose_model(laser, sonar, (0.05, 0.01))
    shared = {0.0, 3.0}
    assert len(model.scan) == 5 + 15 - len(shared)
    assert (np.diff(model.time) > 0.0).all()
    for part, local in ((laser, model.laser), (sonar, model.sonar)):
        assert local is not None
        origin, angle = local.at(model.prior.given)
        np.testing.assert_allclose(origin, part.origin, atol=1e-12)
        np.testing.assert_allclose(np.exp(1j * angle), np.exp(1j * part.angle), atol=1e-12)


def test_what_is_left_keeps_its_frames_whatever_is_thinned_away() -> None:
    laser, sonar = drive(5, 1.0), drive(15, 0.3, cone=0.3)
    model = pose_model(laser, sonar, (0.05, 0.01))
    rows, cones = np.arange(N_BEAMS + 2, laser.n_beams, 3), np.arange(1, sonar.n_beams, 4)
    used = model.used(rows, cones)
    for part, local, chosen in ((laser, used.laser, rows), (sonar, used.sonar, cones)):
        assert local is not None
        np.testing.assert_allclose(local.at(used.start)[0], part.origin[chosen], atol=1e-12)
    assert len(used.start) == len(np.unique(np.concatenate([used.laser.owner, used.sonar.owner])))  # type: ignore[union-attr]
    assert used.draw_start is not None
    np.testing.assert_array_equal(used.draw_start(np.random.default_rng(1)), used.start)


def test_odometry_needs_headings() -> None:
    with pytest.raises(InputError, match="no heading"):
        pose_model(drive(3, 1.0), None, None, ODOMETRY["wheels"])
