"""A second sampler of posteriors over maps, which shares nothing with the first: disagreement loops, in plain Python.

A map is read as the history of particles that move in time x (the dynamic representation,
``prf.kernels.arak_sampler``). A proposal adds a birth, takes one away, or turns a particle anew where it turned, and
lets the particles live again: each keeps to its old path as long as it lived, and who outlives its old end, because its
partner does not come, goes on by fresh random numbers. Old and new map differ by a loop then, and the prior is left
alone but for the numbers of births and turns to choose from (Schreiber, arXiv 0802.2115; Kluszczyński, van Lieshout,
Schreiber 2007):

    a birth more    Lambda / (n + 1),        a birth less    n / Lambda,        a turn anew    t / t',

times the ratio of the likelihoods; n births inside or on a side, t turns before and t' after, and Lambda = pi p^2 A +
p P the mean number of births in a window of area A and perimeter P. Time runs along a direction drawn anew each step.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from prf.model.coloring import Coloring, black_at
from prf.model.window import BOTTOM, INTERIOR, LEFT, RIGHT, TOP, Window

Point = tuple[float, float]

BORDER = "border"
"""The particle's piece ends on a side."""
TURN = "turn"
"""It ends at a turn: on its old path if there is more of it, else in a fresh direction."""
MEETING = "meeting"
"""It ends where its old path met another."""


class Stop(NamedTuple):
    """End of a straight piece of a particle's path.

    Attributes
    ----------
    at : tuple of two floats
    kind : str
    label : int
        Side of the window, or the number of the old vertex of a meeting.
    """

    at: Point
    kind: str
    label: int = INTERIOR


Path = list[Stop]
"""Where a particle's pieces ended, one after the other; empty: all is fresh, the direction too."""


@dataclass
class Birth:
    """Where one particle starts, on a side, or two, inside; and the paths that they keep to."""

    at: Point
    side: int
    paths: list[Path]


@dataclass
class Particle:
    """A particle on a straight piece that began at vertex `vertex`."""

    vertex: int
    start: Point
    slope: float
    stop: Stop
    rest: Path
    is_fresh: bool

    def height(self, x: float) -> float:
        return self.start[1] + self.slope * (x - self.start[0])


@dataclass
class Drawing:
    """The graph as it comes to be."""

    xy: list[Point] = field(default_factory=list)
    side: list[int] = field(default_factory=list)
    edges: list[tuple[int, int]] = field(default_factory=list)

    def add(self, at: Point, side: int) -> int:
        self.xy.append(at)
        self.side.append(side)
        return len(self.xy) - 1


def births_of(coloring: Coloring) -> list[Birth]:
    """Read a map as the history of its particles."""
    xy, side = [(float(x), float(y)) for x, y in coloring.xy], coloring.side.tolist()
    onward: dict[int, list[int]] = {v: [] for v in range(len(xy))}
    n_before = dict.fromkeys(onward, 0)
    for a, b in coloring.edges.tolist():
        first, last = (a, b) if xy[a][0] < xy[b][0] else (b, a)
        onward[first].append(last)
        n_before[last] += 1

    def path(v: int) -> Path:
        stops = []
        while side[v] == INTERIOR and onward[v]:
            stops.append(Stop(xy[v], TURN))
            (v,) = onward[v]
        return [*stops, Stop(xy[v], MEETING, v) if side[v] == INTERIOR else Stop(xy[v], BORDER, side[v])]

    return [Birth(xy[v], side[v], [path(w) for w in onward[v]]) for v in onward if onward[v] and n_before[v] == 0]


def turned_direction(slope: float, rng: np.random.Generator) -> float:
    """Slope after a turn by an angle of density sin(d) / 2 on (0, pi)."""
    return math.tan(math.atan(slope) + math.acos(1.0 - 2.0 * rng.random()))


class History:
    """Particles that live in a window [0, width] x [0, height] at scale p."""

    def __init__(self, window: Window, p: float, rng: np.random.Generator) -> None:
        self.window, self.p, self.rng = window, p, rng
        self.drawing = Drawing()
        self.alive: list[Particle] = []

    def live(self, births: list[Birth]) -> Drawing:
        """Let all be born in turn, and live until no particle is left."""
        now = 0.0
        for birth in sorted(births, key=lambda birth: birth.at[0]):
            now = self.advance(now, birth.at[0])
            self.give(birth)
        self.advance(now, math.inf)
        return self.drawing

    def advance(self, now: float, until: float) -> float:
        """Let things happen up to the time `until`."""
        while self.alive:
            meeting = self.next_meeting(now)
            ending = min(self.alive, key=lambda one: one.stop.at[0])
            time = min(ending.stop.at[0], math.inf if meeting is None else meeting[0])
            if time > until:
                break
            now = time
            if meeting is not None and meeting[0] == time:
                self.die((time, meeting[1].height(time)), INTERIOR, meeting[1:])
            else:
                self.end(ending)
        return until

    def give(self, birth: Birth) -> None:
        """Start the particles of a birth."""
        vertex = self.drawing.add(birth.at, birth.side)
        slopes = iter(self.first_slopes(birth.side))
        for path in birth.paths:
            slope = next(slopes)
            self.set_out(vertex, birth.at, slope, path)

    def first_slopes(self, side: int) -> list[float]:
        """Fresh directions: two inside, one on the left, bottom or top side."""
        u = self.rng.random()
        if side == INTERIOR:
            first = math.tan(math.pi * (u - 0.5))
            return [first, turned_direction(first, self.rng)]
        if side == LEFT:
            return [math.tan(math.asin(2.0 * u - 1.0))]
        return [math.tan(math.acos(1.0 - u)) * (1.0 if side == BOTTOM else -1.0)]

    def set_out(self, vertex: int, at: Point, slope: float, path: Path) -> None:
        """Start a piece at a vertex: towards the next stop of the old path, or in a fresh direction."""
        if path:
            (x, y), rest = path[0].at, path[1:]
            old = (y - at[1]) / (x - at[0])
            self.alive.append(Particle(vertex, at, old, path[0], rest, False))
        else:
            self.alive.append(Particle(vertex, at, slope, self.fresh_stop(at, slope), [], True))

    def fresh_stop(self, at: Point, slope: float) -> Stop:
        """A turn after a length Exp(2p), or the border if that comes first."""
        x, y = at
        goal = self.window.height if slope > 0.0 else 0.0
        side_x = x + (goal - y) / slope if slope != 0.0 else math.inf
        turn_x = x + self.rng.exponential(0.5 / self.p) / math.hypot(1.0, slope)
        if turn_x < min(side_x, self.window.width):
            return Stop((turn_x, y + slope * (turn_x - x)), TURN)
        if side_x < self.window.width:
            return Stop((side_x, goal), BORDER, TOP if slope > 0.0 else BOTTOM)
        return Stop((self.window.width, y + slope * (self.window.width - x)), BORDER, RIGHT)

    def next_meeting(self, now: float) -> tuple[float, Particle, Particle] | None:
        """The first meeting of which an old map knows nothing: one of the two is fresh."""
        found = []
        for a, b in itertools.combinations(self.alive, 2):
            if not (a.is_fresh or b.is_fresh) or a.vertex == b.vertex or a.slope == b.slope:
                continue
            x = (b.height(0.0) - a.height(0.0)) / (a.slope - b.slope)
            if now < x < min(a.stop.at[0], b.stop.at[0]):
                found.append((x, a, b))
        return min(found, key=lambda meeting: meeting[0]) if found else None

    def end(self, one: Particle) -> None:
        """Let a particle reach the end of its piece."""
        if one.stop.kind == MEETING:
            others = [other for other in self.alive if other is not one and other.stop == one.stop]
            if others:
                self.die(one.stop.at, INTERIOR, (one, others[0]))
            else:  # its partner did not come
                one.stop, one.is_fresh = self.fresh_stop(one.stop.at, one.slope), True
        elif one.stop.kind == BORDER:
            self.die(one.stop.at, one.stop.label, (one,))
        else:
            vertex = self.die(one.stop.at, INTERIOR, (one,))
            self.set_out(vertex, one.stop.at, turned_direction(one.slope, self.rng), one.rest)

    def die(self, at: Point, side: int, those: tuple[Particle, ...]) -> int:
        """End the pieces of particles at a vertex."""
        vertex = self.drawing.add(at, side)
        for one in those:
            self.drawing.edges.append((one.vertex, vertex))
            self.alive.remove(one)
        return vertex


def quarter_turn(coloring: Coloring) -> Coloring:
    """Turn a map and its window, whose lower left corner is at 0, by 90 degrees counter-clockwise."""
    window = coloring.window
    xy = np.column_stack([window.height - coloring.xy[:, 1], coloring.xy[:, 0]])
    side = np.where(coloring.side == INTERIOR, INTERIOR, (coloring.side + 1) % 4).astype(np.int8)
    return coloring._replace(window=Window(0.0, 0.0, window.height, window.width), xy=xy, side=side)


def turned(coloring: Coloring, quarters: int) -> Coloring:
    """Turn a map by so many right angles."""
    for _ in range(quarters % 4):
        coloring = quarter_turn(coloring)
    return coloring


def mean_births(window: Window, p: float) -> float:
    """Lambda: births inside, and of particles that come in over a side."""
    return math.pi * p * p * window.area + p * window.perimeter


def fresh_birth(window: Window, p: float, rng: np.random.Generator) -> Birth:
    """A birth at random: inside, on the left side (rate 2p), on the bottom or the top (rate p)."""
    inside = math.pi * p * p * window.area
    u, share = rng.random() * mean_births(window, p), rng.random()
    if u < inside:
        return Birth((share * window.width, rng.random() * window.height), INTERIOR, [[], []])
    u = (u - inside) / p
    if u < 2.0 * window.height:
        return Birth((0.0, share * window.height), LEFT, [[]])
    if u < 2.0 * window.height + window.width:
        return Birth((share * window.width, 0.0), BOTTOM, [[]])
    return Birth((share * window.width, window.height), TOP, [[]])


def turns_of(births: list[Birth]) -> list[tuple[int, int, int]]:
    """Birth, particle and place on its path of every turn."""
    return [
        (b, k, place)
        for b, birth in enumerate(births)
        for k, path in enumerate(birth.paths)
        for place, stop in enumerate(path)
        if stop.kind == TURN
    ]


def proposed(coloring: Coloring, p: float, mean: float, rng: np.random.Generator) -> tuple[Coloring, float] | None:
    """A map that differs by a loop, time running along x, and the ratio that the numbers to choose from give.

    `mean` is Lambda.
    """
    births = births_of(coloring)
    n, kind = len(births), rng.random()
    turns = turns_of(births)
    if kind < 0.35:
        births.append(fresh_birth(coloring.window, p, rng))
        ratio = mean / (n + 1)
    elif kind < 0.7:
        if n == 0:
            return None
        del births[rng.integers(n)]
        ratio = n / mean
    else:
        if not turns:
            return None
        b, k, place = turns[rng.integers(len(turns))]
        births[b].paths[k] = births[b].paths[k][: place + 1]
        ratio = float(len(turns))
    drawing = History(coloring.window, p, rng).live(births)
    found = Coloring(
        coloring.window,
        np.array(drawing.xy).reshape(-1, 2),
        np.array(drawing.side, np.int8),
        np.array(drawing.edges, np.int32).reshape(-1, 2),
        coloring.anchor_black,
    )
    if kind >= 0.7:
        ratio /= len(turns_of(births_of(found)))
    return found, ratio


def painted(coloring: Coloring, pin: Point, black: bool) -> Coloring:
    """The map in which the point `pin` has this colour."""
    is_black = bool(black_at(coloring, np.array([pin]))[0])
    return coloring._replace(anchor_black=coloring.anchor_black ^ (is_black != black))


def sample(
    start: Coloring,
    p: float,
    log_likelihood: Callable[[Coloring], float],
    pin: Point,
    rng: np.random.Generator,
    surplus: float = 1.0,
) -> Iterator[Coloring]:
    """Yield the map after every step.

    Parameters
    ----------
    start : Coloring
        Of a window whose lower left corner is at 0.
    p : float
        Scale, 1/m.
    log_likelihood : callable
        -inf where a sensor stands in black.
    pin : tuple of two floats
        The point whose colour a loop does not change: of a sensor, if there is one. In one step of ten it is changed.
    rng : numpy.random.Generator
    surplus : float
        Other than 1 makes a mistake: so many times Lambda is taken for it.
    """
    mean = surplus * mean_births(start.window, p)
    present, value, black = start, log_likelihood(start), bool(black_at(start, np.array([pin]))[0])
    while True:
        quarters = int(rng.integers(4))
        flips = rng.random() < 0.1
        found = (present, 1.0) if flips else proposed(turned(present, quarters), p, mean, rng)
        if found is not None:
            loop, ratio = found
            wanted = black != flips
            candidate = painted(loop if flips else turned(loop, 4 - quarters), pin, wanted)
            new = log_likelihood(candidate)
            if math.log(1.0 - rng.random()) < new - value + math.log(ratio):
                present, value, black = candidate, new, wanted
        yield present
