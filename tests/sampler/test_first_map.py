from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.coloring import black_at, violations
from prf.posterior import LaserData, PointData, Settings, make_chain
from prf.sampler import starts
from prf.sampler.chain import ChainSampler
from prf.sampler.starts import find_first_map, has_shares, shares
from prf.sensors.points import PointModel
from prf.thinning import thin_beams
from prf.window import Window
from tests.reference.beams import Sensor
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
NO_PROBES = np.zeros(0, np.int64)


def room_settings() -> Settings:
    return Settings(ROOM, 0.2, draw_world(0.2, ROOM, Sensor(6.0), 8, 50, np.random.default_rng(1)).data)


@pytest.fixture
def many(monkeypatch: pytest.MonkeyPatch) -> Settings:
    """Readings enough for two shares, by lower bounds: short looks, too."""
    settings = room_settings()
    monkeypatch.setattr(starts, "FEWEST_READINGS", 25)
    monkeypatch.setattr(starts, "CLIMB_STEPS", 2000)
    return settings


def test_shares_grow_by_the_stride_and_stop_short_of_all(many: Settings) -> None:
    assert many.laser is not None
    n = len(many.laser.readings.range)
    sizes = [len(share.laser.readings.range) for share in shares(many) if share.laser is not None]
    assert sizes == [-(-n // 16), -(-n // 4)]


def test_few_readings_have_no_share() -> None:
    assert not has_shares(room_settings())


def test_a_share_is_dealt_from_the_readings_as_they_stand_together(many: Settings) -> None:
    assert many.laser is not None
    rows = np.column_stack([many.laser.readings.origin, many.laser.readings.angle, many.laser.readings.range])
    for share in shares(many):
        assert share.laser is not None
        dealt = np.column_stack([share.laser.readings.origin, share.laser.readings.angle, share.laser.readings.range])
        assert {tuple(row) for row in dealt} <= {tuple(row) for row in rows}


def test_first_map_is_valid_with_every_sensor_in_white_and_far_better_than_none(many: Settings) -> None:
    assert many.laser is not None
    coloring = find_first_map(many, np.random.default_rng(1), lambda: False)
    assert not violations(coloring)
    assert not black_at(coloring, many.laser.readings.origin).any()
    found = make_chain(many, coloring).graph.sums
    empty = make_chain(many, starts.one_colour_map(many)).graph.sums
    assert found.sum() > empty.sum() + 100.0


def test_same_seed_same_map_and_a_request_stops_at_the_next_look(many: Settings) -> None:
    one, other = (find_first_map(many, np.random.default_rng(2), lambda: False) for _ in range(2))
    assert np.array_equal(one.xy, other.xy)
    looks: list[int] = []
    find_first_map(many, np.random.default_rng(2), lambda: bool(looks.append(1) or True))
    assert len(looks) <= 2


def test_a_request_before_the_first_look_leaves_generator_and_map_alone(many: Settings) -> None:
    rng = np.random.default_rng(2)
    state = rng.bit_generator.state
    assert find_first_map(many, rng, lambda: True).n_edges == 0
    assert rng.bit_generator.state == state


def test_a_request_during_one_share_spares_the_others_their_look(
    many: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[int] = []
    monkeypatch.setattr(starts, "make_chain", lambda *args: built.append(1) or make_chain(*args))
    find_first_map(many, np.random.default_rng(2), lambda: bool(built))
    assert len(built) == 1


def test_points_are_dealt_with_the_readings(many: Settings) -> None:
    """All of them beside a sixteenth of the readings would outweigh these."""
    rng = np.random.default_rng(4)
    points = PointData.from_arrays(
        rng.uniform(1.0, 9.0, (160, 2)), rng.integers(0, 2, 160).astype(float), PointModel("binary")
    )
    dealt = [share.points for share in shares(dataclasses.replace(many, points=points))]
    assert [len(part.table.value) for part in dealt if part is not None] == [10, 40]
    assert all(part.model == points.model for part in dealt if part is not None)
    assert {tuple(xy) for xy in dealt[0].table.xy} <= {tuple(xy) for xy in points.table.xy}


def test_shares_are_of_the_beams_that_thinning_keeps(many: Settings) -> None:
    laser = many.laser
    assert laser is not None
    kept = thin_beams(
        ROOM, laser.readings.origin, laser.readings.angle, laser.readings.range, laser.model.max_range, 1.5
    )
    thinned = LaserData.from_arrays(
        laser.readings.origin[kept], laser.readings.angle[kept], laser.readings.range[kept], laser.model
    )
    largest = [share.laser for share in shares(dataclasses.replace(many, laser=thinned))][-1]
    assert largest is not None
    assert largest.readings.n_beams == -(-len(kept) // starts.STRIDE) < len(laser.readings.range) // starts.STRIDE


def test_chain_with_few_readings_stays_where_it_was() -> None:
    sampler = ChainSampler(room_settings(), np.random.default_rng(3), NO_PROBES, refreshes=False)
    before, state = sampler.chain, sampler.rng.bit_generator.state
    sampler.find_start(lambda: False)
    assert sampler.chain is before
    assert sampler.rng.bit_generator.state == state
