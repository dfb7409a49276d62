"""One side of a street: buildings one beside the other, and what stands in front of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mapq.simulate.building import add_building
from mapq.simulate.furniture import (
    PAVEMENT,
    add_bush,
    add_lamp,
    add_parked_car,
    add_pavement,
    add_railing,
    add_tree,
)
from mapq.simulate.line import Line
from mapq.simulate.scene import SceneBuilder
from mapq.simulate.settings import Settings
from mapq.simulate.variety import (
    BALCONIES_CHANCE,
    HEDGE_CHANCE,
    SHORTEST_YARD,
    YARD_CHANCE,
    add_balconies,
    add_hedge,
    add_yard,
)

GAP_CHANCE = 0.5
"""Chance of a narrow gap between two neighbours, times `look_alikes`."""

PARKING_WIDTH = 10.5
"""Metres of a street's width below which no car parks: the robot must pass between two of them."""

RAILING_CHANCE = 0.6
"""Chance of a fence in front of a building, times `look_alikes`."""


class Row(NamedTuple):
    """One row of buildings.

    Attributes
    ----------
    line : Line
        The building line; facades stand on it or behind it.
    depth : float
        Of the buildings, in metres.
    open_ends : pair of bool
        Whether the row's first and last side wall face a street.
    is_street : bool
        Whether there is a pavement in front, with room for cars; else it is a pathway.
    """

    line: Line
    depth: float
    open_ends: tuple[bool, bool]
    is_street: bool


def add_row(builder: SceneBuilder, row: Row, settings: Settings, rng: np.random.Generator) -> None:
    """Add a row of buildings with its pavement, fences, cars, trees and lamps."""
    if row.is_street:
        add_pavement(builder, row.line)
    lots = list(_lots(row.line.length, settings, rng))
    before = None
    for k, (first, last) in enumerate(lots):
        is_first, is_last = k == 0, k == len(lots) - 1
        open_sides = (is_first and row.open_ends[0], is_last and row.open_ends[1])
        front = _front(row.line.piece(first, last), rng)
        height = rng.uniform(*settings.height)
        if _has(YARD_CHANCE, settings, rng) and front.length > SHORTEST_YARD and row.is_street:
            add_yard(builder, front, row.depth, rng)
            before = None
            continue
        side, after = add_building(builder, front, row.depth * rng.uniform(0.85, 1.0), height, open_sides, rng)
        if before is not None and side is not None and first > lots[k - 1][1]:
            builder.look_alike(before, side)
        before = after
        if rng.random() < RAILING_CHANCE * settings.look_alikes:
            _add_fence(builder, front, rng)
        if _has(BALCONIES_CHANCE, settings, rng):
            add_balconies(builder, front, height, rng)
        if _has(HEDGE_CHANCE, settings, rng):
            add_hedge(builder, front, rng)
    _add_furniture(builder, row, settings, rng)


def _has(chance: float, settings: Settings, rng: np.random.Generator) -> bool:
    """Return whether a lot has something; a world without variety draws no numbers for it."""
    return settings.variety > 0.0 and bool(rng.random() < chance * settings.variety)


def _lots(length: float, settings: Settings, rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Yield where each building begins and ends; the last one takes the rest."""
    shortest, longest = settings.frontage
    start = 0.0
    while length - start > 0.5:
        # Cubed: short facades are the more common ones.
        size = shortest + (longest - shortest) * rng.random() ** 3
        if start + size + 0.7 * shortest > length:
            size = length - start
        yield start, start + size
        start += size
        if rng.random() < GAP_CHANCE * settings.look_alikes:
            start += rng.uniform(0.2, 1.5)


def _front(lot: Line, rng: np.random.Generator) -> Line:
    """Return the facade's line on its lot: set back or not, and turned a little."""
    setback = rng.choice([0.0, 0.0, 0.3, 0.8, 1.4]) + rng.uniform(0.0, 0.15)
    tilt = np.clip(rng.normal(0.0, 0.012), -0.03, 0.03) * lot.length
    return Line.facing(
        lot.start + (setback + max(tilt, 0.0)) * lot.inward,
        lot.end + (setback + max(-tilt, 0.0)) * lot.inward,
        lot.inward,
    )


def _add_fence(builder: SceneBuilder, front: Line, rng: np.random.Generator) -> None:
    length = min(front.length - 0.4, rng.uniform(4.0, 12.0))
    first = rng.uniform(0.2, front.length - length)
    add_railing(builder, front.piece(first, first + length).shifted(-rng.uniform(0.4, 1.3)), rng)


def _add_furniture(builder: SceneBuilder, row: Row, settings: Settings, rng: np.random.Generator) -> None:
    """Add parked cars beside the kerb, trees and lamps on the pavement, bushes before the facades."""
    if not row.is_street:
        return
    lane, kerb = row.line.shifted(-PAVEMENT - 0.95), row.line.shifted(0.3 - PAVEMENT)
    beds = row.line.shifted(-0.4)
    along = row.line.along
    for u in np.arange(3.5, row.line.length - 3.5, 5.6):
        if settings.street_width >= PARKING_WIDTH and rng.random() < 0.4 * settings.clutter:
            heading = along if rng.random() < 0.5 else -along
            add_parked_car(builder, lane.start + (u + rng.uniform(-0.4, 0.4)) * along, heading, rng)
    for u in np.arange(5.0, row.line.length - 2.0, 11.0):
        place = kerb.start + (u + rng.uniform(-2.0, 2.0)) * along
        if rng.random() < 0.45 * settings.clutter:
            add_tree(builder, place, rng)
        elif rng.random() < 0.45 * settings.clutter:
            add_lamp(builder, place, rng)
        if rng.random() < 0.35 * settings.clutter:
            add_bush(builder, beds.start + (u + rng.uniform(-4.0, 4.0)) * along, rng)
