"""Whole simulated maps: what is clean, what is doubled, what stays the same."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.configuration import SIZES, SimulateSettings
from mapq.kernels.raycast import NOTHING, cast_beams
from mapq.simulate import Kind, Simulation, simulate, simulate_with_report
from mapq.simulate.drive import _build
from mapq.simulate.laser import BEAMS, choose_beams, count_beams, make_beams
from mapq.simulate.robot import odometry
from mapq.simulate.scene import SceneBuilder, World
from prf.shell.errors import ArgumentError, UsageError

FEW = {"n_points": 12_000}


@pytest.fixture(scope="module")
def drifted() -> Simulation:
    return simulate_with_report(SimulateSettings.of_size("small", {"n_points": 55_000}), 3)


@pytest.fixture(scope="module")
def clean() -> Simulation:
    return simulate_with_report(SimulateSettings.of_size("small", {"n_points": 55_000, "drift": 0.0}), 3)


def world_of(seed: int, **changes: float) -> tuple[World, np.ndarray]:
    builder = SceneBuilder()
    settings = SimulateSettings.of_size("small", changes)
    way = _build(builder, settings, np.random.default_rng(seed))
    return builder.finish(settings.max_range), way.xy


def test_fields_and_their_types(drifted: Simulation) -> None:
    cloud = drifted.cloud
    types = {name: values.dtype.name for name, values in cloud.fields.items()}
    assert types == {
        "truth": "uint8",
        "surface": "int32",
        "kind": "uint8",
        "time": "float64",
        "pass_id": "int16",
        "disagreement": "float32",
        "look_alike": "uint8",
        "to_sensor_x": "float32",
        "to_sensor_y": "float32",
        "to_sensor_z": "float32",
    }
    assert all(len(values) == len(cloud) for values in cloud.fields.values())
    assert cloud.finite().all()
    assert cloud.coordinate_type is np.float32
    assert (np.diff(cloud.fields["time"]) >= 0).all()
    assert set(cloud.fields["pass_id"]) == {0, 1, 2}
    assert len(cloud) == pytest.approx(55_000, rel=0.05)
    unlike = cloud.fields["surface"] == -1
    assert set(cloud.fields["kind"][unlike]) <= {Kind.FOLIAGE, Kind.POST, Kind.PERSON, Kind.MIXED, Kind.MOVING_CAR}


def test_a_clean_map_lies_on_its_surfaces(clean: Simulation) -> None:
    """Points of one true plane are as thick as the noise, whoever saw them when."""
    cloud = clean.cloud
    assert not cloud.fields["truth"].any()
    assert not cloud.fields["disagreement"].any()
    for surface in np.unique(cloud.fields["surface"]):
        points = cloud.xyz[cloud.fields["surface"] == surface]
        if surface >= 0 and len(points) > 60:
            thickness = np.sqrt(np.linalg.eigvalsh(np.cov(points.T))[0])
            assert thickness < 1.3 * 0.015


def test_drift_doubles_the_walls_that_are_seen_twice(drifted: Simulation) -> None:
    fields = drifted.cloud.fields
    report = drifted.report
    assert 0.1 < report.suspicious_wall_points < 0.7
    assert 0.05 < report.suspicious_cells < 0.6
    assert (fields["truth"] == 1).tolist() == (fields["disagreement"] > np.float32(0.05)).tolist()
    moving = np.isin(fields["kind"], (Kind.PERSON, Kind.MOVING_CAR, Kind.MIXED))
    assert moving.any()
    assert not fields["truth"][moving].any()
    assert not fields["truth"][fields["kind"] == Kind.GROUND].any()


def test_one_pass_is_crisp_even_where_the_map_is_not(drifted: Simulation) -> None:
    """Median thickness of metre cells of facades, seen within twenty seconds."""
    cloud = drifted.cloud
    wall = cloud.fields["kind"] == Kind.FACADE
    cell = np.floor(cloud.xyz[wall]).astype(int)
    moment = (cloud.fields["time"][wall] // 20.0).astype(int)
    key = np.column_stack([cloud.fields["surface"][wall], moment, cell])
    group = np.unique(key, axis=0, return_inverse=True)[1].ravel()
    xyz = cloud.xyz[wall]
    thick = []
    for number in np.flatnonzero(np.bincount(group) >= 12):
        thick.append(np.sqrt(np.linalg.eigvalsh(np.cov(xyz[group == number].T))[0]))
    assert len(thick) > 20
    assert np.median(thick) < 1.5 * 0.015


def test_the_world_and_the_beams_do_not_depend_on_the_drift(drifted: Simulation, clean: Simulation) -> None:
    for name in ("surface", "kind", "time", "pass_id", "look_alike"):
        np.testing.assert_array_equal(drifted.cloud.fields[name], clean.cloud.fields[name])
    # The error is nought at the start: the first metres are rendered alike.
    start = clean.cloud.fields["time"] < 1.0
    np.testing.assert_allclose(drifted.cloud.xyz[start], clean.cloud.xyz[start], atol=0.05)


def test_the_same_seed_gives_the_same_map_and_another_another() -> None:
    settings = SimulateSettings.of_size("small", FEW)
    one, same, other = (simulate(settings, seed) for seed in (5, 5, 6))
    assert one.xyz.tobytes() == same.xyz.tobytes()
    assert all(one.fields[name].tobytes() == same.fields[name].tobytes() for name in one.fields)
    assert one.xyz.tobytes() != other.xyz.tobytes()


def test_look_alikes_can_be_left_out_and_multiplied() -> None:
    shares = []
    for factor in (0.0, 1.0, 2.0):
        reports = [simulate_with_report(SimulateSettings.of_size("small", {**FEW, "look_alikes": factor}), 1)]
        shares.append(np.mean([report.report.look_alike_surfaces for report in reports]))
        assert all((one.cloud.fields["look_alike"].any()) == (factor > 0.0) for one in reports)
    assert shares[0] == 0.0 < shares[1] < shares[2]


def test_variety_adds_what_streets_have_beside_offices() -> None:
    offices, street = (
        simulate(SimulateSettings.of_size("small", {**FEW, "drift": 0.0, "variety": v}), 4) for v in (0.0, 3.0)
    )
    added = {Kind.LORRY, Kind.SHED, Kind.BALCONY}
    assert added.isdisjoint(np.unique(offices.fields["kind"]).tolist())
    assert added <= set(np.unique(street.fields["kind"]).tolist())
    assert not street.fields["truth"].any()


@pytest.mark.parametrize("variety", [0.0, 3.0])
@pytest.mark.parametrize("seed", range(2))
def test_the_way_is_free(seed: int, variety: float) -> None:
    """Nothing is within half a metre of the robot, at the height of its wheels or of its laser."""
    world, way = world_of(seed, blocks=2, look_alikes=2.0, clutter=2.0, variety=variety)
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(24)])
    for height in (0.5, 1.3):
        origins = np.repeat(np.column_stack([way[::10], np.full(len(way[::10]), height)]), 24, axis=0)
        directions = np.tile(around, (len(way[::10]), 1))
        ranges, items = np.empty(len(origins)), np.empty(len(origins), np.int32)
        cast_beams(world.scene, origins, directions, np.zeros(len(origins)), np.zeros(len(origins)), 0.5, ranges, items)
        assert (items == NOTHING).all()


def test_odometry_without_drift_is_the_truth_and_with_drift_begins_there() -> None:
    builder = SceneBuilder()
    way = _build(builder, SimulateSettings.of_size("small"), np.random.default_rng(1))
    still = odometry(way, SimulateSettings.of_size("small", {"drift": 0.0}), np.random.default_rng(2))
    np.testing.assert_allclose(still.xy, way.xy, atol=1e-9)
    np.testing.assert_array_equal(still.heading, way.heading)
    errors = []
    for strength in (0.5, 1.0, 2.0):
        believed = odometry(way, SimulateSettings.of_size("small", {"drift": strength}), np.random.default_rng(2))
        np.testing.assert_array_equal(believed.xy[0], way.xy[0])
        errors.append(believed.heading[-1] - way.heading[-1])
    np.testing.assert_allclose(errors, [0.5 * errors[1], errors[1], 2.0 * errors[1]])


def test_beams_nod_and_fan_out_over_half_a_turn() -> None:
    way = _build(SceneBuilder(), SimulateSettings.of_size("small"), np.random.default_rng(1))
    n_all = count_beams(way, 1.0)
    assert n_all == pytest.approx(way.length * 75 * BEAMS, rel=0.01)
    beams = make_beams(np.arange(150 * BEAMS), way, 1.0)
    np.testing.assert_allclose(np.linalg.norm(beams.directions, axis=1), 1.0)
    ahead = beams.directions[89::BEAMS, 2]
    assert np.degrees(np.arcsin(ahead.max())) == pytest.approx(58.0, abs=0.5)
    assert np.degrees(np.arcsin(ahead.min())) == pytest.approx(-26.0, abs=0.5)
    sideways = beams.directions[179::BEAMS, 2]
    assert np.abs(sideways).max() < 0.01
    numbers = choose_beams(n_all, 5000, np.random.default_rng(3))
    assert (np.diff(numbers) > 0).all()
    assert numbers[-1] < n_all
    np.testing.assert_array_equal(choose_beams(100, 1000, np.random.default_rng(3)), np.arange(100))


def test_a_laser_that_looks_all_round_sees_as_much_behind() -> None:
    way = _build(SceneBuilder(), SimulateSettings.of_size("small"), np.random.default_rng(1))
    numbers = np.arange(150 * BEAMS)
    half, whole = (make_beams(numbers, way, 1.0, all_round) for all_round in (False, True))
    heading = way.at(half.time)[1]
    ahead = [
        each.directions[:, 0] * np.cos(heading) + each.directions[:, 1] * np.sin(heading) for each in (half, whole)
    ]
    assert ahead[0].min() > -1e-9
    assert np.mean(ahead[1] < 0.0) == pytest.approx(0.5, abs=0.01)
    assert whole.directions[ahead[1] < 0.0, 2].mean() == pytest.approx(
        whole.directions[ahead[1] > 0.0, 2].mean(), abs=0.02
    )


def test_sizes_and_refusals() -> None:
    assert set(SIZES) == {"small", "medium", "large"}
    assert SimulateSettings.of_size("large").blocks == 2
    for size, changes, word in (
        ("huge", {}, "--size"),
        ("small", {"drift": -1.0}, "drift"),
        ("small", {"n_points": 1}, "n_points"),
    ):
        with pytest.raises((UsageError, ArgumentError), match=word):
            SimulateSettings.of_size(size, changes)
