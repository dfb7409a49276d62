"""The sonar's parameters, what they say of walls and corners, and its cones laid out."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from prf.arak import exact_draws
from prf.coloring import Coloring, black_at
from prf.kernels import cones as k
from prf.kernels import visibility as v
from prf.kernels.build import trace_all
from prf.posterior import Settings, make_chain
from prf.recompute import differences
from prf.sensors import sonar as sensor
from prf.sensors.sonar import SonarModel, make_poses
from prf.shell.errors import ConfigError
from prf.window import Window
from tests.reference.slow_sonar import Cone, Feature, Ring, features, log_likelihood, return_probability
from tests.reference.sonar_worlds import data_of, model_of, ring_all_round

ROOM = Window(-5.0, -5.0, 5.0, 5.0)
FAR = Window(1e5, -3e5, 1e5 + 20.0, -3e5 + 12.0)
VIEW = 0.349


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("max_range", 0.0),
        ("max_range", math.inf),
        ("noise", 0.0),
        ("noise", math.nan),
        ("noise_relative", -0.1),
        ("noise_relative", math.nan),
        ("short_length", 0.0),
        ("corner_bias", math.nan),
        ("surface_oblique", math.inf),
        ("uniform_probability", 0.0),
        ("uniform_probability", 1.0),
        ("short_probability", -0.1),
        ("short_probability", 0.8),
    ],
)
def test_parameters_without_a_density_are_refused(field: str, value: float) -> None:
    with pytest.raises(ConfigError, match="sonar-" + field.replace("_", "-")):
        dataclasses.replace(SonarModel(), **{field: value})


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


@pytest.mark.parametrize("view", [0.0, -0.1, math.pi, 4.0, math.nan])
def test_fields_of_view_that_are_none_are_refused(view: float) -> None:
    with pytest.raises(ConfigError, match="field of view"):
        make_poses(SonarModel(), np.zeros((1, 2)), np.zeros(1), np.full(1, view), np.ones(1))


@pytest.mark.parametrize(("window", "scale"), [(ROOM, 0.4), (FAR, 0.3)], ids=["room", "far from the origin"])
@pytest.mark.parametrize("cell", [None, 0.2, 5.0], ids=["chosen", "small", "large"])
def test_the_index_loses_nothing(window: Window, scale: float, cell: float | None) -> None:
    """Cones over the whole window: each chain's likelihoods are those of the slow twin, whatever the cells."""
    rng = np.random.default_rng(1)
    tolerance = 1e-9 * max(1.0, max(abs(bound) for bound in window))
    for coloring in exact_draws(scale, window, 3, rng):
        places = rng.uniform(window[:2], window[2:], (12, 2))
        cones = ring_all_round(places[~black_at(coloring, places)], 5, 0.6, rng)
        readings = rng.uniform(0.1, 4.0, len(cones))
        chain = make_chain(Settings(window, scale, cell=cell, sonar=data_of(Ring(), cones, readings)), coloring)
        wanted = [
            log_likelihood(Ring(), features(coloring, cone, 3.5), r if r < 3.5 else math.inf)
            for cone, r in zip(cones, readings, strict=True)
        ]
        assert chain.cones.pose[:, k.CONE_LOG_LIKELIHOOD] == pytest.approx(wanted, rel=1e-9, abs=tolerance)
        assert differences(chain) == []


def test_slots_hold_every_cell_that_a_cone_enters() -> None:
    """Points at random in the cone lie in a slot, and no nearer than it begins."""
    rng = np.random.default_rng(2)
    cones = ring_all_round(rng.uniform(-5, 5, (6, 2)), 4, 0.9, rng)
    settings = Settings(ROOM, 0.3, cell=0.3, sonar=data_of(Ring(), cones, np.ones(len(cones))))
    chain = make_chain(settings, Coloring.empty(ROOM))
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
        r, turn = 3.5 * np.sqrt(rng.random(500)), cone.angle + cone.view * (rng.random(500) - 0.5)
        xy = np.stack([cone.x + r * np.cos(turn), cone.y + r * np.sin(turn)], axis=1)
        for (x, y), distance in zip(xy[ROOM.contains(xy)], r[ROOM.contains(xy)], strict=True):
            cell = int((x - grid.x0) / grid.cell) + grid.nx * int((y - grid.y0) / grid.cell)
            assert near[cell] <= distance
        entries = chain.cones.slot_near[slots[number] : slots[number + 1]]
        assert (np.diff(entries) >= 0.0).all()


def test_too_many_slots_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensor, "MOST_SLOTS", 10)
    data = data_of(Ring(), [Cone(0.0, 0.0, 0.0, 1.0)], np.ones(1))
    with pytest.raises(ConfigError, match="--every-scan"):
        make_chain(Settings(ROOM, 0.3, sonar=data), Coloring.empty(ROOM))


def test_sensing_anew_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    coloring = exact_draws(0.5, ROOM, 1, rng)[0]
    cones = ring_all_round(rng.uniform(-5, 5, (10, 2)), 8, 0.5, rng)
    chain = make_chain(Settings(ROOM, 0.5, sonar=data_of(Ring(), cones, rng.uniform(0, 4, len(cones)))), coloring)
    before = chain.cones.pose.copy()
    trace_all(chain)
    assert np.array_equal(before, chain.cones.pose)
    assert chain.cones.pose[:, v.BORDER] == pytest.approx(math.tan(0.25))


def test_no_edges() -> None:
    data = data_of(Ring(), [Cone(0.0, 0.0, 0.0, 1.0)] * 2, np.array([1.0, np.inf]))
    chain = make_chain(Settings(ROOM, 0.3, sonar=data), Coloring.empty(ROOM))
    assert (chain.cones.pose[:, k.EXTENT] == 3.5).all()
    assert chain.cones.pose[1, k.CONE_LOG_LIKELIHOOD] == pytest.approx(math.log(0.75 + 0.05 * math.exp(-7.0)))
