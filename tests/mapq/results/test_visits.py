from __future__ import annotations

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.results.visits import Clock, join_stays, stays_of, visits_of

ROUND = np.array([[0.0, 0.0], [30.0, 0.0], [60.0, 0.0], [60.0, 30.0], [30.0, 30.0], [0.0, 30.0], [0.0, 1.0]])
"""Where the sensor was at each scan of a round."""


def make_cloud(**fields: np.ndarray) -> PointCloud:
    n_points = len(next(iter(fields.values())))
    return PointCloud(np.zeros((n_points, 3)), np.zeros(3), fields)


def driven(places: np.ndarray, sensors: bool = True, **fields: np.ndarray) -> PointCloud:
    """Return three points a scan, seen from above each place; `sensors`: the map tells from where."""
    sensor = np.repeat(np.column_stack([places, np.ones(len(places))]), 3, axis=0)
    points = sensor + np.tile([[5.0, 0.0, 0.0], [-5.0, 0.0, 0.0], [0.0, 2.0, 0.0]], (len(places), 1))
    if sensors:
        fields |= {f"to_sensor_{axis}": (sensor - points)[:, k] for k, axis in enumerate("xyz")}
    if not fields.keys() & {"time", "gps_time"}:
        fields["scan"] = np.repeat(np.arange(len(places)), 3)
    return PointCloud(points, np.zeros(3), fields)


@pytest.mark.parametrize("sensors", [True, False])
def test_a_round_brings_another_visit(sensors):
    visits = visits_of(driven(ROUND, sensors))
    assert visits is not None
    assert visits.unit == "scan"
    assert visits.moment.tolist() == np.repeat(np.arange(7), 3).tolist()
    assert visits.new_visit(np.array([0, 0]), np.array([6, 1])).tolist() == [True, False]
    assert (visits.way is not None) is sensors


def test_neighbouring_scans_are_one_visit_however_far_apart():
    visits = visits_of(driven(10.0 * ROUND))
    assert visits is not None
    assert visits.leaves.tolist() == [2, 3, 4, 5, 6, 7, 7]


def test_seconds_make_moments_where_scans_are_not_known():
    seconds = np.repeat([0.0, 0.4, 1.6, 2.3, 3.1, 4.8, 160.0], 3)
    for name in ("time", "gps_time"):
        visits = visits_of(driven(ROUND, **{name: seconds + 1e9}))
        assert visits is not None
        assert visits.unit == "second"
        assert visits.moment.reshape(-1, 3)[:, 0].tolist() == [0, 0, 1, 2, 3, 4, 5]
        assert visits.seconds is not None
        assert visits.new_visit(np.array([0, 0]), np.array([5, 1])).tolist() == [True, False]


def test_every_pass_is_a_visit_where_nothing_else_is_known():
    for name in ("pass_id", "point_source_id"):
        visits = visits_of(make_cloud(**{name: np.array([3, 3, 7, 9], np.uint16)}))
        assert visits is not None
        assert (visits.unit, visits.leaves.tolist()) == ("pass", [1, 2, 3])


@pytest.mark.parametrize(
    "fields",
    [
        {"intensity": np.arange(4.0)},
        {"scan": np.zeros(4)},
        {"scan": np.array([0.5, 1.0, 2.0, 3.0])},
        {"time": np.array([0.0, 0.1, 0.2, 0.3])},
        {"scan": np.array(["a", "b", "c", "d"])},
        {"pass_id": np.zeros((4, 2))},
    ],
)
def test_fields_that_are_no_clock_are_ignored(fields):
    assert visits_of(make_cloud(**fields)) is None


@pytest.mark.parametrize("turn", [np.tile([0.0, 0.05, 0.1], 7), 1e9 * np.arange(21.0), np.zeros(21)])
def test_what_is_no_clock_does_not_hide_one(turn):
    """Many drivers write the time within a turn of the laser, or nanoseconds, into a field called time."""
    seconds = np.repeat(20.0 * np.arange(7), 3)
    by_scan = visits_of(driven(ROUND, time=turn, gps_time=seconds, scan=np.repeat(np.arange(7), 3)))
    assert by_scan is not None
    assert by_scan.unit == "scan"
    np.testing.assert_array_equal(by_scan.seconds, 20.0 * np.arange(7))
    by_time = visits_of(driven(ROUND, time=turn, gps_time=seconds))
    assert by_time is not None
    assert by_time.unit == "second"
    alone = visits_of(driven(ROUND, time=turn, scan=np.repeat(np.arange(7), 3)))
    assert alone is not None
    assert alone.seconds is None
    by_pass = visits_of(make_cloud(pass_id=np.zeros(4), point_source_id=np.array([3, 3, 7, 9])))
    assert by_pass is not None
    assert by_pass.leaves.tolist() == [1, 2, 3]


def test_a_point_without_sensor_position_hides_no_sensor():
    cloud = driven(ROUND)
    x = cloud.fields["to_sensor_x"].copy()
    x[4] = np.nan
    visits = visits_of(cloud.with_fields(to_sensor_x=x))
    assert visits is not None
    np.testing.assert_allclose(visits.way, [0, 30, 60, 90, 120, 150, 179])
    clock = Clock("scan", "scan", 0.0, None, True)
    whole, parts = stays_of(cloud, clock)[0], []
    for some in (np.arange(21) < 4, np.arange(21) == 4, np.arange(21) > 4):
        parts.append(stays_of(cloud.with_fields(to_sensor_x=x).take(some), clock)[0])
    np.testing.assert_allclose(join_stays(parts).sensor, whole.sensor)
    x[3:6] = np.nan
    unknown = visits_of(cloud.with_fields(to_sensor_x=x))
    assert unknown is not None
    assert unknown.way is None


def test_scans_are_neighbours_by_their_numbers():
    """Of scans 0, 2, 4, 40 and 42 the map has no points of those between 4 and 40."""
    places = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [90.0, 0.0], [90.5, 0.0]])
    cloud = driven(places)
    visits = visits_of(cloud.with_fields(scan=np.array([0, 2, 4, 40, 42])[cloud.fields["scan"]]))
    assert visits is not None
    assert visits.leaves.tolist() == [3, 3, 3, 5, 5]


def test_parts_of_a_map_are_put_together():
    """Halves of each scan, in other orders: means of medians, weighted by points; times where there are some."""
    cloud = driven(ROUND)
    cloud = cloud.with_fields(time=np.where(np.arange(21) % 3 == 0, np.nan, 10.0 * cloud.fields["scan"]))
    clock = Clock("scan", "scan", 0.0, "time", True)
    whole, _ = stays_of(cloud, clock)
    parts = [stays_of(cloud.take(rows), clock)[0] for rows in (np.arange(1, 21, 3), np.arange(21)[::-1])]
    joined = join_stays([parts[0]._replace(seconds=np.full(7, np.nan)), parts[1]])
    np.testing.assert_array_equal(joined.value, whole.value)
    np.testing.assert_array_equal(joined.n_points, whole.n_points + 1)
    np.testing.assert_allclose(joined.sensor, whole.sensor, atol=1e-12)
    np.testing.assert_allclose(joined.place, (3.0 * whole.place + parts[0].place) / 4.0)
    np.testing.assert_allclose(joined.seconds, 10.0 * np.arange(7))
    blind = [part._replace(sensor=np.full((7, 3), np.nan)) for part in parts]
    np.testing.assert_allclose(join_stays([blind[0], parts[1]]).sensor, parts[1].sensor)
    assert np.isnan(join_stays(blind).sensor).all()
