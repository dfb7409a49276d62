"""Context: what looks like an error of the map, told from what is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.cloud import PointCloud
from mapq.configuration import CONTEXTS, FeatureSettings
from mapq.features import measure_shapes, patch_features
from mapq.features.context import EDGE_COLUMNS, NODE_COLUMNS
from mapq.features.copies import (
    COLUMNS,
    FARTHEST,
    TURNS,
    copy_columns,
    nearby_points,
    tiles_of,
)
from mapq.features.disagreement import known_of, moments_of
from mapq.features.pairs import EDGE_NAMES
from mapq.features.shape import NODE_NAMES, PatchShapes
from mapq.kernels.layers_over import RIM, layers_over, outline_match, thinness
from mapq.labels import NO_PATCH
from mapq.patches import Patches
from tests.mapq.factories import always_known, make_patches, moved, sample_patches, shuffled, turn, wall
from tests.reference.mapq_features import point_gaps

DENSITY, NOISE = 60.0, 0.01


def seen(patches: Patches, sensors, passes, times=None) -> Patches:
    """Return the patches with passes, times and the way to the sensor of each patch."""
    sensor = np.asarray(sensors, np.float64)[patches.patch]
    way = (sensor - patches.cloud.xyz).astype(np.float32)
    fields = {f"to_sensor_{axis}": way[:, k] for k, axis in enumerate("xyz")}
    fields["pass_id"] = np.asarray(passes, np.int16)[patches.patch]
    if times is not None:
        fields["time"] = np.asarray(times, np.float64)[patches.patch] + np.arange(len(patches.patch)) % 13
    return replace(patches, cloud=patches.cloud.with_fields(**fields))


def pair(patches: Patches, i: int = 0, j: int = 1, **settings) -> dict[str, float]:
    """Return the edge features of a pair, context divided by the conflict that it explains."""
    found = patch_features(patches, FeatureSettings(**settings))
    (row,) = np.flatnonzero((found.pairs == (i, j)).all(axis=1))
    values = dict(zip(found.edge_names, found.edge[row].tolist(), strict=True))
    conflict = max(1.0 - found.plausibility[row], 1e-12)
    return {name: value / conflict if name in found.context_names else value for name, value in values.items()}


DOUBLE = [wall((0, 2), (10, 2)), wall((0, 2.4), (10, 2.4))]
FENCE = [wall((0, 2), (10, 2), 6.0), wall((2, 1.5), (7, 1.5), 1.2)]


class TestOutlines:
    def test_a_fence_covers_little_of_the_facade_behind_it(self):
        fence, double = (pair(sample_patches(walls, 1, DENSITY, NOISE)) for walls in (FENCE, DOUBLE))
        assert fence["overlap"] > 0.7
        assert fence["partly_covered"] > 0.8
        assert double["partly_covered"] < 0.25
        assert fence["unlike_height"] == pytest.approx(0.8, abs=0.05)
        assert double["unlike_height"] < 0.05


class TestMoments:
    def test_scans_outrank_times_and_times_passes(self):
        cloud = seen(sample_patches(DOUBLE, 1, DENSITY, NOISE), [(5, -5, 1)] * 2, [0, 1]).cloud
        assert known_of(cloud).moment == "pass_id"
        cloud = cloud.with_fields(time=np.linspace(0, 12, len(cloud)))
        assert known_of(cloud).moment == "time"
        assert known_of(cloud.with_fields(scan=np.zeros(len(cloud), np.int32))).moment == "scan"

    @pytest.mark.parametrize(
        "fields",
        [
            {},
            {"pass_id": np.zeros(10)},
            {"pass_id": np.full(10, 0.5)},
            {"time": np.linspace(0, 0.1, 10)},
            {"time": np.full(10, np.nan)},
            {"scan": np.zeros((10, 2))},
        ],
    )
    def test_fields_without_information_are_ignored(self, fields):
        cloud = PointCloud(np.zeros((10, 3)), np.zeros(3), fields)
        assert moments_of(cloud, np.arange(10), known_of(cloud)) is None


class TestGroups:
    def test_each_can_be_measured_alone(self):
        patches = sample_patches(FENCE, 1, 20.0, NOISE)
        every = patch_features(patches)
        for name in CONTEXTS:
            one = patch_features(patches, FeatureSettings(context=(name,)))
            assert one.edge_names == (*EDGE_NAMES, *EDGE_COLUMNS.get(name, ()))
            assert one.node_names == (*NODE_NAMES, *NODE_COLUMNS.get(name, ()))
            assert one.context_names == EDGE_COLUMNS.get(name, ())
            for column in EDGE_COLUMNS.get(name, ()):
                np.testing.assert_array_equal(
                    one.edge[:, one.edge_names.index(column)], every.edge[:, every.edge_names.index(column)]
                )

    @pytest.mark.parametrize("walls", [[], DOUBLE[:1]])
    def test_maps_without_pairs(self, walls):
        patches = sample_patches(walls, 1, 20.0, NOISE) if walls else make_patches([], np.empty((0, 3)), loose=3)
        way = np.ones((len(patches.cloud), 3))
        fields = {f"to_sensor_{axis}": way[:, k] for k, axis in enumerate("xyz")}
        patches = replace(patches, cloud=patches.cloud.with_fields(**fields, pass_id=np.arange(len(way)) % 2))
        found = patch_features(patches)
        assert found.edge.shape == (0, len(found.edge_names))
        assert np.isfinite(always_known(found)).all()


# Copies of surfaces by points alone, on made-up walls.


DENSITY, NOISE = 60.0, 0.01
PLAN = [((0, 0), (8, 0)), ((8, 0), (8, 6)), ((0, 6), (8, 6)), ((0, 0), (0, 6))]
ROOM = [wall(*line) for line in PLAN]


def columns(patches: Patches, settings: FeatureSettings | None = None) -> dict[str, np.ndarray]:
    number = np.flatnonzero(patches.cloud.finite())
    near = nearby_points(patches, number, np.zeros(len(number), np.int64), None)
    return copy_columns(near, measure_shapes(patches), settings or FeatureSettings())


def loosened(patches: Patches, first: int) -> Patches:
    """Return the patches without those from number `first` on, whose points are in none."""
    patch = np.where(patches.patch < first, patches.patch, NO_PATCH).astype(np.int32)
    return Patches.unlabelled(patches.cloud, patch, patches.normal[:first], patches.centroid[:first], {}, {})


def doubled(by: tuple[float, float]):
    """Return the walls of a room, and all of them again."""
    return [*ROOM, *(wall(*(tuple(np.add(corner, by)) for corner in line)) for line in PLAN)]


STEP = 0.025


def layers_at(patches: Patches, off: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return cover, thinness and outline match (m,) of the layer so far off each patch, the fuller of either side."""
    shapes, number = measure_shapes(patches), np.flatnonzero(patches.cloud.finite())
    near = nearby_points(patches, number, np.zeros(len(number), np.int64), None)
    n_slices, tiles = 2 * int(np.ceil(FARTHEST / STEP)), tiles_of(shapes, STEP)
    given = near, shapes.sheets, shapes.planes, shapes.points, shapes.start, tiles
    found = layers_over(*given, STEP, n_slices, np.zeros(1))
    middle, away, rows = n_slices // 2 - 1, round(off / STEP), tiles.row[:-1]
    cover = found.cover[rows]
    at = np.where(cover[:, middle + away] > cover[:, middle - away], middle + away, middle - away)
    measures = found.cover, thinness(found.n_points), outline_match(found, tiles)
    return tuple(np.add.reduceat(each[rows, at], tiles.first[:-1]) / np.diff(tiles.first) for each in measures)


class TestSecondLayer:
    @pytest.mark.parametrize("density", [15.0, 60.0, 400.0])
    @pytest.mark.parametrize("loose", [False, True])
    def test_a_copy_covers_is_thin_and_ends_where_the_wall_ends(self, density, loose):
        patches = sample_patches([wall((0, 2), (10, 2)), wall((0, 2.4), (10, 2.4))], 1, density, NOISE)
        cover, thin, outline = layers_at(loosened(patches, 1) if loose else patches, 0.4)
        assert cover[0] > 0.75
        assert thin[0] > 0.95
        assert outline[0] > 0.6

    def test_clutter_is_not_thin(self):
        rng = np.random.default_rng(1)
        bush = rng.uniform((0, 2.2, 0), (10, 3.4, 3), (9000, 3))
        points = wall((0, 2), (10, 2)).sample(rng, DENSITY, NOISE)
        _, thin, _ = layers_at(loosened(make_patches([points, bush], [(0, 1, 0)] * 2), 1), 0.6)
        assert thin[0] < 0.3

    def test_a_wall_goes_on_behind_a_fence_and_a_copy_where_its_surface_does(self):
        whole, fence = wall((0, 2), (10, 2)), wall((2, 2.4), (5, 2.4), 1.2)
        _, _, outline = layers_at(sample_patches([whole, fence], 1, DENSITY, NOISE), 0.4)
        assert outline[1] < 0.4, "on three of four sides"
        pieces = [wall((x, y), (x + 3.3, y)) for y in (2.0, 2.4) for x in (0.0, 3.35, 6.7)]
        _, _, outline = layers_at(sample_patches(pieces, 1, DENSITY, NOISE), 0.4)
        assert outline.min() > 0.6


class TestShift:
    def test_one_turn_explains_the_copies_of_long_walls(self):
        corners = [((0, 0), (12, 0)), ((12, 0), (12, 8)), ((0, 8), (12, 8)), ((0, 0), (0, 8))]
        turned = [tuple((turn(4.0)[:2, :2] @ corner + (0.3, -0.2)).tolist() for corner in line) for line in corners]
        one, both = ([wall(*line) for line in lines] for lines in (corners, corners + turned))
        one, both = (columns(sample_patches(walls, 1, DENSITY, NOISE)) for walls in (one, both))
        assert both["shift_support"].min() > 0.2
        assert one["shift_support"].max() < 0.5 * both["shift_support"].min()

    def test_one_motion_explains_the_copies_of_all_walls(self):
        patches = sample_patches(doubled((0.4, 0.3)), 1, DENSITY, NOISE)
        for found in (columns(patches), columns(loosened(patches, 4))):
            assert found["shift_length"] == pytest.approx(0.5, abs=0.1)
            assert (found["shift_support"] > 0.5).all()

    def test_two_faces_of_a_thin_wall_are_no_motion_of_the_room(self):
        thin = [*ROOM, wall((0.1, 3.0), (7.9, 3.0)), wall((0.1, 3.2), (7.9, 3.2))]
        one, all_ = (columns(sample_patches(walls, 1, DENSITY, NOISE)) for walls in (thin, doubled((0.4, 0.3))))
        assert one["shift_own"][4:].min() > 0.5
        assert one["shift_support"].max() < 0.75 * all_["shift_support"].min()
        assert one["shift_clear"].max() < 0.75 * all_["shift_clear"].min()
        assert one["shift_others"][4:].max() < 0.1 < 0.3 < all_["shift_others"].min()

    @pytest.mark.parametrize("loose", [False, True])
    def test_a_rise_explains_the_copies_of_floors_and_not_those_of_walls(self, loose):
        rng = np.random.default_rng(1)
        floors = [rng.uniform((x, 0, z), (x + 4, 6, z + 0.01), (2000, 3)) for z in (0.0, 0.6) for x in (0, 4)]
        walls = [line.sample(rng, DENSITY, NOISE) for line in ROOM[:2]]
        normals = [(0, 0, 1), (0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0, 1), (0, 0, 1)]
        patches = make_patches([*floors[:2], *walls, *floors[2:]], normals)
        found = columns(loosened(patches, 4) if loose else patches)
        assert found["shift_length"][:2] == pytest.approx(0.6, abs=0.1)
        assert found["shift_along"][:2] == pytest.approx(0.6, abs=0.1)
        assert found["shift_own"][:2].min() > 0.6
        assert found["shift_own"][2:4].max() < 0.2
        assert np.isnan(found["shift_others"][:2]).all()  # no level surface but the copies


def test_no_patches_have_no_columns_and_coarse_noise_leaves_them_unknown():
    empty = make_patches([], [])
    assert {len(values) for values in columns(empty).values()} == {0}
    patches = sample_patches(ROOM, 1, DENSITY, NOISE)
    found = columns(patches, FeatureSettings(noise=0.5))
    assert all(np.isnan(values).all() for values in found.values())


@pytest.mark.parametrize("change", ["order", "shift", "signs", "turn"])
def test_order_shift_signs_and_turns_do_not_matter(change):
    patches = sample_patches(doubled((0.4, 0.3)), 1, DENSITY, NOISE)
    patches = loosened(patches, 6)
    other = {
        "order": lambda: shuffled(patches),
        "shift": lambda: moved(patches, np.eye(3), (12.3, -7.7, 3.1)),
        "signs": lambda: replace(patches, normal=patches.normal * np.array([[1], [-1], [-1], [1], [-1], [1]])),
        "turn": lambda: moved(patches, turn(37.0)),
    }[change]()
    expected, found = columns(patches), columns(other)
    for name in COLUMNS:
        assert found[name] == pytest.approx(expected[name], abs=0.05 if change == "signs" else 1e-6), name


def share_from_either_end(cells: np.ndarray, size: np.ndarray, n_tiles: np.ndarray) -> np.ndarray:
    """Return the tile of each cell, across and along, by the middle of the cell; mirrored in the upper half."""
    nearer = np.minimum(cells, size - 1 - cells)
    lower = np.floor((nearer + 0.5) / size * n_tiles).astype(int)
    return np.where(cells == nearer, lower, n_tiles - 1 - lower)


@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_layers_agree_with_the_definition(slope):
    """Each layer of each tile against each point, without voxels."""
    patches = loosened(sample_patches([*doubled((0.4, 0.3)), wall((2, 1), (6, 1), 1.2)], 1, 25.0, NOISE), 6)
    shapes, xyz = measure_shapes(patches), patches.cloud.xyz
    step, n_slices = 0.05, 2 * 30
    number, tiles = np.arange(len(xyz)), tiles_of(shapes, step)
    near = nearby_points(patches, number, np.zeros(len(xyz), np.int64), None)
    given = near, shapes.sheets, shapes.planes, shapes.points, shapes.start, tiles
    found = layers_over(*given, step, n_slices, np.array([0.0, slope]))
    assert n_slices * step == pytest.approx(2 * FARTHEST)
    assert (np.diff(tiles.row) == len(TURNS)).all()
    assert tiles.counts.sum() == shapes.counts.sum()
    for i in range(len(patches)):
        away = xyz - shapes.centre[i]
        plan = np.column_stack([away @ shapes.across[i], away @ shapes.along[i]])
        own = patches.patch == i
        low, high = plan[own].min(axis=0), plan[own].max(axis=0)
        size = (np.floor((high - low) / shapes.cell[i]) + 1).astype(int)
        corner = 0.5 * (low + high - size * shapes.cell[i])
        cells = np.floor((plan - corner) / shapes.cell[i]).astype(int)
        across, up = share_from_either_end(np.clip(cells, 0, size - 1), size, tiles.size[i]).T
        tile = tiles.first[i] + up * tiles.size[i, 0] + across
        occupied = {tuple(cell) for cell in cells[own]}
        reach = range(-RIM, RIM + 1)
        rim = {(u + du, v + dv) for u, v in occupied for du in reach for dv in reach} - occupied
        for t in range(tiles.first[i], tiles.first[i + 1]):
            middle = plan[own & (tile == t), 0].mean()
            np.testing.assert_allclose(tiles.middle[t], middle, atol=1e-9)
            height = away @ shapes.normal[i] - slope * (plan[:, 0] - middle)
            place = np.floor(height / step).astype(int) + n_slices // 2
            mine = [tuple(cell) for cell in np.unique(cells[own & (tile == t)], axis=0)]
            assert found.n_cells[t] == len(mine)
            row = tiles.row[t] + 1
            for layer in range(n_slices - 1):
                inside = np.flatnonzero(~own & (tile == t) & ((place == layer) | (place == layer + 1)))
                hit = [tuple(cells[k]) for k in inside if tuple(cells[k]) in occupied]
                assert found.n_points[row, layer] == len(hit)
                assert found.rim[row, layer] == sum(tuple(cells[k]) in rim for k in inside)
                assert found.cover[row, layer] == pytest.approx(len(set(hit)) / len(mine))
        assert found.n_rim[tiles.first[i] : tiles.first[i + 1]].sum() == len(rim)


# Points sorted in their planes: their gaps against brute force, and the memory that their cells take.


UPRIGHT = [0.0, 1.0, 0.0]


def shapes_of(*places: np.ndarray) -> PatchShapes:
    """Return patches of places (n, 2) in upright planes."""
    points = [np.column_stack([p[:, 0], np.zeros(len(p)), p[:, 1]]) for p in places]
    return measure_shapes(make_patches(points, [UPRIGHT] * len(places)))


def scan_lines(gap: float) -> np.ndarray:
    lines = np.array([(x, z) for z in np.arange(0, 3, gap) for x in np.arange(0, 6, 0.02)])
    return lines + np.random.default_rng(0).normal(0, 1e-4, lines.shape)


def places_of(shapes: PatchShapes, i: int) -> np.ndarray:
    sheets, some = shapes.sheets, slice(shapes.start[i], shapes.start[i + 1])
    return np.column_stack([sheets.u[some], sheets.v[some]])


@given(st.integers(0, 10**6), st.sampled_from([1, 2, 5, 40, 300]), st.floats(0.3, 4.0), st.booleans())
def test_gaps_are_those_of_brute_force(seed, n, power, twice):
    rng = np.random.default_rng(seed)
    places = rng.random((n, 2)) ** power * rng.uniform(0.01, 8, 2)
    shapes = shapes_of(np.vstack([places, places]) if twice else places, rng.random((9, 2)))
    for i in (0, 1):
        gap = shapes.sheets.gap[shapes.start[i] : shapes.start[i + 1]]
        np.testing.assert_allclose(gap, point_gaps(places_of(shapes, i), shapes.cell[i]), rtol=1e-7)
        assert (gap > 0).all()


def test_points_are_sorted_patch_after_patch_and_none_is_lost():
    rng = np.random.default_rng(4)
    shapes = shapes_of(rng.random((50, 2)), np.full((1, 2), np.nan), rng.random((70, 2)) * 9)
    sheets = shapes.sheets
    assert sorted(sheets.number[:50]) == list(range(50))
    assert shapes.counts.tolist() == [50, 0, 70]
    assert sorted(sheets.number[50:]) == list(range(50, 120))
    relative = shapes.points[sheets.number] - np.repeat(shapes.centre, shapes.counts, axis=0)
    np.testing.assert_array_equal(sheets.u, (relative * np.repeat(shapes.across, shapes.counts, axis=0)).sum(axis=1))
    assert sheets.first[-1] == 120


@pytest.mark.parametrize("side", [1e-3, 1.0, 1e7])
@pytest.mark.parametrize(
    "shape", [[[0, 0], [1, 0], [0, 1]], [[0, 0], [1, 1], [0.5, 0.501]], [[0, 0], [1, 0], [0.3, 1e-4]], [[0, 0]] * 3]
)
def test_few_points_make_few_cells_however_far_apart(shape, side):
    shapes = shapes_of(np.array(shape) * side, np.array(shape) * [1e-9, side])
    assert len(shapes.sheets.first) < 100
    assert np.isfinite(shapes.sheets.gap).all()
