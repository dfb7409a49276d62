"""How far scans disagree, on made-up scans of a room of which it is known by how much they are displaced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.features import measure_shapes, patch_features
from mapq.features.copies import nearby_points
from mapq.features.disagreement import (
    Disagreement,
    expected_range,
    joined,
    known_of,
    measure_disagreement,
    moments_of,
    ways_of,
)
from mapq.kernels.scan_motions import fit_motions, ranges_of_cells
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
                seen = (seen - MIDDLE) @ turn(turned).T + MIDDLE + np.array([*shift, 0.0])
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
@pytest.mark.parametrize("shift", SHIFTS)
def test_half_of_the_scans_shifted_is_found_along_each_normal(shift, sensors):
    patches = scanned(shift, sensors=sensors)
    truth = np.abs(patches.normal @ np.array([*shift, 0.0]))
    found = measured(patches)
    assert_metres(found, truth)
    assert_bounds(found, truth)
    assert (found.high - found.low < 0.1).all()


@pytest.mark.parametrize("degrees", [2.0, -1.0])
def test_scans_turned_by_a_little_are_found_cell_by_cell(degrees):
    patches = scanned(turned=degrees)
    away = (patches.cloud.xyz - MIDDLE) @ (turn(degrees) - np.eye(3)).T
    along = np.abs(np.einsum("ij,ij->i", away, patches.normal[patches.patch]))
    truth = np.array([np.median(along[patches.patch == i]) for i in range(len(patches))])
    found = measured(patches)
    assert_metres(found, truth)
    assert_bounds(found, truth)


def test_one_scan_alone_and_unknown_scans_are_no_evidence():
    alone = measured(scanned(n_scans=1))
    unknown = measured(with_moments(scanned((0.1, 0.3))))
    assert all(np.isnan(column).all() for column in (*alone, *unknown))
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


@pytest.mark.parametrize("seed", range(4))
def test_ranges_of_cells_are_those_by_their_definition(seed):
    rng, n_scans, n_rows, reach = np.random.default_rng(seed), 4, 40, 1.0
    cell = np.concatenate([np.arange(12), rng.integers(0, 12, n_rows - 12)])
    scan, jacobian = rng.integers(0, n_scans, n_rows), rng.normal(size=(n_rows, 6))
    place, motion = (
        rng.uniform(0.0, 3.0, (12, 3))[cell] + rng.normal(0, 0.1, (n_rows, 3)),
        rng.normal(size=(n_scans, 6)),
    )
    root = rng.normal(size=(6 * n_scans, 6 * n_scans))
    covariance = root @ root.T
    found = ranges_of_cells(cell, scan, place, jacobian, motion, covariance, reach)
    assert found.shape == (12, 3)
    for c in range(12):
        near = np.linalg.norm(place - place[cell == c].mean(axis=0), axis=1) < reach
        means = {k: jacobian[near & (scan == k)].mean(axis=0) for k in np.unique(scan[near])}
        held = {k: float(mean @ motion[k]) for k, mean in means.items()}
        assert found[c, 2] == len(held)
        if len(held) < 2:
            assert found[c, :2].tolist() == [0.0, 0.0]
            continue
        low, high = min(held, key=held.get), max(held, key=held.get)
        row = np.zeros((n_scans, 6))
        row[high], row[low] = means[high], -means[low]
        assert found[c, 0] == pytest.approx(held[high] - held[low])
        assert found[c, 1] == pytest.approx(row.ravel() @ covariance @ row.ravel())


@pytest.mark.parametrize("n", [2, 3, 8, 32, 1000])
def test_the_range_that_noise_makes(n):
    drawn = np.ptp(np.random.default_rng(0).normal(size=(2000, n)), axis=1).mean()
    assert expected_range(n) == pytest.approx(drawn, rel=0.06)
    assert expected_range(1) == expected_range(0) == 0.0
