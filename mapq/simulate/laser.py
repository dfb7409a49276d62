"""The nodding laser: which beams are kept, where they start and point, and what returns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import SimulateSettings
from mapq.kernels.raycast import NOTHING, cast_beams
from mapq.simulate.robot import Trajectory
from mapq.simulate.scene import Kind, World

Floats = NDArray[np.float64]

BEAMS = 180
"""Beams of a scan, one a degree, from the right to the left."""

SCAN_RATE = 75.0
"""Scans per second of a SICK LMS at one degree."""

MOUNT = 1.3
"""Height of the laser in metres."""

NOD_MIDDLE, NOD_REACH, NOD_PERIOD = 16.0, 42.0, 1.4
"""The scan plane's pitch: its middle and its reach in degrees (up is positive), and seconds of one nod."""

SPOT = 0.25
"""Half the angle in degrees over which one beam sees; two things within it give a mixed range."""

MIXED_CHANCE = 0.2
"""Chance that a beam across an edge returns a range between its two sides."""

MIXED_STEP = (0.15, 4.0)
"""Metres between the sides of an edge that mix; farther apart, the nearer one wins."""

LOST = 0.01
"""Share of returns lost for no reason, and beside it: those of glass, and of surfaces met at a grazing angle."""

GLASS_LOST, GRAZING = 0.2, 0.04

EVEN_RANGE = 12.0
"""Metres; a nearer return is kept with a chance that falls with the square of its range.

Beams fan out, so this leaves surfaces about equally dense, as thinning by voxels does in practice; without it half of a
map is the ground and the walls within arm's reach.
"""


class Beams(NamedTuple):
    """Beams as they left the laser: times (n,) in seconds, origins and unit directions (n, 3)."""

    time: Floats
    origins: Floats
    directions: Floats


class Returns(NamedTuple):
    """Beams that came back: times (n,), origins (n, 3), places (n, 3) where they met the world and as measured.

    `items` (n,) are those of the scene; `mixed` (n,) are ranges between the two sides of an edge.
    """

    time: Floats
    origins: Floats
    hits: Floats
    measured: Floats
    items: NDArray[np.int32]
    mixed: NDArray[np.bool_]


def count_beams(way: Trajectory, speed: float) -> int:
    """Return how many beams the laser sends along the way."""
    return int(way.length / speed * SCAN_RATE) * BEAMS


def choose_beams(n_all: int, n_wanted: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the numbers of about `n_wanted` beams in the order of time: one at random from each of equal stretches."""
    n = min(n_wanted, n_all)
    if n == n_all:
        return np.arange(n_all)
    return ((np.arange(n) + rng.random(n)) * (n_all / n)).astype(np.int64)


def make_beams(numbers: NDArray[np.int64], way: Trajectory, speed: float, all_round: bool = False) -> Beams:
    """Return the beams of these numbers: scan after scan, the scan plane nodding about the robot's lateral axis.

    With `all_round` a scan is a whole turn, of as many beams, and looks behind as it looks ahead.
    """
    time = numbers / (BEAMS * SCAN_RATE)
    xy, heading = way.at(speed * time)
    angle = np.radians((numbers % BEAMS - 0.5 * (BEAMS - 1)) * (2.0 if all_round else 1.0))
    pitch = np.radians(NOD_MIDDLE + NOD_REACH * np.sin(2.0 * np.pi * time / NOD_PERIOD))
    origins = np.column_stack([xy, np.full(len(time), MOUNT)])
    return Beams(time, origins, _directions(heading, pitch, angle))


def _directions(heading: Floats, pitch: Floats, angle: Floats) -> Floats:
    """Return unit vectors (n, 3); `angle` is counter-clockwise in the scan plane from straight ahead."""
    ahead, left, up = np.cos(angle) * np.cos(pitch), np.sin(angle), np.abs(np.cos(angle)) * np.sin(pitch)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * ahead - s * left, s * ahead + c * left, up], axis=1)


def observe(world: World, beams: Beams, settings: SimulateSettings, rng: np.random.Generator) -> Returns:
    """Cast the beams and return those that return and are kept, with noise, mixed ranges and losses."""
    n = len(beams.time)
    draws, noise, chance, luck = rng.random(n), rng.standard_normal(n), rng.random((n, 3)), rng.random(n)
    ranges, items = _cast(world, beams, draws, settings.max_range)
    mixed = np.zeros(n, bool)
    some = np.flatnonzero((chance[:, 0] < MIXED_CHANCE) & np.isfinite(ranges))
    beside = Beams(beams.time[some], beams.origins[some], _spread(beams.directions[some], chance[some, 1]))
    other, _ = _cast(world, beside, draws[some], settings.max_range)
    step = np.abs(other - ranges[some])
    at_edge = (step > MIXED_STEP[0]) & (step < MIXED_STEP[1])
    mixed[some[at_edge]] = True
    seen = ranges.copy()
    share = 0.1 + 0.8 * (luck[some[at_edge]] * 97.0 % 1.0)
    seen[some[at_edge]] += share * (other[at_edge] - ranges[some[at_edge]])
    even = chance[:, 2] * EVEN_RANGE**2 < ranges**2
    kept = np.isfinite(ranges) & even & ~_lost(world, beams, items, luck)
    measured = beams.origins + (seen + settings.noise * noise)[:, None] * beams.directions
    hits = beams.origins + np.where(kept, ranges, 0.0)[:, None] * beams.directions
    return Returns(beams.time[kept], beams.origins[kept], hits[kept], measured[kept], items[kept], mixed[kept])


def _cast(world: World, beams: Beams, draws: Floats, max_range: float) -> tuple[Floats, NDArray[np.int32]]:
    """Return range and item of each beam."""
    ranges, items = np.empty(len(draws)), np.empty(len(draws), np.int32)
    directions = np.ascontiguousarray(beams.directions)
    cast_beams(world.scene, beams.origins, directions, beams.time, draws, max_range, ranges, items)
    return ranges, items


def _spread(directions: Floats, chance: Floats) -> Floats:
    """Return directions (n, 3) at the rim of each beam's spot, sideways or up and down."""
    sideways = np.stack([-directions[:, 1], directions[:, 0], np.zeros(len(directions))], axis=1)
    sideways /= np.maximum(np.hypot(sideways[:, 0], sideways[:, 1]), 1e-9)[:, None]
    upward = np.cross(directions, sideways)
    turn = 2.0 * np.pi * chance[:, None]
    moved = directions + np.radians(SPOT) * (np.cos(turn) * sideways + np.sin(turn) * upward)
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _lost(world: World, beams: Beams, items: NDArray[np.int32], luck: Floats) -> NDArray[np.bool_]:
    """Return which returns (n,) the laser does not see: some of all, many from glass, those at grazing angles."""
    safe = np.where(items == NOTHING, 0, items)
    surface = world.surface[safe]
    normal = world.normal[np.maximum(surface, 0)]
    cosine = np.abs(np.einsum("ij,ij->i", normal, beams.directions))
    grazing = (surface >= 0) & (cosine < GRAZING)
    glass = (world.kind[safe] == Kind.RECESS) & (luck < GLASS_LOST)
    return np.asarray((luck < LOST) | glass | grazing)
