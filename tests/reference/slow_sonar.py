"""Sonar as section 2.3 of the paper and docs/sensor-models.md write it down, in plain numpy and scipy. No kernels.

What a cone sees is found without a sweep: every edge casts its shadow on every other, one pair at a time.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import integrate, special, stats

from prf.model.coloring import Coloring
from prf.model.window import INTERIOR, Window
from tests.reference.beams import normal

Floats = NDArray[np.float64]
Part = tuple[float, float]
"""Two bounds, the lower one first: of angles, or of places along an edge in [0, 1]."""

SLIVER = 1e-9
"""Radians: thinner parts are not seen, such as rounding leaves between two shadows that meet in a corner."""


class Ring(NamedTuple):
    """Parameters of the sonar model, by their short names."""

    max: float = 3.5
    noise: float = 0.03
    relative: float = 0.02
    corner: tuple[float, float] = (1.0, 0.5)  # bias, loss a metre
    surface: tuple[float, float, float, float] = (2.4, 0.5, 16.0, 6.0)  # bias, loss a metre, a radian; gain a radian
    uniform: float = 0.2
    short: float = 0.05
    short_length: float = 0.5

    def spread(self, d: float) -> float:
        return max(self.noise, self.relative * d)


class Cone(NamedTuple):
    """Where a sonar stands and looks, and its full field of view in radians."""

    x: float
    y: float
    angle: float
    view: float


class Feature(NamedTuple):
    """A visible part of an edge, or a visible corner: projection and subtended are 0."""

    depth: float
    projection: float
    subtended: float
    is_corner: bool


def in_frame(cone: Cone, xy: Floats) -> NDArray[np.complex128]:
    """Points as complex numbers in the frame of the sonar: it stands at 0 and looks along the real axis."""
    z: NDArray[np.complex128] = (xy[..., 0] - cone.x + 1j * (xy[..., 1] - cone.y)) * np.exp(-1j * cone.angle)
    return z


def cross(a: complex, b: complex) -> float:
    return a.real * b.imag - a.imag * b.real


def place_at(a: complex, b: complex, angle: float) -> float:
    """Where along the line from a to b the ray of this angle meets it."""
    ray = complex(math.cos(angle), math.sin(angle))
    return cross(ray, a) / cross(ray, a - b)


def within_disc(a: complex, b: complex, radius: float) -> Part | None:
    """The places along ab within the disc, by the roots of |a + t (b - a)|^2 = radius^2."""
    d = b - a
    roots = np.roots([abs(d) ** 2, 2.0 * (a * d.conjugate()).real, abs(a) ** 2 - radius**2])
    if np.abs(roots.imag).max() > 0.0:
        return None
    low, high = max(0.0, float(roots.real.min())), min(1.0, float(roots.real.max()))
    return (low, high) if low < high else None


def seen_alone(a: complex, b: complex, view: float, radius: float) -> Part | None:
    """The angles within the cone under which ab would be seen, were there nothing else; its far end may be cut off."""
    t = within_disc(a, b, radius)
    if t is None:
        return None
    ends = sorted(float(np.angle(a + s * (b - a))) for s in t)
    if ends[1] - ends[0] >= math.pi:  # it passes behind the sonar, and looks out on one side at most
        ends = [ends[1], math.pi] if ends[1] < 0.5 * view else [-math.pi, ends[0]]
    low, high = max(ends[0], -0.5 * view), min(ends[1], 0.5 * view)
    return (low, high) if high - low > SLIVER else None


def without(parts: list[Part], shadow: Part) -> list[Part]:
    """What is left of disjoint intervals outside another one."""
    left = []
    for low, high in parts:
        left += [(low, min(high, shadow[0])), (max(low, shadow[1]), high)]
    return [(low, high) for low, high in left if high - low > SLIVER]


def distance_at(line: tuple[complex, complex], angle: float) -> float:
    a, b = line
    return abs(a + place_at(a, b, angle) * (b - a))


def visible_parts(lines: list[tuple[complex, complex]], view: float, radius: float) -> list[list[Part]]:
    """The angles under which each line is seen: those that it fills, without the shadows of what stands before it."""
    alone = [seen_alone(a, b, view, radius) for a, b in lines]
    found = []
    for i, own in enumerate(alone):
        parts = [] if own is None else [own]
        for k, other in enumerate(alone):
            if own is None or other is None or k == i:
                continue
            low, high = max(own[0], other[0]), min(own[1], other[1])
            # They do not cross: which is nearer in the middle is nearer all over.
            if low < high and distance_at(lines[k], 0.5 * (low + high)) < distance_at(lines[i], 0.5 * (low + high)):
                parts = without(parts, other)
        found.append(parts)
    return found


def surface(a: complex, b: complex, part: Part) -> Feature:
    """What a visible part of the edge ab is to the sonar."""
    t = sorted(place_at(a, b, angle) for angle in part)
    foot = -(a * (b - a).conjugate()).real / abs(b - a) ** 2
    near = a + min(max(foot, t[0]), t[1]) * (b - a)
    turn = abs(float(np.angle((b - a) / near)))
    return Feature(abs(near), min(turn, math.pi - turn), part[1] - part[0], False)


def is_between(a: complex, b: complex, v: complex) -> bool:
    """Whether the line from a to b crosses the segment from the sonar to v."""
    beyond = cross(b - a, v - a) * cross(b - a, -a) < 0.0
    return beyond and cross(v, a) * cross(v, b) < 0.0


def features(coloring: Coloring, cone: Cone, radius: float) -> list[Feature]:
    """All features of the map that this sonar sees, nearest first."""
    z = in_frame(cone, coloring.xy)
    edges = coloring.edges.tolist()
    lines = [(complex(z[i]), complex(z[k])) for i, k in edges]
    found = [
        surface(*line, part)
        for line, parts in zip(lines, visible_parts(lines, cone.view, radius), strict=True)
        for part in parts
    ]
    for v in np.flatnonzero(coloring.side == INTERIOR).tolist():
        at = complex(z[v])
        if abs(np.angle(at)) > 0.5 * cone.view or abs(at) > radius:
            continue
        if not any(is_between(*line, at) for line, ends in zip(lines, edges, strict=True) if v not in ends):
            found.append(Feature(abs(at), 0.0, 0.0, True))
    return in_order(found)


def in_order(found: Iterable[Feature]) -> list[Feature]:
    """Nearest first; of features at one depth (a surface seen from its corner on) the surface first."""
    return sorted(found, key=lambda f: (round(f.depth, 7), f.is_corner, round(f.projection, 7), f.subtended))


def return_probability(ring: Ring, feature: Feature) -> float:
    """q: a corner's depends on the distance alone."""
    if feature.is_corner:
        return float(special.expit(ring.corner[0] - ring.corner[1] * feature.depth))
    bias, metre, oblique, subtended = ring.surface
    away = 0.5 * math.pi - feature.projection
    return float(special.expit(bias - metre * feature.depth - oblique * away + subtended * feature.subtended))


def weights(ring: Ring, seen: Iterable[Feature]) -> Floats:
    """Chance that each feature, nearest first, and (last) none of them returns the pulse."""
    q = np.array([return_probability(ring, feature) for feature in seen])
    left = np.concatenate([[1.0], np.cumprod(1.0 - q)])
    return np.append(left[:-1] * q, left[-1])


def density(ring: Ring, seen: list[Feature], r: Floats) -> Floats:
    """Density of readings r below the maximum range."""
    chance = weights(ring, seen)
    stray = ring.uniform / ring.max + ring.short * np.exp(-r / ring.short_length) / ring.short_length
    total = chance[-1] * stray
    for share, feature in zip(chance, seen, strict=False):
        s = ring.spread(feature.depth)
        total = total + share * normal(r, feature.depth, s) / special.ndtr(feature.depth / s)
    return np.asarray(total, dtype=np.float64)


def mass_from(ring: Ring, seen: list[Feature], bound: float) -> float:
    """Probability of a reading of `bound` or more."""
    chance = weights(ring, seen)
    missed = 1.0 - ring.uniform - ring.short
    stray = missed + ring.uniform * (1.0 - bound / ring.max) + ring.short * math.exp(-bound / ring.short_length)
    total = chance[-1] * stray
    for share, feature in zip(chance, seen, strict=False):
        s = ring.spread(feature.depth)
        total += share * special.ndtr((feature.depth - bound) / s) / special.ndtr(feature.depth / s)
    return float(total)


def mass_of_no_return(ring: Ring, seen: list[Feature]) -> float:
    """Probability of a reading of the maximum range or more."""
    return mass_from(ring, seen, ring.max)


def log_likelihood(ring: Ring, seen: list[Feature], reading: float, reach: float = math.inf) -> float:
    """Log density, given the features that are seen within the reach; a farther reading is as none."""
    bound = min(reach, ring.max)
    if reading < bound:
        return math.log(float(density(ring, seen, np.array(reading))))
    return math.log(mass_from(ring, seen, bound))


def reach_in(window: Window, cone: Cone, maximum: float) -> float:
    """How far a sonar reaches: up to where its cone first leaves the window, and no farther than the maximum range."""
    far = 3.0 * (window.width + window.height)
    turn = cone.angle + cone.view * np.linspace(-0.5, 0.5, 9)
    rim = np.stack([cone.x + far * np.cos(turn), cone.y + far * np.sin(turn)], axis=1)
    outside = shapely.Polygon([(cone.x, cone.y), *rim]) & shapely.box(*window).exterior
    return min(maximum, float(shapely.distance(shapely.Point(cone.x, cone.y), outside)))


def total(ring: Ring, seen: list[Feature]) -> float:
    """Integral of the density in pieces round its peaks, and the point mass: 1."""
    peaks = {f.depth + k * ring.spread(f.depth) for f in seen for k in (-40, -8, -3, -1, 0, 1, 3, 8, 40)}
    cuts = [0.0, *sorted(cut for cut in peaks if 0.0 < cut < ring.max), ring.max]
    pieces = [
        integrate.quad(lambda r: float(density(ring, seen, np.array(r))), a, b, epsabs=1e-13)[0]
        for a, b in itertools.pairwise(cuts)
    ]
    return sum(pieces) + mass_of_no_return(ring, seen)


def draw_reading(ring: Ring, seen: list[Feature], rng: np.random.Generator, reach: float = math.inf) -> float:
    """A reading at random, given the features within the reach; inf for no return up to there."""
    which = int(rng.choice(len(seen) + 1, p=weights(ring, seen)))
    if which < len(seen):
        depth = seen[which].depth
        s = ring.spread(depth)
        found = float(stats.truncnorm.rvs(-depth / s, math.inf, depth, s, random_state=rng))
    else:
        kind = rng.random()
        found = math.inf
        if kind < ring.uniform:
            found = float(rng.uniform(0.0, ring.max))
        elif kind < ring.uniform + ring.short:
            found = float(rng.exponential(ring.short_length))
    return found if found < min(reach, ring.max) else math.inf
