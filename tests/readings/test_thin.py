from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from prf.model.window import Window
from prf.readings import Readings, thin
from prf.readings.carmen import read_carmen
from prf.readings.ground import (
    EVENNESS,
    PASSING,
    PLACE,
    Passages,
    Strata,
    strata_of,
    thin_beams,
    weights,
)
from prf.shell.errors import ConfigError, InputError
from tests.readings.samples import flaser

N_SCANS, N_BEAMS = 20, 6


@pytest.fixture(scope="module")
def readings() -> Readings:
    return read_carmen((flaser([1] * N_BEAMS) * N_SCANS).encode(), "a.log")


def scans_of(readings: Readings) -> list[int]:
    return np.unique(readings.scan).tolist()


def test_without_conditions_nothing_is_lost(readings):
    assert thin(readings).n_beams == N_SCANS * N_BEAMS


def test_every_scan_and_every_beam(readings):
    some = thin(readings, every_scan=7, every_beam=4)
    assert scans_of(some) == [0, 7, 14]
    assert np.unique(some.beam).tolist() == [0, 4]
    assert some.n_beams == 6


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("3:6", [3, 4, 5]),
        (":2", [0, 1]),
        ("18:", [18, 19]),
        ("5::8", [5, 13]),
        ("-2:", [18, 19]),
        (":-18", [0, 1]),
    ],
)
def test_slices(readings, text, expected):
    assert scans_of(thin(readings, scans=text)) == expected
    skipped = scans_of(thin(readings, skip_scans=text))
    assert skipped == [i for i in range(N_SCANS) if i not in expected]


def test_conditions_speak_of_scan_numbers_in_the_log(readings):
    assert scans_of(thin(readings, every_scan=3, scans="2:10")) == [3, 6, 9]
    assert scans_of(thin(readings, every_scan=2, scans="4:12", skip_scans="6:8")) == [4, 8, 10]


@given(st.integers(1, 25), st.integers(0, 9), st.integers(1, 9))
def test_mapped_and_held_out_scans_never_meet(readings, every, start, step):
    text = f"{start}::{step}"
    held_out = set(scans_of(thin(readings, scans=text)))
    try:
        mapped = set(scans_of(thin(readings, every_scan=every, skip_scans=text)))
    except InputError:
        mapped = set()
    assert not mapped & held_out
    assert mapped | held_out >= set(range(0, N_SCANS, every))


def test_thinning_twice_is_thinning_by_both(readings):
    twice = thin(thin(readings, every_scan=2), scans="-5:")
    np.testing.assert_array_equal(twice.scan, thin(readings, every_scan=2, scans="-5:").scan)


def test_dropped_beams_do_not_shift_the_others():
    some = thin(read_carmen(flaser([0, 1, 2, 3, 4]).encode(), "a.log"), every_beam=2)
    np.testing.assert_array_equal(some.range, [2, 4])


@pytest.mark.parametrize("text", ["", "5", "1:2:3:4", "a:b", "1.5:3", "::0", "::-1", "1:2:x"])
@pytest.mark.parametrize(("argument", "flag"), [("scans", "--scans"), ("skip_scans", "--skip-scans")])
def test_malformed_slices_name_the_option(readings, text, argument, flag):
    with pytest.raises(ConfigError, match=rf"^{flag} '"):
        thin(readings, **{argument: text})


@pytest.mark.parametrize(("argument", "flag"), [("every_scan", "--every-scan"), ("every_beam", "--every-beam")])
def test_steps_below_one_name_the_option(readings, argument, flag):
    for step in (0, -3):
        with pytest.raises(ConfigError, match=rf"^{flag} {step}"):
            thin(readings, **{argument: step})


@pytest.mark.parametrize("wanted", [{"scans": "20:"}, {"scans": "5:5"}, {"skip_scans": ":"}])
def test_nothing_left(readings, wanted):
    with pytest.raises(InputError, match="no reading is left of 120 in scans 0 to 19"):
        thin(readings, **wanted)


# Fewer beams: what is kept of dense logs, strata and their quotas, and ground that stays passed.


ROOM = Window(0.0, 0.0, 20.0, 10.0)
REACH = 15.0
DENSITY = 20.0
BUDGET = DENSITY * ROOM.area


class Log(NamedTuple):
    origin: NDArray[np.float64]
    angle: NDArray[np.float64]
    range: NDArray[np.float64]

    def kept(self, density: float = DENSITY) -> NDArray[np.int64]:
        return thin_beams(ROOM, *self, REACH, density)[0]

    def ends(self) -> NDArray[np.float64]:
        return self.origin + self.range[:, None] * np.column_stack([np.cos(self.angle), np.sin(self.angle)])

    def with_beam(self, x: float, y: float, angle: float, reading: float) -> Log:
        return Log(np.r_[self.origin, [[x, y]]], np.r_[self.angle, angle], np.r_[self.range, reading])


def walk(n_scans: int, n_beams: int = 180, seed: int = 1) -> Log:
    """Scans on the way along a room with walls half a metre inside the window, 3 cm of noise."""
    rng = np.random.default_rng(seed)
    origin = np.repeat(np.column_stack([np.linspace(2.0, 12.0, n_scans), np.full(n_scans, 5.0)]), n_beams, axis=0)
    angle = np.tile(np.linspace(-np.pi, np.pi, n_beams, endpoint=False) + 1e-3, n_scans)
    x, y = np.cos(angle), np.sin(angle)
    along = np.where(x > 0, 19.5 - origin[:, 0], origin[:, 0] - 0.5) / np.abs(x)
    across = np.where(y > 0, 9.5 - origin[:, 1], origin[:, 1] - 0.5) / np.abs(y)
    return Log(origin, angle, np.minimum(along, across) + 0.03 * rng.standard_normal(len(angle)))


@pytest.fixture(scope="module")
def dense() -> Log:
    return walk(400)


def test_a_sparse_log_is_left_alone() -> None:
    log = walk(20)
    np.testing.assert_array_equal(log.kept(), np.arange(len(log.range)))


def test_what_saves_less_than_a_quarter_is_left_alone() -> None:
    log = walk(30)
    per_area = len(log.range) / ROOM.area
    assert len(log.kept(0.8 * per_area)) == len(log.range)
    assert len(log.kept(0.6 * per_area)) < 0.75 * len(log.range)


def test_zero_density_keeps_all(dense: Log) -> None:
    assert len(dense.kept(0.0)) == len(dense.range)


def test_chosen_beams_are_a_subset_in_their_order_and_every_time_the_same(dense: Log) -> None:
    kept = dense.kept()
    assert (np.diff(kept) > 0).all()
    assert 0 <= kept[0] <= kept[-1] < len(dense.range)
    np.testing.assert_array_equal(kept, dense.kept())


def test_number_is_the_budget_however_often_the_log_is_repeated(dense: Log) -> None:
    """Of ground that many beams see, what coverage adds is a small part."""
    often = Log(*(np.concatenate([array] * 10) for array in dense))
    for log in (dense, often):
        assert 0.9 * BUDGET < len(log.kept()) < 1.1 * BUDGET


def test_every_square_with_a_return_keeps_one(dense: Log) -> None:
    squares = np.floor(dense.ends() / PLACE).astype(int)
    assert {tuple(square) for square in squares} == {tuple(square) for square in squares[dense.kept()]}


def test_a_lone_return_where_thousands_pass_stays(dense: Log) -> None:
    """Alone in its square it is all that speaks for an obstacle there."""
    log = dense.with_beam(7.0, 5.0, 0.3, 1.6)
    assert len(log.range) - 1 in log.kept()


def test_a_lone_beam_without_return_stays(dense: Log) -> None:
    log = dense.with_beam(7.0, 5.0, 0.3, np.inf)
    assert len(log.range) - 1 in log.kept()


def test_a_look_through_a_door_stays(dense: Log) -> None:
    """One beam alone shows that the ground behind the wall is free; its end has company on the wall."""
    hidden = Log(*(array[dense.ends()[:, 0] < 15.0] for array in dense))
    log = hidden.with_beam(12.0, 5.0, 0.05, 7.45)
    assert len(log.range) - 1 in log.kept()


def test_directions_and_times_at_one_place_stay_mixed(dense: Log) -> None:
    """On a stretch of wall that 400 scans see: from both ends of the way, and from the left and the right."""
    kept = dense.kept()
    end = dense.ends()[kept]
    there = kept[(np.abs(end[:, 0] - 7.0) < 1.0) & (end[:, 1] > 9.0)]
    assert len(there) > 10
    scan = there // 180
    assert np.ptp(scan) > 300
    assert (np.cos(dense.angle[there]) > 0.3).any()
    assert (np.cos(dense.angle[there]) < -0.3).any()


def test_across_a_wall_beams_are_thinned_alike(dense: Log) -> None:
    """The scatter of the kept returns about the wall is that of all: no preference for the fringe of its blur."""

    def scatter(beams: NDArray[np.int64]) -> float:
        y = dense.ends()[beams, 1]
        return float(np.std(y[y > 9.2]))

    assert abs(scatter(dense.kept()) / scatter(np.arange(len(dense.range))) - 1.0) < 0.15


WINDOW = Window(0.0, 0.0, 8.0, 8.0)


def made(sizes: list[int], alike: list[int] | None = None) -> Strata:
    size = np.array(sizes)
    each = size.astype(np.float64)
    together = each if alike is None else np.array(alike, np.float64)
    return Strata(np.arange(size.sum()), size, each, together, np.ones(size.sum()))


def test_beams_of_a_stratum_share_square_direction_and_outcome() -> None:
    rng = np.random.default_rng(1)
    origin, end = rng.uniform(0.1, 7.9, (2, 3000, 2))
    returned = rng.random(3000) < 0.7
    strata = strata_of(WINDOW, origin, end, returned)
    np.testing.assert_array_equal(np.sort(strata.order), np.arange(3000))
    towards = np.floor((np.arctan2(*(end - origin).T[::-1]) + np.pi) / (np.pi / 4.0)).astype(int) % 8
    names = [
        (*square, outcome) for square, outcome in zip(np.floor(end / 0.5).astype(int).tolist(), returned, strict=True)
    ]
    start = 0
    np.testing.assert_array_equal(strata.size, strata.n)
    for size, alike in zip(strata.n, strata.alike, strict=True):
        members = strata.order[start : start + size]
        assert len({names[i] + (towards[i],) for i in members}) == 1
        assert (np.diff(members) > 0).all()
        assert alike == names.count(names[members[0]])
        start += size


def test_parts_that_were_thinned_apart_are_thinned_as_all_of_it() -> None:
    """Five parts of a log, one after the other, against all at once: the same shares, and as many of each part."""
    rng = np.random.default_rng(4)
    n, room = 40_000, ROOM
    origin = rng.uniform((2.0, 2.0), (4.0, 4.0), (n, 2))
    angle = rng.normal(0.0, 0.5, n)  # a dense middle and rare flanks
    ranges = np.full(n, REACH)
    _, share = thin_beams(room, origin, angle, ranges, REACH, DENSITY)
    kept, left = np.zeros(0, np.int64), np.zeros(0)
    for part in np.array_split(np.arange(n), 5):
        own, its = thin_beams(room, origin[part], angle[part], ranges[part], REACH, DENSITY)
        rows, shares = np.r_[kept, part[own]], np.r_[left, its]
        some, left = thin_beams(room, origin[rows], angle[rows], ranges[rows], REACH, DENSITY, shares)
        kept = rows[some]
    whole, _ = thin_beams(room, origin, angle, ranges, REACH, DENSITY)
    assert len(kept) == pytest.approx(len(whole), rel=0.1)
    np.testing.assert_allclose(np.bincount(kept // (n // 5)), len(kept) / 5, rtol=0.15)
    in_the_middle = [float(np.mean(np.abs(angle[rows]) < 0.3)) for rows in (kept, whole)]
    assert in_the_middle[0] == pytest.approx(in_the_middle[1], abs=0.03)
    assert share.min() < 0.1


def test_quotas_fill_the_budget_and_grow_as_the_power_of_the_size() -> None:
    strata = made([100, 400, 1600, 6400])
    share = weights(strata, 200.0)
    assert strata.size @ share == pytest.approx(200.0)
    quota = strata.size * share
    np.testing.assert_allclose(quota[1:] / quota[:-1], 4.0**EVENNESS)


WINDOW = Window(0.0, 0.0, 12.0, 7.0)


def beams(n: int, seed: int = 2) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    low, high = np.array(WINDOW[:2]), np.array(WINDOW[2:])
    return rng.uniform(low, high, (n, 2)), rng.uniform(low, high, (n, 2))


def passes_of(passages: Passages, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    return passages._count(chosen)


@pytest.mark.parametrize("kept_share", [0.0, 0.03, 0.3])
def test_completed_beams_pass_every_cell_twice_or_as_often_as_all(kept_share: float) -> None:
    start, end = beams(1500)
    passages = Passages(WINDOW, start, end)
    kept = np.random.default_rng(3).random(1500) < kept_share
    before = kept.copy()
    passages.complete(kept)
    assert kept[before].all()
    wanted = np.minimum(passes_of(passages, np.ones(1500, np.bool_)), PASSING)
    assert (passes_of(passages, kept) >= wanted).all()
    assert kept.sum() < 700
