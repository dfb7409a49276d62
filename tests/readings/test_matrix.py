"""Ranges alone, a row a scan, with poses of a file, and odometry of another."""

from __future__ import annotations

import numpy as np
import pytest

from prf.configuration import ODOMETRY, Configuration
from prf.poses.model import pose_model
from prf.readings import read_readings
from prf.sampler.prepare import given_poses, read_configured
from prf.shell.errors import ArgumentError, ConfigError, InputError
from tests.readings.samples import flaser, save

ANGLES = "-90:22.5:90"
RANGES = np.arange(36.0).reshape(4, 9) + 1.0
WAY = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [2.0, 0.5, 1.0], [2.0, 1.5, 1.5]])


def rows(values, mark="\t"):
    return "".join(mark.join(f"{value:.17g}" for value in row) + "\n" for row in values)


def configured(tmp_path, ranges=RANGES, way=WAY, **changes):
    values = {"poses": save(tmp_path, rows(way), "way.txt"), "beam_angles": ANGLES, **changes}
    found = read_configured(Configuration.of(**values), [save(tmp_path, rows(ranges), "ranges.txt")])[0]
    assert found is not None
    return found


@pytest.mark.parametrize("mark", ["\t", " ", ", ", ";"])
def test_rows_are_scans_and_columns_beams(tmp_path, mark):
    [poses] = given_poses(Configuration.of(poses=save(tmp_path, rows(WAY, mark), "way.txt")).readings)
    found = read_readings(save(tmp_path, rows(RANGES, mark)), poses=poses, beam_angles=ANGLES)
    np.testing.assert_array_equal(found.range, RANGES.ravel())
    np.testing.assert_array_equal(found.scan, np.repeat(np.arange(4), 9))
    np.testing.assert_allclose(found.origin, np.repeat(WAY[:, :2], 9, axis=0))
    directions = np.tile(np.linspace(-np.pi / 2, np.pi / 2, 9), 4) + np.repeat(WAY[:, 2], 9)
    np.testing.assert_allclose(np.exp(1j * found.angle), np.exp(1j * directions))
    assert found.notes.format == "ranges"


def test_an_array_of_numpy_and_a_zipped_text(tmp_path):
    np.save(tmp_path / "ranges.npy", RANGES)
    [poses] = given_poses(Configuration.of(poses=save(tmp_path, rows(WAY), "way.txt")).readings)
    for path in (str(tmp_path / "ranges.npy"), save(tmp_path, rows(RANGES), "ranges.gz", zipped=True)):
        np.testing.assert_array_equal(read_readings(path, poses=poses, beam_angles=ANGLES).range, RANGES.ravel())


def test_no_measurement_is_dropped_and_counted(tmp_path):
    ranges = RANGES.copy()
    ranges[0, 0], ranges[1, 1], ranges[2, 2] = 0.0, np.nan, np.inf
    found = configured(tmp_path, ranges)
    assert (found.n_beams, found.notes.n_zero_ranges, found.notes.n_invalid) == (34, 1, 1)
    assert np.isinf(found.range).sum() == 1


@pytest.mark.parametrize(
    ("angles", "degrees"),
    [("-90:1:89", 180), ("-135:0.25:135", 1081), ("0:-1:-10", 11), ("-90:0.36:90", 501), ("-1:0.3:0.05", 4)],
)
def test_directions_go_on_to_the_last_one_that_steps_meet(tmp_path, angles, degrees):
    found = configured(tmp_path, np.ones((4, degrees)), beam_angles=angles)
    first, step, _ = map(float, angles.split(":"))
    np.testing.assert_allclose(np.degrees(found.angle[:degrees]), first + step * np.arange(degrees), atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"beam_angles": "-90:1:90"}, "ranges.txt: 9 ranges a row, but --beam-angles -90:1:90 are 181 directions"),
        ({"beam_angles": "-90:0:90"}, "--beam-angles -90:0:90: must be FIRST:STEP:LAST in degrees"),
        ({"beam_angles": "90:1:-90"}, "must be FIRST:STEP:LAST"),
        ({"beam_angles": "a:b"}, "must be FIRST:STEP:LAST"),
        (
            {"beam_angles": None},
            "numbers alone, 9 a row. If these are the ranges of 4 scans, say where the beams point",
        ),
        ({"poses": None}, "ranges alone have no poses. Give them with --poses FILE"),
        ({"way": WAY[:3]}, "has 4 scans, .*way.txt 3 poses"),
        ({"ranges": -RANGES}, "ranges.txt:1: range is -1"),
        ({"ranges": 0.0 * RANGES}, "no range is above 0"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, changes, message):
    with pytest.raises((ConfigError, InputError), match=message):
        configured(tmp_path, **changes)


def test_rows_that_differ_are_refused_with_their_line(tmp_path):
    [poses] = given_poses(Configuration.of(poses=save(tmp_path, rows(WAY), "way.txt")).readings)
    for text, message in (
        (rows(RANGES[:2]) + "1 2 3\n", "ranges.txt:3: 3 ranges, but 9 before"),
        (rows(RANGES[:2]) + "1 2 3 4 5 6 7 8 x\n", "ranges.txt:3: a range is not a number"),
    ):
        with pytest.raises(InputError, match=message):
            read_readings(save(tmp_path, text, "ranges.txt"), poses=poses, beam_angles=ANGLES)


def test_a_log_with_directions_needs_none(tmp_path):
    with pytest.raises(ConfigError, match=r"have directions of their own\. Leave it out"):
        read_readings(save(tmp_path, flaser([1, 2, 3])), beam_angles=ANGLES)


# Odometry of a file of its own.


def test_steps_are_those_of_the_odometry_and_poses_those_of_their_file(tmp_path):
    odometry = WAY + np.array([5.0, -3.0, 0.0]) + np.arange(4)[:, None] * [0.01, 0.0, 0.02]
    file = save(tmp_path, rows(odometry), "odometry.txt")
    found = configured(tmp_path, odometry_file=file, odometry="wheels")
    model = pose_model(found, None, (0.1, 0.02), ODOMETRY["wheels"])
    np.testing.assert_allclose(model.prior.given, WAY, atol=1e-12)
    alone = pose_model(configured(tmp_path, way=odometry), None, None, ODOMETRY["wheels"])
    np.testing.assert_allclose(model.prior.motion, alone.prior.motion, atol=1e-12)
    np.testing.assert_allclose(model.prior.spread, alone.prior.spread, atol=1e-12)
    rows_used = np.flatnonzero(found.scan != 1)
    used = model.used(rows_used, np.zeros(0, np.int64))
    assert len(used.prior.motion) == 2
    np.testing.assert_allclose(used.prior.motion[1], model.prior.motion[2], atol=1e-12)


def test_a_file_of_odometry_alone_gives_the_poses_too(tmp_path):
    found = configured(tmp_path, poses=None, odometry_file=save(tmp_path, rows(WAY), "odometry.txt"), odometry="poor")
    np.testing.assert_allclose(found.notes.scans.pose, WAY, atol=1e-12)


def test_how_far_a_file_of_odometry_errs_must_be_said(tmp_path):
    with pytest.raises(ArgumentError, match=r"how far odometry errs is not given\. Add --odometry"):
        configured(tmp_path, odometry_file=save(tmp_path, rows(WAY), "odometry.txt"))
