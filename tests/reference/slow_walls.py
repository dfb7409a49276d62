"""Slow reference of maps of walls, from ``docs/walls.md`` alone: the log density, and that of every proposal.

Walls are rows ax, ay, bx, by, thickness. Ends are complex numbers; a wall has no first end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import stats
from scipy.special import i0e

from prf.kernels import constants as c
from prf.kernels.state.grid import Grid, make_grid
from prf.model.walls import WallPrior
from prf.model.window import Window

Floats = NDArray[np.float64]
SAME = 1e-9


class Plan(NamedTuple):
    """The prior with what is sampled of it, and what proposals depend on besides the map."""

    window: Window
    prior: WallPrior
    strength: float
    angle: float
    common: Floats
    aimed: float
    grid: Grid
    shares: dict[tuple[int, int], float]  # probability of each target, by column and row


class Bar(NamedTuple):
    """A wall from one of its ends."""

    a: complex
    b: complex
    t: float

    @property
    def length(self) -> float:
        return abs(self.b - self.a)

    @property
    def unit(self) -> complex:
        return (self.b - self.a) / abs(self.b - self.a)

    def seen(self, p: complex) -> complex:
        """Place along the wall, and across it to the left."""
        return (p - self.a) / self.unit

    def back(self) -> Bar:
        return Bar(self.b, self.a, self.t)

    def has(self, p: complex) -> bool:
        z = self.seen(p)
        return -0.05 <= z.real <= self.length + 0.05 and abs(z.imag) <= 0.5 * self.t + 0.05

    def polygon(self) -> shapely.Polygon:
        side = 0.5j * self.t * self.unit
        return shapely.Polygon([(z.real, z.imag) for z in (self.a - side, self.b - side, self.b + side, self.a + side)])


def bars(walls: Floats) -> list[Bar]:
    return [Bar(complex(ax, ay), complex(bx, by), t) for ax, ay, bx, by, t in walls.tolist()]


def log_thickness(t: float, common: Floats) -> float:
    if not 0.02 < t < 1.0:
        return -math.inf
    return math.log(0.25 / (t * math.log(50.0)) + 0.75 * stats.norm.pdf(t, common, 0.008).mean())


def log_density(walls: Floats, plan: Plan) -> float:
    """Log density to the unit Poisson process, the prior of what is sampled of it left out."""
    prior, found, total = plan.prior, bars(walls), 0.0
    for wall in found:
        theta = math.atan2(wall.unit.imag, wall.unit.real)
        total += math.log(prior.density / math.pi) + stats.lognorm(1.2, scale=prior.length).logpdf(wall.length)
        total += log_thickness(wall.t, plan.common)
        total += plan.strength * (math.cos(4.0 * (theta - plan.angle)) - 1.0) - math.log(i0e(plan.strength))
        others = [other for other in found if other is not wall]
        total -= prior.free_end * sum(not any(other.has(end) for other in others) for end in (wall.a, wall.b))
    return total - sum(pair_cost(one, other, prior.crossing) for one, other in itertools.combinations(found, 2))


def pair_cost(one: Bar, other: Bar, crossing: float) -> float:
    longer, shorter = (one, other) if one.length >= other.length else (other, one)
    cost, z = 0.0, [longer.seen(shorter.a), longer.seen(shorter.b)]
    if abs((z[1] - z[0]).imag) <= 0.26 * shorter.length:
        low, high = max(0.0, min(p.real for p in z)), min(longer.length, max(p.real for p in z))
        slope = (z[1] - z[0]).imag / (z[1] - z[0]).real
        gap = abs(z[0].imag + slope * (0.5 * (low + high) - z[0].real)) - 0.5 * (one.t + other.t)
        if low < high and gap <= 0.15:
            cost += 8.0 * (high - low) / abs((z[1] - z[0]).real)
    lines = [shapely.LineString([(w.a.real, w.a.imag), (w.b.real, w.b.imag)]) for w in (one, other)]
    joined = any(w.has(p) for w, v in ((one, other), (other, one)) for p in (v.a, v.b))
    return cost + (crossing if lines[0].intersects(lines[1]) and not joined else 0.0)


def weight(wall: Bar, plan: Plan) -> float:
    """How often a wall is picked beside others."""
    wide, fine = make_grid(*plan.window, 5.0 * plan.grid.cell), plan.grid
    n = 1 + int(wall.length / wide.cell)
    middles = [(fine.x0 + (i + 0.5) * fine.cell, fine.y0 + (k + 0.5) * fine.cell) for i, k in plan.shares]
    for part in np.arange(n + 1) / n:
        here = wall.a + part * (wall.b - wall.a)
        i, k = (here.real - wide.x0) // wide.cell, (here.imag - wide.y0) // wide.cell
        away = [max(abs((x - wide.x0) // wide.cell - i), abs((y - wide.y0) // wide.cell - k)) for x, y in middles]
        if min(away, default=0.0) <= 1.0:
            return 8.0
    return 1.0


def log_pick(wall: Bar, walls: list[Bar], plan: Plan) -> float:
    """Log probability that a wall is picked among all of a map."""
    return math.log(weight(wall, plan) / sum(weight(each, plan) for each in walls))


def is_same(one: Bar, other: Bar) -> bool:
    return any(abs(w.a - other.a) + abs(w.b - other.b) + abs(w.t - other.t) < SAME for w in (one, one.back()))


def difference(x: Floats, y: Floats) -> tuple[list[Bar], list[Bar], list[Bar]]:
    """Walls of x that go, those that come, and those that stay."""
    old, new = bars(x), bars(y)
    stay = [wall for wall in old if any(is_same(wall, other) for other in new)]
    gone = [wall for wall in old if not any(wall is other for other in stay)]
    return gone, [wall for wall in new if not any(is_same(wall, other) for other in stay)], stay


def log_birth(wall: Bar, plan: Plan) -> float:
    theta = math.atan2(wall.unit.imag, wall.unit.real)
    fourfold = (4.0 * (theta - plan.angle) + math.pi) % (2.0 * math.pi)
    # scipy's wrapped Cauchy law lies on (0, 2 pi), its peak at 0.
    about = 2.0 * stats.wrapcauchy.pdf((fourfold + math.pi) % (2.0 * math.pi), 0.95)
    direction = 0.5 / math.pi + 0.5 * about if plan.strength > 0.0 else 1.0 / math.pi
    straight = direction * stats.lognorm(1.2, scale=plan.prior.length).pdf(wall.length)
    area = plan.grid.cell**2

    def cell(p: complex) -> tuple[int, int]:
        return int((p.real - plan.grid.x0) / plan.grid.cell), int((p.imag - plan.grid.y0) / plan.grid.cell)

    def near(i: tuple[int, int]) -> list[tuple[int, int]]:
        return [k for k in plan.shares if (i[0] - k[0]) ** 2 + (i[1] - k[1]) ** 2 <= 144]

    middle = ends = 0.0
    for one in (wall, wall.back()):
        right = -0.5j * one.t * one.unit
        p, q = cell(one.a + right), cell(one.b + right)
        middle += 0.5 * plan.shares.get(cell(0.5 * (one.a + one.b) + right), 0.0) / area
        for first, second in ((p, q), (q, p)):
            if first in plan.shares and second in near(first):
                ends += 0.5 * plan.shares[first] / area / (len(near(first)) * area)
    aimed = 0.5 * plan.aimed * (straight * middle + wall.length * ends)
    return math.log(aimed + (1.0 - plan.aimed) * straight / plan.window.area) + log_thickness(wall.t, plan.common)


def log_step(size: float, least: float, most: float) -> float:
    """Log density of a normal step whose scale is even in its logarithm."""
    scale = np.geomspace(least, most, 4001)
    return math.log(np.trapezoid(stats.norm.pdf(size, 0.0, scale), np.log(scale)) / math.log(most / least))


def joint_spans(wall: Bar, stay: list[Bar]) -> Iterator[tuple[float, float]]:
    """Lengths between which the second end would lie in another wall."""
    far = wall.a + 1e3 * wall.unit
    ray = shapely.LineString([(wall.a.real, wall.a.imag), (far.real, far.imag)])
    for other in stay:
        part = ray.intersection(other.polygon())
        if part.length > 0.0:
            along = [wall.seen(complex(*p)).real for p in part.coords]
            yield min(along), max(along)


def log_end(wall: Bar, length: float, stay: list[Bar]) -> float:
    spans = list(joint_spans(wall, stay))
    weight = [1.0 / (1.0 + (0.5 * (low + high) - wall.length) ** 2) for low, high in spans]
    joint = sum(w / (high - low) for w, (low, high) in zip(weight, spans, strict=True) if low <= length <= high)
    off = 0.5 * stats.laplace.pdf(length, wall.length, 0.5)
    return math.log((0.5 * joint / sum(weight) if weight else 0.0) + off)


def log_cubed(value: float, most: float) -> float:
    return -math.log(6.0 * most) - 2.0 / 3.0 * math.log(abs(value) / most)


def behind(first: Bar, second: Bar) -> tuple[float, float, float, float] | None:
    """Gap, displacement, turn and thickening of a second part behind a first one; None if it cannot be one."""
    z, turn = first.seen(second.a) - first.length, second.unit / first.unit
    found = z.real, z.imag, math.atan2(turn.imag, turn.real), second.t - first.t
    fits = -0.25 < found[0] < 3.0 and abs(found[1]) < 0.1 and abs(found[2]) < 0.1 and abs(found[3]) < 0.1
    return found if fits and found[0] + second.length > 0.0 else None


def both_ways(walls: list[Bar]) -> list[Bar]:
    return [way for wall in walls for way in (wall, wall.back())]


def log_gap(walls: list[Bar], whole: Bar, parts: list[Bar], plan: Plan) -> float:
    """Log density of splitting a wall into two parts; -inf where it cannot be."""
    total, picked = 0.0, log_pick(whole, walls, plan)
    for one, other in (parts, parts[::-1]):
        for base, first, second in itertools.product((whole, whole.back()), (one, one.back()), (other, other.back())):
            drawn = behind(first, second)
            own_line = abs(first.a - base.a) < SAME and abs(first.unit - base.unit) < SAME
            if drawn is None or not own_line or abs(first.t - base.t) > SAME:
                continue
            if abs(first.length + drawn[0] + second.length - base.length) > SAME:
                continue
            width = math.log((0.5 + math.sqrt(3.0)) * 2.0 * math.sqrt(abs(drawn[0])))
            place = picked - math.log(2.0 * base.length) - width
            total += math.exp(place + sum(log_cubed(value, 0.1) for value in drawn[1:]))
    return math.log(total) if total > 0.0 else -math.inf


def log_merge(walls: list[Bar], parts: list[Bar], whole: Bar, plan: Plan) -> float:
    """Log density of merging two walls into one."""
    total = 0.0
    for one, other in (parts, parts[::-1]):
        others = both_ways([wall for wall in walls if wall is not one])
        for first in (one, one.back()):
            fitting = [second for second in others if behind(first, second) is not None]
            for second in both_ways([other]):
                if behind(first, second) is None:
                    continue
                length = first.length + behind(first, second)[0] + second.length  # type: ignore[index]
                if is_same(Bar(first.a, first.a + length * first.unit, first.t), whole):
                    total += 0.5 * math.exp(log_pick(one, walls, plan)) / len(fitting)
    return math.log(total) if total > 0.0 else -math.inf


class Box(NamedTuple):
    """What two walls are filled to, and what it does not have: how far one passes, off its place, and turned."""

    bar: Bar
    past: float
    near: float
    turn: float


def filled(base: Bar, other: Bar, quarters: int) -> Box | None:
    """The box round two walls whose right faces look outwards, the second so many right angles after the first."""
    origin = base.a - 0.5j * base.t * base.unit
    p, q = ((end - 0.5j * other.t * other.unit - origin) / base.unit for end in (other.a, other.b))
    turn, middle = np.angle((q - p) / 1j**quarters), 0.5 * (p + q)
    if quarters == 2:
        low, high, t = 0.0, base.length, middle.imag
        past, near = other.length - base.length, middle.real - 0.5 * base.length
    else:
        low, high = (0.0, middle.real) if quarters == 1 else (middle.real, base.length)
        near, t = middle.imag - 0.5 * other.length, middle.imag + 0.5 * other.length
        past = base.length - (high - low)
    if not (abs(past) < 1.0 and abs(near) < 0.5 and abs(turn) < 0.1 and 0.02 < t < 1.0 and low < high):
        return None
    a, b = (origin + (x + 0.5j * t) * base.unit for x in (low, high))
    return Box(Bar(a, b, t), past, near, float(turn))


def fill_ratios(walls: list[Bar], parts: list[Bar], box: Bar, plan: Plan) -> list[float]:
    """Log of the density of making two walls of a box over that of filling them, in each way that does both.

    `walls` are those of the map with both.
    """
    found, boxed = [], [box, *(wall for wall in walls if not any(is_same(wall, part) for part in parts))]
    for base, other in ((parts[0], parts[1]), (parts[1], parts[0])):
        rest = both_ways([wall for wall in walls if not is_same(wall, base)])
        for way, side, quarters in itertools.product((base, base.back()), (other, other.back()), (1, 2, 3)):
            made = filled(way, side, quarters)
            if made is None or not is_same(made.bar, box):
                continue
            hollow = log_pick(box, boxed, plan) + log_cubed(made.past, 1.0) + log_cubed(made.near, 0.5)
            hollow += log_cubed(made.turn, 0.1) + sum(log_thickness(wall.t, plan.common) for wall in parts)
            fitting = sum(filled(way, wall, quarters) is not None for wall in rest)
            found.append(hollow - log_pick(base, walls, plan) + math.log(fitting))
    return found


def log_ratios(move: int, x: Floats, y: Floats, plan: Plan) -> list[float]:
    """Log of the density of the way back over that of the proposal, by each law that may have made it."""
    gone, come, stay = difference(x, y)
    n = len(x)
    if move == c.WALL_BIRTH:
        return [-math.log(n + 1) - log_birth(come[0], plan)]
    if move == c.WALL_DEATH:
        return [log_birth(gone[0], plan) + math.log(n)]
    if move == c.GAP:
        return [log_merge(bars(y), come, gone[0], plan) - log_gap(bars(x), gone[0], come, plan)]
    if move == c.MERGE_WALLS:
        return [log_gap(bars(y), come[0], gone, plan) - log_merge(bars(x), gone, come[0], plan)]
    if move == c.HOLLOW:
        return [-each for each in fill_ratios(bars(y), come, gone[0], plan)]
    if move == c.FILL_WALLS:
        return fill_ratios(bars(x), gone, come[0], plan)
    picked = log_pick(come[0], bars(y), plan) - log_pick(gone[0], bars(x), plan)
    return [picked + each for each in change_ratios(move, gone[0], come[0], stay, plan)]


def change_ratios(move: int, old: Bar, new: Bar, stay: list[Bar], plan: Plan) -> list[float]:
    """The same of a move of one wall, once it is picked."""
    new = new if (new.unit / old.unit).real > 0.0 else new.back()
    if move == c.MOVE_END:
        old, new = (old, new) if abs(old.a - new.a) < SAME else (old.back(), new.back())
        assert max(abs(old.a - new.a), abs(old.unit - new.unit), abs(old.t - new.t)) < SAME
        return [log_end(new, old.length, stay) - log_end(old, new.length, stay)]
    if move == c.THICKNESS:
        return [
            log_step(old.t - new.t, 0.004, 0.2) - log_step(new.t - old.t, 0.004, 0.2),
            *depth_ratios(old, new, plan),
        ]
    # A short wall may turn by more than a right angle.
    return [0.0] if is_step(move, old, new) or is_step(move, old, new.back()) else []


def faces(bar: Bar) -> list[tuple[complex, complex, float]]:
    """Both ends of each face of a wall, counter-clockwise, and how deep the wall is behind it."""
    x, y = np.array(bar.polygon().exterior.coords)[:4].T
    corner = (x + 1j * y).tolist()
    return [(corner[k], corner[(k + 1) % 4], abs(corner[(k + 2) % 4] - corner[(k + 1) % 4])) for k in range(4)]


def depth_ratios(old: Bar, new: Bar, plan: Plan) -> list[float]:
    """Log of the ratio of densities where two walls share a face."""

    def log_depth(depth: float) -> float:
        length = stats.lognorm(1.2, scale=plan.prior.length).pdf(depth)
        return math.log(0.5 * math.exp(log_thickness(depth, plan.common)) + 0.5 * length)

    both = itertools.product(faces(old), faces(new))
    return [log_depth(was) - log_depth(now) for (a, b, was), (p, q, now) in both if abs(a - p) + abs(b - q) < SAME]


def is_step(move: int, old: Bar, new: Bar) -> bool:
    """Whether a wall may have been shifted, turned or extended so."""
    if abs(old.t - new.t) > SAME:
        return False
    if move == c.SHIFT_WALL:
        by = (new.a - old.a) / old.unit
        return abs(new.b - old.b - (new.a - old.a)) < SAME and min(abs(by.real), abs(by.imag)) < SAME
    if move == c.TURN_WALL:
        pivots = (abs(new.a - old.a), abs(new.b - old.b), abs(new.a + new.b - old.a - old.b))
        return abs(new.length - old.length) < SAME and min(pivots) < SAME
    return abs(new.unit - old.unit) < SAME and min(abs(new.a - old.a), abs(new.b - old.b)) < SAME
