"""Where to look next: gains beside exact ones, what never counts, ways beside `path_free`, the sensor."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from prf.model.coloring import Coloring, Draws, black_at_draws
from prf.output.run import Run
from prf.readings import Readings
from prf.results.estimate import path_free
from prf.results.explore import question, search
from prf.results.explore.gain import N_BEAMS
from prf.results.explore.question import ask, cells_of, gain_at
from prf.results.explore.reach import LEAST_FREE, STEP, reachable
from prf.results.explore.scanner import Scanner, field_of_view, first_walls, scanner_of
from prf.shell.errors import ArgumentError, InputError, UsageError
from tests.factories import CUPBOARD, ROOM, SCREEN, make_room_run, make_run, room_scan, room_with

SENSOR = Scanner(2.0 * math.pi, 360, 8.0, 0.03, 0.01, 0.05, 0.02)
OPEN = np.array([2.0, 4.0])
SHELVES = tuple((x, 5.0, x + 0.6, 5.5) for x in np.arange(0.7, 9.0, 0.8))
BOX = (1.0, 1.0, 1.6, 1.6)


def draws_of(maps: list[Coloring]) -> Draws:
    return Draws.from_colorings(maps)


def gain_of(maps: list[Coloring], place: np.ndarray) -> tuple[float, float]:
    """Return the gain of a scan from a place, and the entropy of all cells."""
    draws = draws_of(maps)
    asked = ask(draws, 4, None, 0.25)
    seen = first_walls([each.segments() for each in draws], draws.window, place[None], N_BEAMS, SENSOR)
    return float(gain_at(asked, seen[:, 0], place, SENSOR)[0].mean()), asked.entropy


def exact_gain(kinds: list[Coloring], number: np.ndarray, place: np.ndarray) -> float:
    """Return the expected drop of entropy by enumeration: a scan tells maps apart whose walls it meets elsewhere."""
    black = black_at_draws(draws_of(kinds), cells_of(ROOM)).astype(float)
    share = np.bincount(number, minlength=len(kinds)) / len(number)
    scans = [room_scan(each, tuple(place), n_beams=N_BEAMS).range for each in kinds]
    looks = np.array([next(k for k, other in enumerate(scans) if np.array_equal(scan, other)) for scan in scans])

    def entropy(weight: np.ndarray) -> float:
        p = np.clip(weight @ black / weight.sum(), 1e-12, 1.0 - 1e-12)
        return float((-p * np.log(p) - (1.0 - p) * np.log(1.0 - p)).sum())

    after = sum(share[looks == k].sum() * entropy(share * (looks == k)) for k in np.unique(looks))
    return entropy(share) - after


@pytest.mark.parametrize("place", [OPEN, np.array([8.0, 1.5])], ids=["before the screen", "behind it"])
def test_a_few_maps_give_what_their_enumeration_gives(place: np.ndarray) -> None:
    # The box is seen from both places. Before the screen it shows the cupboard behind it, out of sight.
    kinds = [room_with(SCREEN), room_with(SCREEN, CUPBOARD, BOX), room_with(SCREEN, BOX), room_with(SCREEN, SHELVES[0])]
    number = np.random.default_rng(2).choice(4, 240, p=[0.4, 0.3, 0.2, 0.1])
    found, entropy = gain_of([kinds[k] for k in number], place)
    assert found == pytest.approx(exact_gain(kinds, number, place), rel=0.04)
    assert found < 1.01 * entropy


def test_some_of_many_cells_stand_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(7)
    maps = [room_with(*(shelf for shelf in SHELVES if rng.random() < 0.5)) for _ in range(128)]
    found, entropy = gain_of(maps, OPEN)
    n_cells = len(ask(draws_of(maps), 4, None, 0.25).cell)
    monkeypatch.setattr(question, "MOST_CELLS", n_cells // 3)
    assert len(ask(draws_of(maps), 4, None, 0.25).cell) <= n_cells // 3
    assert gain_of(maps, OPEN) == (pytest.approx(found, rel=0.1), pytest.approx(entropy))


def test_in_brief_fewer_places_are_asked_that_lie_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "BRIEF_CANDIDATES", 40)
    run = make_room_run()
    whole, brief = search.explore(run), search.explore(run, is_brief=True)
    apart = np.hypot(*(brief.xy[:, None] - brief.xy).T) + np.where(np.eye(len(brief.xy)), np.inf, 0.0)
    assert apart.min() >= search.APART
    assert 3 <= len(brief.xy) <= search.BRIEF_PLACES
    assert brief.gain[0] == pytest.approx(whole.gain[0], rel=0.1)
    reach = reachable(run.draws, run.path_xy[-1], 0.25)
    assert len(search.candidates(reach, 40)) <= 40 < len(search.candidates(reach))


def test_equal_draws_leave_nothing_to_gain() -> None:
    assert gain_of([room_with(SCREEN)] * 40, OPEN) == (0.0, 0.0)


def test_what_no_beam_reaches_and_nothing_tells_of_is_no_gain() -> None:
    rng = np.random.default_rng(3)
    hidden = [(x, 3.0, x + 0.4, 3.4) for x in (6.0, 7.0, 8.0)]
    maps = [room_with((5.0, 0.5, 5.4, 5.5), *(box for box in hidden if rng.random() < 0.5)) for _ in range(200)]
    found, entropy = gain_of(maps, OPEN)
    assert entropy > 5.0
    assert abs(found) < 0.02 * entropy


def test_more_is_learnt_than_which_draw_it_is() -> None:
    rng = np.random.default_rng(4)
    maps = [room_with(*(shelf for shelf in SHELVES if rng.random() < 0.5)) for _ in range(256)]
    found, entropy = gain_of(maps, np.array([5.0, 2.0]))
    assert entropy > 8.0 * math.log(256)
    assert 0.75 * entropy < found <= entropy


def test_a_narrow_view_shows_less_and_looks_where_it_is() -> None:
    rng = np.random.default_rng(5)
    maps = [room_with(*((CUPBOARD,) if rng.random() < 0.5 else ())) for _ in range(120)]
    narrow = SENSOR._replace(field_of_view=0.5, n_beams=30)
    draws = draws_of(maps)
    asked = ask(draws, 4, None, 0.25)
    place = np.array([5.0, 4.5])
    seen = first_walls([each.segments() for each in draws], ROOM, place[None], N_BEAMS, narrow)
    found, theta = gain_at(asked, seen[:, 0], place, narrow)
    assert abs(theta) < 0.3
    assert found.mean() == pytest.approx(asked.entropy, rel=0.05)


def test_ways_are_free_as_path_free_has_them() -> None:
    run = make_room_run()
    rng = np.random.default_rng(6)
    maps = [room_with(SCREEN, *((CUPBOARD,) if rng.random() < 0.06 else ())) for _ in range(100)]
    draws = draws_of(maps)
    reach = reachable(draws, run.path_xy[-1], 0.25)
    assert np.hypot(*np.diff(reach.way(len(reach.xy) - 1), axis=0).T).max() < 1.5 * STEP
    for place in rng.choice(len(reach.xy), 25).tolist():
        way = reach.way(place)
        assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(reach.metres[place])
        assert path_free(draws, way, 0.25) >= reach.p_free[place] - 1e-12
        assert reach.p_free[place] >= LEAST_FREE
    assert (reach.xy[:, 0] > 7.4).any()
    behind = (reach.xy[:, 0] > 7.3) & (reach.xy[:, 1] > 3.9)
    assert (reach.p_free[behind] < 1.0).all()
    assert behind.any()


def test_a_cupboard_behind_a_screen_is_looked_at() -> None:
    shares: list[float] = []
    found = make_room_run().explore(progress=lambda share, _: shares.append(share))
    assert shares[-1] == 1.0
    x, y = found.xy[0]
    assert (x > 5.0) or (y < 2.0)
    assert found.gain[0] == pytest.approx(found.entropy, rel=0.1)
    assert (np.diff(found.gain) <= 0.0).all()
    assert (found.low <= found.gain).all()
    assert (found.gain <= found.high).all()
    assert found.metres.min() == 0.0
    by_way = make_room_run().explore(by="gain-per-metre")
    assert (np.diff(by_way.gain_per_metre) <= 0.0).all()
    assert by_way.metres[0] <= found.metres[0]


@pytest.mark.slow
def test_a_path_is_settled_from_where_it_is_seen() -> None:
    run, way = make_room_run(), [[8.0, 1.5], [8.0, 4.5]]
    found = run.explore(target=way, radius=0.3)
    share = run.paths(way, 0.3)[0]
    assert found.entropy == pytest.approx(-share * math.log(share) - (1.0 - share) * math.log(1.0 - share))
    assert 0.8 * found.entropy < found.gain[0] <= found.high[0] <= math.log(2.0)
    from_start = run.explore([2.0, 4.0], way, radius=0.3)
    assert from_start.xy.tolist() == found.xy.tolist()
    elsewhere = run.explore(target=[[1.0, 1.0], [4.0, 1.0], [4.0, 5.0], [1.0, 1.0]])
    assert (elsewhere.entropy, elsewhere.gain.max()) == (0.0, 0.0)
    ring = run.explore(target=[[6.9, 3.5], [9.6, 3.5], [9.6, 5.6], [6.9, 5.6], [6.9, 3.5]])
    assert ring.entropy == pytest.approx(run.explore().entropy)


def test_the_sensor_is_that_of_the_readings() -> None:
    angle = np.deg2rad(np.arange(-135.0, 135.5, 0.5))
    scans = [np.sort(np.random.default_rng(k).choice(len(angle), 200, replace=False)) for k in range(8)]
    turned = np.concatenate([angle[kept] + k for k, kept in enumerate(scans)])
    thinned = Readings.from_arrays((0.0, 0.0), turned, np.ones(len(turned)), scan=np.repeat(np.arange(8), 200))
    view, n_beams = field_of_view(thinned)
    assert view == pytest.approx(np.deg2rad(270.0), abs=0.05)
    assert n_beams == pytest.approx(541, rel=0.02)
    run = make_run()
    found = scanner_of(dataclasses.replace(run, manifest={"configuration": {"noise": 0.07}}))
    assert found is not None
    assert (found.field_of_view, found.n_beams, found.noise) == (2.0 * math.pi, 40, 0.07)
    sonar = Readings.from_arrays((0.0, 0.0), np.arange(8.0), np.ones(8), cone=0.3)
    ring = scanner_of(dataclasses.replace(run, laser=None, sonar=sonar))
    assert ring is not None
    assert (ring.field_of_view, ring.n_beams, ring.max_range, ring.cone) == (2.0 * math.pi, 8, 3.5, 0.3)
    assert len(dataclasses.replace(make_room_run(), laser=None, sonar=sonar_of(make_room_run())).explore().gain)


def sonar_of(run: Run) -> Readings:
    assert run.laser is not None
    return dataclasses.replace(run.laser, cone=np.full(run.laser.n_beams, 0.349))


def test_what_cannot_be_explored_is_refused_in_a_line() -> None:
    run = make_room_run()
    with pytest.raises(InputError, match=r"no draws yet"):
        make_run(n_draws=0).explore()
    with pytest.raises(InputError, match=r"no laser or sonar readings .* prf sample"):
        dataclasses.replace(run, laser=None).explore([2.0, 4.0])
    with pytest.raises(InputError, match=r"start \(5\.20, 4\.00\): .* in 0\.00 of the draws.*--radius"):
        run.explore([5.2, 4.0])
    with pytest.raises(InputError, match=r"start: \(20, 4\) lies outside the window"):
        run.explore([20.0, 4.0])
    with pytest.raises(InputError, match=r"target: \(8, 9\) lies outside the window"):
        run.explore(target=[[8.0, 1.0], [8.0, 9.0]])
    walls = ((1.5, 3.0, 2.6, 3.6), (1.5, 4.4, 2.6, 5.5), (1.0, 3.0, 1.6, 5.5), (2.4, 3.0, 3.0, 5.5))
    closet = draws_of([room_with(*walls)] * 48)
    with pytest.raises(InputError, match=r"no place can be reached from \(2\.00, 4\.00\)"):
        dataclasses.replace(run, draws=closet).explore([2.0, 4.0], radius=0.3)
    with pytest.raises(UsageError, match="radius -1"):
        run.explore(radius=-1.0)
    with pytest.raises(ArgumentError, match="start"):
        run.explore([1.0, 2.0, 3.0])
