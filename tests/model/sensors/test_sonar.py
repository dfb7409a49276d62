"""The sonar's parameters, the density of walls and corners, and its cones laid out."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from scipy import integrate

from prf.kernels import constants as c
from prf.kernels.readings import cones as k
from prf.kernels.readings import sonar_features as v
from prf.kernels.score.sonar import Scene, add_sonar_densities
from prf.model import ranges as sensor
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.coloring.polygons import from_polygons
from prf.model.ranges import make_poses, sonar_array
from prf.model.sensors import SonarModel
from prf.model.window import Window
from prf.results.score.scene import features_seen, scene_of_coloring
from prf.sampler.target import Execution, Target, make_chain, sonar_data
from prf.shell.errors import ConfigError
from tests.kernels.entries import see_all
from tests.reference.recompute import differences
from tests.reference.slow_sonar import (
    Cone,
    Feature,
    Ring,
    features,
    log_likelihood,
    reach_in,
    return_probability,
    weights,
)
from tests.reference.sonar_worlds import data_of, model_of, random_office, ring_all_round

ROOM = Window(-5.0, -5.0, 5.0, 5.0)
FAR = Window(1e5, -3e5, 1e5 + 20.0, -3e5 + 12.0)
VIEW = 0.349


def test_the_slow_twin_has_the_same_defaults() -> None:
    assert model_of(Ring()) == SonarModel()


def chance(depth: float, degrees: float) -> float:
    """Of a return from a wide wall whose normal is this far from the axis of a cone of 20 degrees."""
    beyond = max(0.0, math.radians(degrees) - 0.5 * VIEW)
    return return_probability(Ring(), Feature(depth, math.pi / 2 - beyond, VIEW, False))


def test_the_defaults_are_those_of_a_ring_that_sees_smooth_walls_near_face_on_only() -> None:
    """A Polaroid ring: walls up to about 12 to 15 degrees beyond the cone, corners at up to 3 m often."""
    assert min(chance(d, 0.0) for d in (0.5, 1.0, 2.0, 3.0)) > 0.9
    assert min(chance(d, 20.0) for d in (0.5, 1.0, 2.0)) > 0.6
    assert 0.3 < chance(1.5, 10.0 + 13.5) < 0.7
    assert max(chance(d, 45.0) for d in (0.5, 1.0, 2.0, 3.0)) < 0.01
    corners = [return_probability(Ring(), Feature(d, 0.0, 0.0, True)) for d in (0.5, 1.0, 2.0, 3.0)]
    assert min(corners) > 0.3
    assert corners == sorted(corners, reverse=True)


def looked_at(seed: int) -> list[tuple[Scene, np.ndarray, np.ndarray]]:
    """Cones on random maps and offices, and the features in each."""
    rng = np.random.default_rng(seed)
    found = []
    for coloring in [*exact_draws(0.5, ROOM, 3, rng), random_office(ROOM, 8, 6, rng)]:
        places = rng.uniform(ROOM[:2], ROOM[2:], (6, 2))
        cones = ring_all_round(places[~black_at(coloring, places)], 5, 0.9, rng)
        data = data_of(Ring(), cones, np.ones(len(cones)))
        pose = make_poses(
            data.model, data.readings.origin, data.readings.angle, data.readings.cone, data.readings.range
        )
        scene = scene_of_coloring(coloring, 3.5)
        start, feature = features_seen(scene, pose, 3.5)
        found += [
            (scene, pose[k], feature[a:b]) for k, (a, b) in enumerate(itertools.pairwise(start.tolist())) if b > a
        ]
    assert len(found) > 30
    return found


def test_somebody_or_nobody_returns_the_pulse() -> None:
    most = 0
    for _, _, feature in looked_at(4):
        alone, share, none = sensor.return_probabilities(SonarModel(), feature)
        assert share.sum() + none == pytest.approx(1.0, abs=1e-12)
        assert ((share >= 0.0) & (share <= alone)).all()
        seen = [Feature(*row[:3].tolist(), bool(row[3])) for row in feature]
        assert alone == pytest.approx([return_probability(Ring(), one) for one in seen], rel=1e-12)
        assert np.append(share, none) == pytest.approx(weights(Ring(), seen), rel=1e-9, abs=1e-15)
        most = max(most, len(feature))
    assert most >= 5


def test_densities_and_the_mass_of_no_return_sum_to_one() -> None:
    """By quadrature of the kernel, on random maps; a piece between the centres of any two peaks."""
    model = SonarModel()

    def density(scene: Scene, pose: np.ndarray, r: float) -> float:
        rows, total = pose[None].copy(), np.zeros(1)
        rows[0, k.READING] = r
        add_sonar_densities(scene, sonar_array(model), rows, np.zeros(1, np.bool_), total)
        return float(total[0])

    for scene, pose, feature in looked_at(5)[::4]:
        peaks = feature[:, v.DEPTH, None] + np.array([-0.5, -0.1, 0.0, 0.1, 0.5])
        cuts = np.unique(np.clip([0.0, *peaks.ravel(), 3.5], 0.0, 3.5))
        pieces = [
            integrate.quad(lambda r, at=(scene, pose): density(*at, r), a, b, epsabs=1e-11)[0]
            for a, b in itertools.pairwise(cuts.tolist())
        ]
        assert sum(pieces) + density(scene, pose, math.inf) == pytest.approx(1.0, abs=1e-9)


def test_cones_leave_the_window_where_shapely_finds_it() -> None:
    window, rng = Window(-1.0, 2.0, 5.0, 6.0), np.random.default_rng(8)
    origin = rng.uniform(window[:2], window[2:], (300, 2))
    angle, view = rng.uniform(-np.pi, np.pi, 300), rng.uniform(0.05, 3.0, 300)
    border = shapely.box(*window).exterior
    turn = angle[:, None] + view[:, None] * np.linspace(-0.5, 0.5, 2001)
    rim = origin[:, None] + 20.0 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    cones = [shapely.Polygon([start, *ends]) for start, ends in zip(origin, rim, strict=True)]
    expected = [shapely.distance(shapely.Point(p), cone & border) for p, cone in zip(origin, cones, strict=True)]
    assert sensor.cone_exit(window, origin, angle, view) == pytest.approx(np.array(expected), rel=1e-6)


def test_a_sonar_reaches_up_to_where_its_cone_leaves_the_window() -> None:
    window, n = Window(0.0, 0.0, 4.0, 4.0), 4
    origin, angle, view = np.full((n, 2), 1.0), np.full(n, np.pi), np.full(n, 0.3)
    readings = np.array([0.5, 1.0, 2.0, np.inf])
    pose = make_poses(SonarModel(), origin, angle, view, readings, window)
    assert pose[:, k.READING].tolist() == [0.5, np.inf, np.inf, np.inf]
    assert pose[:, k.MAX_DISTANCE].tolist() == pose[:, k.EXTENT].tolist() == [1.0] * n
    pose = make_poses(SonarModel(), origin, angle, view, readings)
    assert pose[:, k.READING].tolist() == readings.tolist()
    assert pose[:, k.MAX_DISTANCE].tolist() == [3.5] * n


def test_what_is_beyond_the_reach_changes_no_likelihood() -> None:
    """A cone that leaves the window on its left, 1.7 m away, and a wall in it at 2.5 m: neither is more likely."""
    window, n = Window(0.0, 0.0, 4.0, 4.0), 20
    data = sonar_data(
        np.tile([0.3, 0.5], (n, 1)), np.full(n, 0.5 * np.pi), np.full(n, 0.35), np.full(n, np.inf), SonarModel()
    )
    beyond, before = (
        make_chain(Target(window, 0.15, sonar=data), from_polygons(shapely.box(0.1, y, 3.0, y + 0.2), window))
        for y in (3.0, 1.5)
    )
    empty = make_chain(Target(window, 0.15, sonar=data), Coloring.empty(window))
    assert beyond.graph.sums[c.LOG_LIKELIHOOD] == empty.graph.sums[c.LOG_LIKELIHOOD]
    assert before.graph.sums[c.LOG_LIKELIHOOD] < empty.graph.sums[c.LOG_LIKELIHOOD] - 20.0


@pytest.mark.parametrize("view", [0.0, -0.1, math.pi, 4.0, math.nan])
def test_fields_of_view_that_are_none_are_refused(view: float) -> None:
    with pytest.raises(ConfigError, match="field of view"):
        make_poses(SonarModel(), np.zeros((2, 2)), np.zeros(2), np.array([VIEW, view]), np.ones(2))


@pytest.mark.parametrize(("window", "scale"), [(ROOM, 0.4), (FAR, 0.3)], ids=["room", "far from the origin"])
@pytest.mark.parametrize(
    "cell", [None, 0.2, pytest.param(5.0, marks=pytest.mark.slow)], ids=["chosen", "small", "large"]
)
def test_the_index_loses_nothing(window: Window, scale: float, cell: float | None) -> None:
    """Cones over the whole window: each chain's likelihoods are those of the slow twin, whatever the cells."""
    rng = np.random.default_rng(1)
    tolerance = 1e-9 * max(1.0, max(abs(bound) for bound in window))
    for coloring in exact_draws(scale, window, 3, rng):
        places = rng.uniform(window[:2], window[2:], (12, 2))
        cones = ring_all_round(places[~black_at(coloring, places)], 5, 0.6, rng)
        readings = rng.uniform(0.1, 4.0, len(cones))
        chain = make_chain(
            Target(window, scale, sonar=data_of(Ring(), cones, readings), execution=Execution(cell=cell)), coloring
        )
        reach = [reach_in(window, cone, 3.5) for cone in cones]
        wanted = [
            log_likelihood(Ring(), features(coloring, cone, end), r, end)
            for cone, r, end in zip(cones, readings.tolist(), reach, strict=True)
        ]
        assert chain.cones.pose[:, k.CONE_LOG_LIKELIHOOD] == pytest.approx(wanted, rel=1e-9, abs=tolerance)
        assert differences(chain) == []


@pytest.mark.parametrize(
    ("window", "cell", "n_places", "n_cones", "view"),
    [
        (ROOM, 0.3, 6, 4, 0.9),
        (ROOM, 0.2, 1, 2, 3.1),
        (ROOM, 3.6, 3, 2, 3.1),
        (Window(-5.0, -0.4, 5.0, 0.4), 0.2, 2, 2, 3.1),
    ],
    ids=["narrow", "small cells", "large cells", "corridor"],
)
def test_slots_hold_every_cell_that_a_cone_enters(
    window: Window, cell: float, n_places: int, n_cones: int, view: float
) -> None:
    """Points at random in the cone lie in a slot, and no nearer than it begins."""
    rng = np.random.default_rng(2)
    cones = ring_all_round(rng.uniform(window[:2], window[2:], (n_places, 2)), n_cones, view, rng)
    target = Target(window, 0.3, sonar=data_of(Ring(), cones, np.ones(len(cones))), execution=Execution(cell=cell))
    chain = make_chain(target, Coloring.empty(window))
    grid, slots = chain.edge_index.grid, chain.cones.slot_start
    for number, cone in enumerate(cones):
        near = {
            int(cell): float(entry)
            for cell, entry in zip(
                chain.cones.slot_cell[slots[number] : slots[number + 1]],
                chain.cones.slot_near[slots[number] : slots[number + 1]],
                strict=True,
            )
        }
        r, turn = (
            chain.cones.pose[number, k.MAX_DISTANCE] * np.sqrt(rng.random(500)),
            cone.angle + cone.view * (rng.random(500) - 0.5),
        )
        xy = np.stack([cone.x + r * np.cos(turn), cone.y + r * np.sin(turn)], axis=1)
        for (x, y), distance in zip(xy[window.contains(xy)], r[window.contains(xy)], strict=True):
            cell = int((x - grid.x0) / grid.cell) + grid.nx * int((y - grid.y0) / grid.cell)
            assert near[cell] <= distance
        entries = chain.cones.slot_near[slots[number] : slots[number + 1]]
        assert (np.diff(entries) >= 0.0).all()


def test_every_wall_and_corner_finds_room() -> None:
    """As many walls as there is room for, side by side: each is a surface and two corners."""
    walls = np.array([[1.0, y, 1.0, y + 0.1] for y in np.arange(-0.6, 0.6, 0.2)])
    pose = make_poses(SonarModel(), np.zeros((1, 2)), np.zeros(1), np.full(1, 2.0), np.ones(1))[0]
    sight = sensor.make_sight(len(walls))
    assert see_all(sight, walls, np.arange(2 * len(walls), dtype=np.int32).reshape(-1, 2), pose, 3.5) == 3.5
    assert sight.counts[v.N_FEATURES] == 3 * len(walls)


def test_too_many_slots_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensor, "MAX_SLOTS", 10)
    data = data_of(Ring(), [Cone(0.0, 0.0, 0.0, 1.0)], np.ones(1))
    with pytest.raises(ConfigError, match="--every-scan"):
        make_chain(Target(ROOM, 0.3, sonar=data), Coloring.empty(ROOM))


def test_no_edges() -> None:
    data = data_of(Ring(), [Cone(0.0, 0.0, 0.0, 1.0)] * 2, np.array([1.0, np.inf]))
    chain = make_chain(Target(ROOM, 0.3, sonar=data), Coloring.empty(ROOM))
    assert (chain.cones.pose[:, k.EXTENT] == 3.5).all()
    assert chain.cones.pose[1, k.CONE_LOG_LIKELIHOOD] == pytest.approx(math.log(0.75 + 0.05 * math.exp(-7.0)))
