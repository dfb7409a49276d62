"""What poses of the plane in a file that names nothing are, as the way driven shows.

Headings in radians, counted over turns or not, or in degrees; rows that are poses, or steps from one to the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from prf.shell.errors import InputError

Floats = NDArray[np.float64]

WIDEST = 4.0 * np.pi
"""Radians: a larger heading is in degrees, unless the way driven says otherwise."""
LEAST_FOLLOWED = 0.5
"""Share of the way that headings in degrees follow at least; ..."""
SURELY, HARDLY = 0.8, 0.6
"""... and shares of that which they follow as radians, from which and up to which they are these or degrees."""

AT_RANDOM = 0.4
"""Length of the mean of turns as unit vectors below which a robot would turn at random; of corrected logs above .8."""

FEWEST_STEPS = 20
APART = 0.3
"""Mean square from row to row, over twice the variance of all: poses of a way hang together (.11 at most on logs of
which every tenth scan was taken), steps do not (.41)."""


def added_up(rows: Floats) -> tuple[Floats, str]:
    """Return the poses (k, 3) of rows x y theta that are these or, after the first, steps; and what to say of it."""
    place = rows[:, :2]
    spread = 2.0 * float(place.var(axis=0).sum())
    if len(rows) < FEWEST_STEPS or not float(np.square(np.diff(place, axis=0)).sum(axis=1).mean()) > APART * spread:
        return rows, ""
    heading = np.cumsum(rows[:, 2])
    cosine, sine = np.cos(heading[:-1]), np.sin(heading[:-1])
    x, y = place[1:].T
    moved = np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
    return np.column_stack([np.cumsum(np.vstack([place[:1], moved]), axis=0), heading]), ", rows taken as steps"


def in_radians(place: Floats, heading: Floats, where: Sequence[str]) -> tuple[Floats, str]:
    """Return headings (k,) at places (k, 2) in radians, and what to say of it.

    Headings within one turn are radians. Others may be counted over turns, or be in degrees: a robot drives along its
    heading, or at one angle to it, while headings in the wrong unit have nothing to do with the way. Where it does not
    show, headings beyond two turns are refused.
    """
    if np.ptp(heading) <= 2.0 * np.pi:
        refuse_wide(heading, where)
        return heading, ""
    as_radians, as_degrees, chance = (_followed(place, heading, unit) for unit in (1.0, math.radians(1.0), math.inf))
    if as_degrees > max(LEAST_FOLLOWED, chance) and as_radians < HARDLY * as_degrees:
        return np.radians(heading), ", headings in degrees, which the way follows"
    if not (as_radians > chance and as_radians > SURELY * as_degrees):
        if len(heading) >= FEWEST_STEPS and float(np.abs(np.exp(1j * np.diff(heading)).mean())) < AT_RANDOM:
            return np.radians(heading), ", headings in degrees, as radians the robot would turn at random"
        refuse_wide(heading, where)
    return heading, ""


def refuse_wide(angle: Floats, where: Sequence[str]) -> None:
    """Refuse angles (k,), radians, beyond two turns, which are in degrees."""
    wide = np.flatnonzero(np.abs(angle) > WIDEST)
    if len(wide):
        found = f"an angle is {np.abs(angle[wide[0]]):g} rad"
        raise InputError(
            f"{where[wide[0]]}: {found}. If headings are in degrees, name the column so in a header above the rows, "
            "separated as they are: x,y,yaw_deg (x,y,yaw for radians)."
        )


def _followed(place: Floats, heading: Floats, unit: float) -> float:
    """Return the share of the way that goes at one angle to headings of a unit (rad), forward or back.

    With an infinite unit the share that headings at random may reach.
    """
    step = np.diff(place, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    total = max(float(length.sum()), 1e-9)
    if unit == math.inf:
        return 3.0 * math.sqrt(float((length**2).sum())) / total
    turn = np.angle(np.exp(1j * unit * np.diff(heading)))
    off = np.arctan2(step[:, 1], step[:, 0]) - unit * heading[:-1] - 0.5 * turn
    return float(np.abs((length * np.exp(2j * off)).sum())) / total
