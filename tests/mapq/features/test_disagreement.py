"""How far scans disagree, on made-up scans of a room of which it is known by how much they are displaced."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.features import measure_shapes, patch_features
from mapq.features.copies import nearby_points
from mapq.features.disagreement import (
    MOST_IN_WINDOW,
    Disagreement,
    joined,
    known_of,
    measure_disagreement,
    moments_of,
    ways_of,
)
from mapq.kernels.scan_layers import NEAR_WIDTHS, Motions
from mapq.kernels.scan_motions import fit_motions
from mapq.kernels.scan_views import ENOUGH, OF_ERRORS, find_views, ranges_of_patches
from mapq.patches import Patches
from tests.mapq.factories import Rectangle, make_patches, moved, shuffled, turn, wall

NOISE, DENSITY, N_SCANS = 0.01, 14.0, 6
ROOM = [
    *(wall(*line, 3.0) for line in (((0, 0), (12, 0)), ((12, 0), (12, 8)), ((12, 8), (0, 8)), ((0, 8), (0, 0)))),
    wall((4, 2), (6, 3), 1.5),
    wall((6, 3), (5.5, 4), 1.5),
    wall((8, 5), (9, 6.5), 2.0),
    Rectangle((6.0, 4.0, 0.0), (1, 0, 0), (0, 1, 0), 12.0, 8.0),
]
MIDDLE = np.array([6.0, 4.0, 0.0])
BEFORE, BEHIND = (3.0, 6.0, 1.5), (10.0, 6.0, 1.5)


def scanned(shift=(0.0, 0.0), turned=0.0, n_scans=N_SCANS, faces=(), sensors=(BEFORE, BEFORE)) -> Patches:
    """Return the patches of a room, each wall seen by all scans; every second one shifted, and turned about its middle.

    Of `faces`, more surfaces, scans see every second one, as their sensors of two places do.
    """
    rng, points, scan = np.random.default_rng(0), [], []
    surfaces = [*ROOM, *faces]
    for number, surface in enumerate(surfaces):
        seen_by = range(n_scans) if number < len(ROOM) else range(number % 2, n_scans, 2)
        for k in seen_by:
            seen = surface.sample(rng, DENSITY, NOISE)
            if k % 2:
                seen = (seen - MIDDLE) @ turn(turned).T + MIDDLE + np.array([*shift, 0.0])[:3]
            points.append((number, seen))
            scan.append(np.full(len(seen), k))
    of = [np.vstack([seen for number, seen in points if number == i]) for i in range(len(surfaces))]
    patches = make_patches(of, [surface.axes[2] for surface in surfaces])
    moment = np.concatenate(scan)
    fields = {"scan": moment}
    if sensors:
        away = np.array(sensors)[moment % 2] - patches.cloud.xyz
        fields |= {f"to_sensor_{axis}": away[:, k] for k, axis in enumerate("xyz")}
    return replace(patches, cloud=patches.cloud.with_fields(**fields))


def with_moments(patches: Patches, **fields) -> Patches:
    """Return the patches with other fields than the scans to tell moments by."""
    kept = {name: values for name, values in patches.cloud.fields.items() if name != "scan"}
    return replace(patches, cloud=PointCloud(patches.cloud.xyz, patches.cloud.shift, kept | fields))


def measured(patches: Patches) -> Disagreement:
    shapes, number, known = measure_shapes(patches), np.flatnonzero(patches.cloud.finite()), known_of(patches.cloud)
    moments, away = moments_of(patches.cloud, number, known), ways_of(patches.cloud, number, known)
    if moments is None:
        return Disagreement.unknown(len(shapes))
    return measure_disagreement(nearby_points(patches, number, joined(patches, number, moments), away), shapes, NOISE)


def assert_metres(found: Disagreement, truth) -> None:
    """What noise may make, up to some centimetres, is taken away."""
    clear = truth > 0.06
    assert found.metres[clear] == pytest.approx(truth[clear], abs=0.02)
    assert (found.metres[~clear] <= truth[~clear] + 0.02).all()


def assert_bounds(found: Disagreement, truth) -> None:
    assert (found.low <= found.metres).all()
    assert (found.metres <= found.high).all()
    assert (found.low <= np.asarray(truth) + 1e-9).all()
    assert (np.asarray(truth) <= found.high).all()


SHIFTS = [(0.1, 0.0), (0.3, 0.0), (0.8, 0.0), (0.0, -0.8), (0.1, 0.3), (0.3, -0.2), (-0.8, 0.3)]
RISES = [(0.0, 0.0, 0.15), (0.0, 0.0, -0.6), (0.3, -0.2, 1.0), (0.8, 0.3, -0.2)]
"""Along the long walls, too: all but two walls agree then where they lie."""


@pytest.mark.parametrize("sensors", [(BEFORE, BEFORE), ()])
def test_scans_of_a_right_map_agree(sensors):
    found = measured(scanned(sensors=sensors))
    assert (found.metres < 0.02).all()
    assert (found.high < 0.05).all()
    assert_bounds(found, 0.0)
    assert (found.n_scans == N_SCANS).all()
    assert (found.shared > 0.95).all()


@pytest.mark.parametrize("sensors", [(BEFORE, BEFORE), ()])
@pytest.mark.parametrize("shift", SHIFTS + RISES)
def test_half_of_the_scans_shifted_is_found_along_each_normal(shift, sensors):
    patches = scanned(shift, sensors=sensors)
    truth = np.abs(patches.normal @ np.array([*shift, 0.0])[:3])
    found = measured(patches)
    assert_metres(found, truth)
    assert_bounds(found, truth)
    assert (found.high - found.low < 0.1).all()


@pytest.mark.parametrize("degrees", [2.0, -1.0])
def test_scans_turned_by_a_little_are_found_by_what_that_is_on_the_whole_patch(degrees):
    patches = scanned(turned=degrees)
    away = (patches.cloud.xyz - MIDDLE) @ (turn(degrees) - np.eye(3)).T
    along = np.einsum("ij,ij->i", away, patches.normal[patches.patch])
    truth = np.array([np.abs(np.mean(along[patches.patch == i])) for i in range(len(patches))])
    found = measured(patches)
    assert_metres(found, truth)
    assert_bounds(found, truth)


def test_one_scan_alone_and_unknown_scans_are_no_evidence():
    alone = measured(scanned(n_scans=1))
    unknown = measured(with_moments(scanned((0.1, 0.3))))
    assert all(np.isnan(column).all() for column in (*alone[:3], *unknown))
    assert (alone.n_scans == 1.0).all()
    assert (alone.shared == 0.0).all()
    features = patch_features(with_moments(scanned((0.1, 0.3))))
    assert np.isnan(features.disagreement).all()
    empty = make_patches([], [], loose=3)
    empty = replace(empty, cloud=empty.cloud.with_fields(scan=np.arange(3)))
    assert len(measured(empty).metres) == 0


@pytest.mark.parametrize("deep", [0.1, 0.25])
def test_both_faces_of_a_thin_wall_are_two_surfaces(deep):
    faces = [wall((7, 0.5), (7, 7.5), 3.0), wall((7 + deep, 0.5), (7 + deep, 7.5), 3.0)]
    found = measured(scanned(faces=faces, sensors=(BEFORE, BEHIND)))
    assert (found.metres[[0, 1, 2, 3, -2, -1]] < 0.02).all()
    assert found.n_scans[-2:].tolist() == [N_SCANS / 2] * 2
    shifted = measured(scanned((0.3, 0.0), faces=faces, sensors=(BEFORE, BEHIND)))
    assert shifted.metres[[1, 3]] == pytest.approx([0.3, 0.3], abs=0.02)
    assert (shifted.metres[-2:] < 0.02).all(), "each was seen by scans that agree"


def test_scans_times_and_passes_tell_alike():
    patches = scanned((0.1, 0.3))
    scan = patches.cloud.fields["scan"]
    truth = np.abs(patches.normal @ [0.1, 0.3, 0.0])
    # Rows of a scan come in the order of time; half of it lies in another moment than the rest.
    within = np.random.default_rng(1).uniform(0.0, 20.0, len(scan))
    told = [
        measured(with_moments(patches, **{name: values}))
        for name, values in (("scan", scan), ("time", 20.0 * scan + within), ("pass_id", scan % 2))
    ]
    for each in told:
        assert_metres(each, truth)
        assert_bounds(each, truth)
    assert [each.n_scans[0] for each in told] == [N_SCANS, pytest.approx(2 * N_SCANS, abs=1), 2]


def test_points_seconds_apart_make_no_more_scans_than_can_be_solved_for():
    patches = scanned()
    time = 5.0 * np.random.default_rng(2).permutation(len(patches.cloud))
    patches = with_moments(patches, time=time)
    number = np.arange(len(time))
    moments = moments_of(patches.cloud, number, known_of(patches.cloud))
    assert moments.max() > 10 * MOST_IN_WINDOW
    assert 0.5 * MOST_IN_WINDOW < joined(patches, number, moments).max() < 1.1 * MOST_IN_WINDOW


@pytest.mark.parametrize("change", ["order", "shift", "far", "signs", "numbers"])
@pytest.mark.parametrize("kind", [{"shift": (0.3, -0.2)}, {"turned": 2.0}])
def test_order_shifts_signs_and_numbers_do_not_matter(kind, change):
    patches = scanned(**kind)
    number = np.random.default_rng(1).permutation(len(patches)) if change == "numbers" else np.arange(len(patches))
    if change == "order":
        other = shuffled(patches, 3)
    elif change == "shift":
        other = moved(patches, np.eye(3), (0.37, -2.21, 0.11))
    elif change == "far":
        away = np.array([1.2e5, -3.4e5, 50.0])
        cloud = PointCloud.from_world(patches.cloud.world() + away, patches.cloud.fields)
        other = replace(patches, cloud=cloud, centroid=patches.centroid + away - cloud.shift)
    elif change == "signs":
        other = replace(patches, normal=patches.normal * np.where(np.arange(len(patches)) % 3 == 1, -1.0, 1.0)[:, None])
    else:
        place = np.argsort(number)
        other = replace(
            patches,
            patch=place[patches.patch].astype(np.int32),
            normal=patches.normal[number],
            centroid=patches.centroid[number],
        )
    one, two = measured(patches), measured(other)
    for name, values, expected in zip(one._fields, two, one, strict=True):
        # Bins of heights are open at one side, which is the other one where normals point the other way.
        exactly = {"rtol": 0.0, "atol": {"order": 0.0, "signs": 2e-3}.get(change, 1e-6)}
        np.testing.assert_allclose(values, expected[number], err_msg=name, **exactly)


def slow_fit(cell, scan, jacobian, height, weight, n_scans, precision, finest):
    """Least squares with the relief of each cell as one more unknown, weighed anew in five rounds."""
    reliefs, robust, scale = np.eye(cell.max() + 1)[cell], np.ones(len(cell)), 0.2
    rows = np.zeros((len(cell), 6 * n_scans))
    for row, (k, j) in enumerate(zip(scan, jacobian, strict=True)):
        rows[row, 6 * k : 6 * k + 6] = j
    for turned in range(5):
        root = np.sqrt(weight * robust)[:, None]
        prior = np.diag(np.sqrt(np.tile(precision, n_scans)))
        design = np.vstack([np.hstack([rows, reliefs]) * root, np.pad(prior, ((0, 0), (0, reliefs.shape[1])))])
        wanted = np.concatenate([height * root[:, 0], np.zeros(6 * n_scans)])
        found = np.linalg.lstsq(design, wanted, rcond=None)[0]
        residual = height - np.hstack([rows, reliefs]) @ found
        scale = 0.2 if turned == 0 else max(0.5 * scale, finest)
        robust = (scale**2 / (scale**2 + residual**2)) ** 2
    covariance = np.linalg.inv(design.T @ design)[: 6 * n_scans, : 6 * n_scans]
    return found[: 6 * n_scans].reshape(n_scans, 6), covariance, residual, robust


@pytest.mark.parametrize("seed", range(4))
def test_motions_are_those_of_least_squares_with_relief_as_unknowns(seed):
    rng, n_scans, n_cells, n_rows = np.random.default_rng(seed), 4, 30, 90
    cell = np.sort(np.concatenate([np.arange(n_cells), rng.integers(0, n_cells, n_rows - n_cells)]))
    scan, jacobian = rng.integers(0, n_scans, n_rows), rng.normal(size=(n_rows, 6))
    truth = 0.05 * rng.normal(size=(n_scans, 6))
    height = np.einsum("ij,ij->i", jacobian, truth[scan]) + rng.normal(size=n_cells)[cell] + rng.normal(0, 0.01, n_rows)
    height[rng.random(n_rows) < 0.1] += 0.5
    weight, precision = rng.uniform(0.5, 2.0, n_rows) * 1e4, rng.uniform(10.0, 1000.0, 6)
    first = np.append(np.flatnonzero(np.diff(cell, prepend=-1)), n_rows)
    motion, normal, residual, robust = fit_motions(first, scan, jacobian, height, weight, n_scans, precision, 0.03)
    expected = slow_fit(cell, scan, jacobian, height, weight, n_scans, precision, 0.03)
    np.testing.assert_allclose(motion, expected[0], atol=1e-9)
    np.testing.assert_allclose(np.linalg.inv(normal), expected[1], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(residual, expected[2], atol=1e-9)
    np.testing.assert_allclose(robust, expected[3], atol=1e-7)


def with_points(patches: Patches, xyz, scan: int, patch: int) -> Patches:
    """Return the patches with more points of a patch, seen by a scan."""
    cloud, n = patches.cloud, len(xyz)
    fields = {name: np.concatenate([values, np.zeros(n, values.dtype)]) for name, values in cloud.fields.items()}
    fields["scan"][-n:] = scan
    number = np.concatenate([patches.patch, np.full(n, patch, np.int32)])
    return replace(patches, cloud=PointCloud(np.vstack([cloud.xyz, xyz]), cloud.shift, fields), patch=number)


def without_scan(patches: Patches, scan: int, patch: int, but: int) -> Patches:
    """Return the patches less the points of a scan on a patch, but for some in its middle."""
    cloud = patches.cloud
    its = np.flatnonzero((patches.patch == patch) & (cloud.fields["scan"] == scan))
    middle = np.argsort(np.linalg.norm(cloud.xyz[its] - np.median(cloud.xyz[its], axis=0), axis=1))
    kept = np.setdiff1d(np.arange(len(cloud)), its[middle[but:]])
    fields = {name: values[kept] for name, values in cloud.fields.items()}
    return replace(patches, cloud=PointCloud(cloud.xyz[kept], cloud.shift, fields), patch=patches.patch[kept])


def only_last_shifted(shift: float) -> Patches:
    """Return a right room but for its last scan, that is shifted along x."""
    patches = scanned(sensors=())
    xyz = patches.cloud.xyz + np.where(patches.cloud.fields["scan"] == N_SCANS - 1, shift, 0.0)[:, None] * [1.0, 0, 0]
    return replace(patches, cloud=PointCloud(xyz, patches.cloud.shift, patches.cloud.fields))


def test_a_whole_scan_that_lies_apart_counts_and_stray_points_within_a_scan_do_not():
    whole = measured(only_last_shifted(0.3))
    assert whole.metres[[1, 3]] == pytest.approx([0.3, 0.3], abs=0.02)
    patches = scanned(sensors=())
    on = patches.cloud.xyz[(patches.patch == 1) & (patches.cloud.fields["scan"] == 2)]
    stray = measured(with_points(patches, on[::4] + np.array([0.3, 0.0, 0.0]), 2, 1))
    assert stray.metres[1] < 0.02
    assert stray.high[1] < 0.05


@pytest.mark.parametrize(("left", "counts"), [(0, False), (3, False), (12, True), (40, True)])
def test_a_scan_counts_from_ten_points_on_the_patch(left, counts):
    found = measured(without_scan(only_last_shifted(0.3), N_SCANS - 1, 1, left))
    assert found.n_scans[1] == N_SCANS - 1 + counts
    assert found.metres[1] == pytest.approx(0.3 if counts else 0.0, abs=0.02)
    assert found.low[1] <= (0.3 if counts else 0.0) <= found.high[1]
    assert (found.high[1] < 0.05) == (left <= 3)
    assert (found.low[1] > 0.2) == (left == 40)
    assert found.metres[3] == pytest.approx(0.3, abs=0.02), "the other wall across is seen by all"


@pytest.mark.parametrize("seed", range(3))
def test_views_are_those_by_their_definition(seed):
    rng, width = np.random.default_rng(seed), 0.03
    patches = scanned((0.1, 0.0), sensors=())
    shapes, number = measure_shapes(patches), np.arange(len(patches.cloud))
    scan = patches.cloud.fields["scan"]
    nearby = nearby_points(patches, number, scan.astype(np.int64), None)
    shift = np.where(np.arange(N_SCANS) % 2, 0.1, 0.0)[:, None] * [1.0, 0, 0] + rng.normal(0, 0.005, (N_SCANS, 3))
    owner, centre = np.zeros(len(shapes), np.int64), np.zeros((1, 3))
    motion = np.hstack([shift, np.zeros((N_SCANS, 3))])
    motions = Motions(owner, centre, np.array([0, N_SCANS]), np.arange(N_SCANS), motion)
    about = (nearby, shapes.sheets, shapes.planes, shapes.points, shapes.start, shapes.spacing)
    views, several = find_views(*about, motions, width)
    assert (several > 0.95).all()
    for patch in range(4):
        # Far from other surfaces; a wall has few points of others over it, at its ends.
        own = patches.patch == patch
        moved = patches.cloud.xyz[own] - shift[scan[own]]
        height = moved @ patches.normal[patch]
        off = height - np.median(height)
        near = np.abs(off) <= NEAR_WIDTHS * width
        mine = views[views[:, 0] == patch]
        assert mine[:, 1].tolist() == list(range(N_SCANS))
        for row, k in zip(mine, range(N_SCANS), strict=True):
            its = near & (scan[own] == k)
            assert row[7] == pytest.approx(its.sum(), rel=0.05)
            assert row[2:5] == pytest.approx(patches.cloud.xyz[own][its].mean(axis=0), abs=0.2)
            assert row[5] == pytest.approx(off[its].mean(), abs=0.003)
            assert row[6] == pytest.approx(off[its].var(), rel=0.2)


def slow_range(offset, covariance, alike):
    """Range of offsets (n) of a covariance (n, n), drawn together first, and its variance."""
    n = len(offset)
    about = np.eye(n) - 1.0 / n
    scale = alike**2 + OF_ERRORS * np.median(np.diag(about @ covariance @ about)) * n / (n - 1)
    weight = np.exp(-0.5 * np.subtract.outer(offset, offset) ** 2 / scale)
    drawn = weight @ offset / weight.sum(axis=1)
    row = np.zeros(n)
    row[drawn.argmax()], row[drawn.argmin()] = 1.0, -1.0
    return np.ptp(drawn), row @ covariance @ row


@pytest.mark.parametrize("seed", range(4))
def test_ranges_of_patches_are_those_by_their_definition(seed):
    rng, n_scans, alike, least = np.random.default_rng(seed), 6, 0.05, np.array([30.0, ENOUGH, 5.0])
    first = np.array([0, 6, 7, 11, 11])
    scan = np.concatenate([rng.permutation(6), [2], rng.permutation(6)[:4]])
    n_points = rng.integers(1, 60, len(scan)).astype(float)
    jacobian, motion = rng.normal(size=(len(scan), 6)), 0.1 * rng.normal(size=(n_scans, 6))
    root = 0.02 * rng.normal(size=(6 * n_scans, 6 * n_scans))
    covariance = root @ root.T
    found = ranges_of_patches(first, scan, n_points, jacobian, motion, covariance, least, alike)
    assert found.shape == (4, 3, 3)
    for patch, (begin, end) in enumerate(itertools.pairwise(first)):
        for place, fewest in enumerate(least):
            rows = begin + np.flatnonzero(n_points[begin:end] >= fewest)
            assert found[patch, place, 2] == len(rows)
            if len(rows) < 2:
                assert found[patch, place, :2].tolist() == [0.0, 0.0]
                continue
            spread = np.zeros((len(rows), 6 * n_scans))
            for row, k in zip(spread, rows, strict=True):
                row[6 * scan[k] : 6 * scan[k] + 6] = jacobian[k]
            expected = slow_range(spread @ motion.ravel(), spread @ covariance @ spread.T, alike)
            assert found[patch, place, :2] == pytest.approx(expected)
