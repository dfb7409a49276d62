"""What a sonar sees and how its readings are weighed: random maps against shadows cast pair by pair, and scenes."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely

from prf.kernels.readings import sonar_features as v
from prf.kernels.readings.sonar import OUTLIER_SHORT, OUTLIER_UNIFORM
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.coloring.polygons import from_polygons
from prf.model.ranges import make_poses, make_sight, sonar_array
from prf.model.window import INTERIOR, Window
from tests.kernels.entries import see_all, sonar_table
from tests.reference import slow_sonar as slow
from tests.reference.slow_sonar import Cone, Feature, Ring
from tests.reference.sonar_worlds import data_of, model_of, random_office, ring_all_round

ROOM = Window(0.0, 0.0, 10.0, 8.0)
FAR = Window(1e5, -3e5, 1e5 + 10.0, -3e5 + 8.0)
VIEWS = [math.radians(1.0), 0.349, math.radians(60.0), math.radians(170.0)]
RINGS = [
    pytest.param(Ring(), id="defaults"),
    pytest.param(Ring(8.0, 0.1, 0.05, (2.0, 0.1), (1.0, 0.1, 2.0, 1.0), 0.5, 0.3, 2.0), id="blunt"),
    pytest.param(Ring(1.5, 1e-3, 0.0, (-3.0, 2.0), (9.0, 3.0, 40.0, 0.0), 1e-6, 0.0), id="sharp"),
    pytest.param(Ring(1.5, 0.8, 0.3), id="as wide as the range"),
]


def see(coloring: Coloring, cone: Cone, ring: Ring, reach: float = math.inf) -> tuple[v.Sight, float]:
    """What the kernels find in a cone within a reach: the features are left in the scratch; and the extent."""
    data = data_of(ring, [cone], np.full(1, np.inf))
    pose = make_poses(data.model, data.readings.origin, data.readings.angle, data.readings.cone, data.readings.range)[0]
    ends = coloring.edges.reshape(-1, 2)
    corners = np.where(coloring.side[ends] == INTERIOR, ends, -1).astype(np.int64)
    sight = make_sight(len(ends) + 1)
    return sight, see_all(sight, coloring.segments().reshape(-1, 4), corners, pose, min(reach, ring.max))


def found_features(sight: v.Sight) -> list[Feature]:
    rows = sight.feature[: sight.counts[v.N_FEATURES]]
    columns = (v.DEPTH, v.PROJECTION, v.SUBTENDED)
    return slow.in_order(Feature(*row[list(columns)].tolist(), bool(row[v.KIND] == v.CORNER)) for row in rows)


def likelihoods(ring: Ring, sight: v.Sight, readings: np.ndarray, reach: float | None = None) -> np.ndarray:
    found = np.empty(len(readings))
    sonar_table(sonar_array(model_of(ring)), sight, readings, ring.max if reach is None else reach, found)
    return found


def compare(coloring: Coloring, cone: Cone, ring: Ring, rng: np.random.Generator) -> list[Feature]:
    """Hold features, extent and likelihoods of one cone to the slow ones."""
    expected = slow.features(coloring, cone, ring.max)
    sight, extent = see(coloring, cone, ring)
    found = found_features(sight)
    assert len(found) == len(expected), (cone, found, expected)
    rows = [np.array(kind, dtype=float).reshape(-1, 4) for kind in (found, expected)]
    assert rows[0] == pytest.approx(rows[1], rel=1e-9, abs=1e-9), cone
    near = [f.depth + k * ring.spread(f.depth) for f in expected for k in (-1.0, 0.5)]
    readings = np.array([*rng.uniform(0.0, ring.max, 3), *(r for r in near if 0.0 <= r < ring.max), math.inf])
    wanted = [slow.log_likelihood(ring, expected, r) for r in readings]
    assert likelihoods(ring, sight, readings) == pytest.approx(wanted, rel=1e-9, abs=1e-9), cone
    covered = sum(f.subtended for f in expected)
    # Near the full view the rounding of an angle decides, which costs time only.
    if covered < cone.view - 1e-7:
        assert extent == pytest.approx(ring.max)
    return expected


def free_places(coloring: Coloring, n: int, rng: np.random.Generator) -> np.ndarray:
    places = rng.uniform(coloring.window[:2], coloring.window[2:], (n, 2))
    return places[~black_at(coloring, places)]


@pytest.mark.parametrize(
    "view",
    [
        pytest.param(VIEWS[0], id="1 degree", marks=pytest.mark.slow),
        pytest.param(VIEWS[1], id="20 degrees", marks=pytest.mark.slow),
        pytest.param(VIEWS[2], id="60 degrees", marks=pytest.mark.slow),
        pytest.param(VIEWS[3], id="170 degrees"),
    ],
)
@pytest.mark.parametrize(
    "ring", [*(pytest.param(*each.values, id=each.id, marks=pytest.mark.slow) for each in RINGS[:2]), *RINGS[2:]]
)
def test_features_and_likelihoods_of_draws_are_the_slow_ones(ring: Ring, view: float) -> None:
    rng = np.random.default_rng(1)
    kinds = {True: 0, False: 0}
    for coloring in exact_draws(0.45, ROOM, 15, rng):
        for cone in ring_all_round(free_places(coloring, 2, rng), 4, view, rng):
            for feature in compare(coloring, cone, ring, rng):
                kinds[feature.is_corner] += 1
    assert kinds[False] > 20, kinds


@pytest.mark.parametrize("ring", RINGS)
def test_what_is_farther_than_the_reach_is_one_event(ring: Ring) -> None:
    """Against the slow twin, and by quadrature: the density up to the reach and the mass beyond come to one."""
    rng, reach, most = np.random.default_rng(9), 0.6 * ring.max, 0
    node, weight = np.polynomial.legendre.leggauss(20)
    for coloring in exact_draws(0.6, ROOM, 5, rng):
        for cone in ring_all_round(free_places(coloring, 1, rng), 3, 0.9, rng):
            expected, (sight, _) = slow.features(coloring, cone, reach), see(coloring, cone, ring, reach)
            readings = np.array([*rng.uniform(0.0, reach, 5), reach, 1.1 * reach, math.inf])
            wanted = [slow.log_likelihood(ring, expected, r, reach) for r in readings.tolist()]
            found = likelihoods(ring, sight, readings, reach)
            assert found == pytest.approx(wanted, rel=1e-9, abs=1e-9), cone
            peaks = [f.depth + k * ring.spread(f.depth) for f in expected for k in range(-9, 10)]
            cuts = np.unique(np.clip([*peaks, *np.linspace(0.0, reach, 40)], 0.0, reach))
            half, middle = 0.5 * np.diff(cuts), 0.5 * (cuts[1:] + cuts[:-1])
            density = np.exp(likelihoods(ring, sight, (middle[:, None] + half[:, None] * node).ravel(), reach))
            assert (density.reshape(-1, 20) @ weight) @ half + math.exp(found[-1]) == pytest.approx(1.0, abs=1e-6)
            most = max(most, len(expected))
    assert most > 0


@pytest.mark.parametrize("view", [0.349, pytest.param(2.5, marks=pytest.mark.slow)])
def test_features_and_likelihoods_of_offices_are_the_slow_ones(view: float) -> None:
    """Right angles, walls in line, walls of two faces: what random draws never have."""
    rng = np.random.default_rng(2)
    n_corners = 0
    for _ in range(15):
        coloring = random_office(ROOM, 8, 6, rng)
        places = free_places(coloring, 3, rng)
        places = np.concatenate([places, np.round(places[:1])[~black_at(coloring, np.round(places[:1]))]])
        for cone in ring_all_round(places, 4, view, rng):
            n_corners += sum(feature.is_corner for feature in compare(coloring, cone, Ring(), rng))
    assert n_corners > 60


def test_features_far_from_the_origin_lose_only_what_coordinates_lose() -> None:
    rng = np.random.default_rng(3)
    for near in exact_draws(0.4, ROOM, 10, rng):
        # Whole numbers of 2^-30 m survive the shift exactly.
        xy = np.round(near.xy * 2.0**30) / 2.0**30
        here = near._replace(xy=xy)
        there = near._replace(window=FAR, xy=xy + np.array(FAR[:2]))
        places = np.round(free_places(near, 2, rng) * 2.0**30) / 2.0**30
        for x, y in places:
            one, _ = see(here, Cone(x, y, 0.3, 0.8), Ring())
            two, _ = see(there, Cone(x + FAR[0], y + FAR[1], 0.3, 0.8), Ring())
            assert found_features(one) == found_features(two)


def test_rays_meet_the_surfaces_that_the_shadows_leave() -> None:
    """The slow twin itself against rays, which know nothing of shadows: shares of angle and nearest distances."""
    rng = np.random.default_rng(4)
    turns = (np.arange(4000) + 0.5) / 4000 - 0.5
    n_alike = 0
    for coloring in exact_draws(0.5, ROOM, 20, rng):
        for place in free_places(coloring, 1, rng):
            cone = Cone(*place.tolist(), 0.7, 1.2)
            z = slow.in_frame(cone, coloring.xy[coloring.edges])
            ray = np.exp(1j * turns * cone.view)[:, None]
            d = (z[:, 1] - z[:, 0])[None, :]
            with np.errstate(divide="ignore", invalid="ignore"):
                scale = (ray.conj() * d).imag
                t = (z[:, 0][None, :].conj() * d).imag / scale
                s = (z[:, 0][None, :].conj() * ray).imag / scale
            t = np.where((s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 3.5), t, np.inf)
            nearest = np.where(np.isfinite(t.min(axis=1)), t.argmin(axis=1), -1)
            runs = list(itertools.pairwise(np.flatnonzero(np.diff(nearest, prepend=-5, append=-5))))
            step = cone.view / 4000
            long = sorted(
                (float(t[a:b].min()), (b - a) * step) for a, b in runs if nearest[a] >= 0 and (b - a) * step > 1e-2
            )
            seen = [f for f in slow.features(coloring, cone, 3.5) if not f.is_corner and f.subtended > 1e-2]
            n_alike += len(long) == len(seen)
            if len(long) == len(seen):
                assert sorted(x for _, x in long) == pytest.approx(sorted(f.subtended for f in seen), abs=1e-3)
                assert [x for x, _ in long] == pytest.approx([f.depth for f in seen], abs=1e-2)
    assert n_alike > 6


@pytest.mark.parametrize("ring", RINGS)
def test_chances_sum_to_one_and_the_density_integrates_to_one(ring: Ring) -> None:
    rng = np.random.default_rng(5)
    for number, coloring in enumerate(exact_draws(0.6, ROOM, 10, rng)):
        for cone in ring_all_round(free_places(coloring, 1, rng), 3, 0.9, rng):
            seen = slow.features(coloring, cone, ring.max)
            assert slow.weights(ring, seen).sum() == pytest.approx(1.0, abs=1e-12)
            if number == 0 and len(seen) < 4:
                assert slow.total(ring, seen) == pytest.approx(1.0, abs=1e-9)
            # The kernel's density is held to the slow one above; here on its own, with a rule of its own.
            sight, _ = see(coloring, cone, ring)
            cuts = np.unique(
                [0.0, ring.max, *(f.depth + k * ring.spread(f.depth) for f in seen for k in range(-9, 10))]
            )
            cuts = cuts[(cuts >= 0.0) & (cuts <= ring.max)]
            cuts = np.unique(np.concatenate([cuts, np.linspace(0.0, ring.max, 40)]))
            node, weight = np.polynomial.legendre.leggauss(20)
            half, middle = 0.5 * np.diff(cuts), 0.5 * (cuts[1:] + cuts[:-1])
            r = (middle[:, None] + half[:, None] * node).ravel()
            integral = (np.exp(likelihoods(ring, sight, r)).reshape(-1, 20) @ weight) @ half
            mass = math.exp(likelihoods(ring, sight, np.array([math.inf]))[0])
            assert integral + mass == pytest.approx(1.0, abs=1e-9)


def scene(*polygons: list[tuple[float, float]]) -> Coloring:
    return from_polygons(shapely.MultiPolygon([shapely.Polygon(points) for points in polygons]), ROOM)


AHEAD = Cone(1.0, 4.0, 0.0, math.radians(60.0))
WALL_FAR = [(7.0, -1.0), (7.5, -1.0), (7.5, 9.0), (7.0, 9.0)]
WALL = [(3.0, -1.0), (3.5, -1.0), (3.5, 9.0), (3.0, 9.0)]


def seen(coloring: Coloring, cone: Cone = AHEAD, ring: Ring | None = None) -> list[Feature]:
    return compare(coloring, cone, ring or Ring(), np.random.default_rng(6))


def test_a_wall_ahead_is_seen_face_on_over_the_whole_view() -> None:
    (wall,) = seen(scene(WALL))
    assert wall == pytest.approx((2.0, math.pi / 2, math.radians(60.0), False))
    extent = see(scene(WALL), AHEAD, Ring())[1]
    assert extent == pytest.approx(2.0 / math.cos(math.radians(30.0)))


def test_a_wall_at_a_slant_returns_from_where_the_cone_leaves_it() -> None:
    """Turned by 50 degrees: its foot lies outside the cone, and the near border of the cone is 30 degrees off."""
    (wall,) = seen(scene(WALL), AHEAD._replace(angle=math.radians(50.0)))
    assert wall.depth == pytest.approx(2.0 / math.cos(math.radians(20.0)))
    assert wall.projection == pytest.approx(math.radians(70.0))
    # Beyond the maximum range the wall is not there: 2 / cos(turn) < 3.5.
    assert wall.subtended == pytest.approx(math.acos(2.0 / 3.5) - math.radians(20.0))


def test_a_corner_is_a_feature_and_so_are_both_its_sides() -> None:
    box = scene([(3.0, 4.0), (4.0, 3.0), (5.0, 4.0), (4.0, 5.0)])
    found = seen(box)
    assert [f.is_corner for f in found] == [False, False, True, True, True]
    assert [f.depth for f in found] == pytest.approx([2.0] * 3 + [math.sqrt(10.0)] * 2)
    assert [f.projection for f in found[:2]] == pytest.approx([math.pi / 4] * 2)
    three = seen(scene([(2.0, 3.5), (2.5, 3.5), (2.5, 4.5), (2.0, 4.5)]))
    assert [f.is_corner for f in three] == [False, True, True]


def test_a_corner_behind_a_wall_is_no_feature() -> None:
    box = [(4.0, 4.0), (4.2, 3.7), (4.4, 4.1), (4.2, 4.2)]
    assert sum(f.is_corner for f in seen(scene(box))) == 3
    assert len(seen(scene(box, WALL))) == 1


def test_a_wall_seen_left_and_right_of_a_post_is_two_features() -> None:
    post = [(2.0, 3.9), (2.2, 3.9), (2.2, 4.1), (2.0, 4.1)]
    found = seen(scene(post, WALL))
    assert [f.is_corner for f in found] == [False, True, True, False, False]
    assert found[3].depth == pytest.approx(found[4].depth)
    shadow = 2.0 * math.atan(0.05 / 0.5)
    assert found[0].subtended == pytest.approx(shadow)
    assert found[3].subtended + found[4].subtended == pytest.approx(AHEAD.view - shadow)


def test_an_edge_cut_by_the_cone_has_no_corner_there() -> None:
    bar = scene([(2.0, 4.2), (2.1, 4.2), (2.1, 7.0), (2.0, 7.0)])
    found = seen(bar)
    assert [f.is_corner for f in found] == [False, False, True, True]
    front, side = sorted(found[:2], key=lambda f: -f.subtended)
    assert front.subtended == pytest.approx(math.radians(30.0) - math.atan(0.2))
    assert side.projection == pytest.approx(math.atan(0.2))


def test_an_edge_through_the_disc_of_the_maximum_range_is_seen_within_it() -> None:
    wall = scene([(4.2, -1.0), (4.5, -1.0), (4.5, 9.0), (4.2, 9.0)])
    (found,) = seen(wall)
    assert found.subtended == pytest.approx(2.0 * math.acos(3.2 / 3.5))
    assert see(wall, AHEAD, Ring())[1] == 3.5
    assert seen(wall, ring=Ring(2.9)) == []


def test_the_border_of_the_window_is_no_wall() -> None:
    """White up to the border: nothing. A wall that meets the border has no corner there."""
    empty = Coloring.empty(ROOM)
    assert seen(empty, Cone(1.0, 4.0, math.pi, 1.0)) == []
    wall = scene([(-1.0, 2.0), (2.5, 2.0), (2.5, 1.0), (-1.0, 1.0)])
    found = seen(wall, Cone(1.0, 4.0, -2.0, 2.5))
    assert sum(f.is_corner for f in found) == 1
    assert slow.mass_of_no_return(Ring(), []) > 0.75


def test_a_sonar_close_to_a_wall() -> None:
    for gap in (1e-3, 1e-6):
        (wall,) = seen(scene(WALL), AHEAD._replace(x=3.0 - gap))
        assert wall.depth == pytest.approx(gap, rel=1e-6)
        along = seen(scene(WALL), Cone(3.0 - gap, 4.0, math.pi / 2, 0.349))
        assert [f.is_corner for f in along] == [False]
        assert along[0].projection == pytest.approx(0.1745, abs=1e-9)


def test_a_wall_that_runs_straight_away_is_not_seen() -> None:
    """It fills no angle. (Whether its far end is hidden by its near one no rounding can tell.)"""
    sight, _ = see(scene([(2.0, 4.0), (3.0, 4.0), (2.5, 4.2)]), AHEAD, Ring())
    surfaces = [f for f in found_features(sight) if not f.is_corner]
    assert [f.subtended for f in surfaces] == pytest.approx([math.atan(0.2 / 1.5)])


def test_walls_in_line_with_the_sonar_leave_no_gap() -> None:
    """Rounding decides under which sliver of an angle an end of such a wall is seen: it must decide nothing else."""
    rng = np.random.default_rng(8)
    block = scene([(3.0, 3.0), (3.0, 2.0), (4.0, 2.0), (4.0, 3.0), (5.0, 3.0), (5.0, 5.0), (3.0, 5.0)], WALL_FAR)
    for _ in range(300):
        turn, gap = rng.uniform(-0.3, 0.3), rng.uniform(0.1, 2.5)
        found = found_features(see(block, Cone(3.0 - gap, 3.0, turn, 1.5), Ring(8.0))[0])
        assert all(math.isfinite(f.depth) and gap - 1e-9 < f.depth < 8.0 for f in found), found
        assert all(f.is_corner or f.subtended > 1e-7 for f in found), found


def test_what_neither_pulse_nor_outlier_explains_is_impossible() -> None:
    """An empty room, and no share of stray readings, which settings do not allow."""
    model = sonar_array(model_of(Ring()))
    model[[OUTLIER_UNIFORM, OUTLIER_SHORT]] = 0.0
    sight, _ = see(Coloring.empty(ROOM), AHEAD, Ring())
    found = np.empty(2)
    sonar_table(model, sight, np.array([1.0, math.inf]), 3.5, found)
    assert found.tolist() == [-math.inf, 0.0]


def test_readings_at_the_maximum_range_or_beyond_are_one_event() -> None:
    data = data_of(Ring(), [AHEAD] * 4, np.array([3.4999, 3.5, 70.0, np.inf]))
    pose = make_poses(data.model, data.readings.origin, data.readings.angle, data.readings.cone, data.readings.range)
    assert pose[:, 5].tolist() == [3.4999, math.inf, math.inf, math.inf]
    sight, _ = see(scene(WALL), AHEAD, Ring())
    found = likelihoods(Ring(), sight, np.array([3.5, 70.0, math.inf]))
    assert len(set(found.tolist())) == 1


def test_the_slow_twin_draws_what_its_density_says() -> None:
    ring, rng = Ring(3.5, 0.3, 0.02), np.random.default_rng(7)
    features = [Feature(0.4, 1.3, 0.2, False), Feature(1.0, 0.0, 0.0, True), Feature(3.3, 1.5, 0.3, False)]
    n = 4000
    readings = np.array([slow.draw_reading(ring, features, rng) for _ in range(n)])
    cuts = np.array([0.0, 0.3, 0.6, 1.0, 1.4, 2.8, 3.2, 3.5])
    fine = np.linspace(0.0, 3.5, 35001)
    cumulated = np.concatenate([[0.0], np.cumsum(slow.density(ring, features, 0.5 * (fine[1:] + fine[:-1])) * 1e-4)])
    expected = np.append(np.diff(np.interp(cuts, fine, cumulated)), slow.mass_of_no_return(ring, features))
    observed = np.append(np.histogram(readings[np.isfinite(readings)], cuts)[0], np.isinf(readings).sum()) / n
    assert expected.sum() == pytest.approx(1.0, abs=1e-6)
    z = (observed - expected) / np.sqrt(expected * (1.0 - expected) / n)
    assert np.abs(z).max() < 4.5, z
