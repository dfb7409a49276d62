"""What a point of a simulated map was reflected from."""

from __future__ import annotations

from enum import IntEnum


class Kind(IntEnum):
    """Values of the point field ``kind``."""

    GROUND = 0
    KERB = 1
    FACADE = 2
    RECESS = 3
    REVEAL = 4
    SIDE_WALL = 5
    ROOF = 6
    ARCH = 7
    RAILING = 8
    GARDEN_WALL = 9
    FOLIAGE = 10
    POST = 11
    PARKED_CAR = 12
    MOVING_CAR = 13
    PERSON = 14
    MIXED = 15
    LORRY = 16
    SHED = 17
    BALCONY = 18


MOVING = (Kind.MOVING_CAR, Kind.PERSON)
"""Never at the same place twice, so two passes over them cannot disagree."""
