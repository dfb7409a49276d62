"""Where streets run: a street lined with offices, a block to be rounded, a pathway under an archway."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import SimulateSettings
from mapq.simulate.buildings import SHED_CHANCE, add_facade, add_shed, draw_windows
from mapq.simulate.robot import Waypoint
from mapq.simulate.scene import Frame, Line, SceneBuilder, crossing, left_of, rotated, unit
from mapq.simulate.street import Row, add_archway, add_bush, add_garden_wall, add_row

Floats = NDArray[np.float64]

LANE = 1.2
"""Metres to the right of the middle of a wide street on which the robot drives."""

PATHWAY = 8.0
"""Width of the pathway behind the block, in metres."""


class Plan(NamedTuple):
    """The lines of one block's streets, in its own frame: the street is along +x, the block lies to the left.

    Corners (4, 2) of the block, counter-clockwise from where the street arrives; begin and bend (2,) of the street;
    width of the streets, depth of the buildings; side of the garden at each corner (4,), 0 for none; and the length of
    the pathway.
    """

    corners: Floats
    start: Floats
    bend: Floats
    width: float
    depth: float
    gardens: Floats
    exit_length: float

    def ring(self, distance: float) -> Floats:
        """Return the corners (4, 2) of the block, `distance` metres farther out."""
        return offset_corners(self.corners, distance)

    @property
    def lane(self) -> float:
        """How far to the right of a street's middle the robot drives: it keeps clear of cars beside the kerb."""
        return min(LANE, max(0.5 * self.width - 5.0, 0.0))

    @property
    def exit_direction(self) -> Floats:
        """Unit vector along the pathway: on along the block's last side."""
        return unit(self.corners[0] - self.corners[3])

    def exit_point(self, along: float, left: float) -> Floats:
        """Return the point so far along the pathway's middle, from the ring's corner, and so far to the left."""
        d = self.exit_direction
        return np.asarray(self.ring(0.5 * self.width)[0] + along * d + left * left_of(d))


def draw_plan(settings: SimulateSettings, rng: np.random.Generator) -> Plan:
    """Return the plan of one block: its sides vary by a tenth, its corners are not quite right angles."""
    length, depth = np.array([settings.block_length, settings.block_depth]) * rng.uniform(0.9, 1.1, 2)
    corners = np.array([(0.0, 0.0), (length, 0.0), (length, depth), (0.0, depth)])
    corners += np.clip(rng.normal(0.0, 0.015 * length, (4, 2)), -0.03 * length, 0.03 * length)
    width = settings.street_width * rng.uniform(0.95, 1.08)
    south = unit(corners[1] - corners[0])
    joint = offset_corners(corners, 0.5 * width)[0]
    bend = joint - 0.5 * settings.street_length * south
    turn = rng.uniform(-0.1, 0.1)
    start = bend - 0.5 * settings.street_length * rotated(south, turn)
    building = min(rng.uniform(9.0, 12.0), 0.42 * min(length, depth))
    return Plan(
        corners,
        start,
        bend,
        float(width),
        float(building),
        _draw_gardens(settings, 0.35 * min(length, depth), rng),
        settings.path_length,
    )


def _draw_gardens(settings: SimulateSettings, largest: float, rng: np.random.Generator) -> Floats:
    """Return the sides of the gardens (4,) at the block's corners; at least one where there are look-alikes."""
    sides = np.minimum(rng.uniform(7.0, 10.0, 4), largest)
    wanted = rng.random(4) < 0.6 * settings.look_alikes
    if settings.look_alikes > 0.0 and not wanted.any():
        wanted[rng.integers(4)] = True
    return np.where(wanted, sides, 0.0)


def add_block(
    builder: SceneBuilder, plan: Plan, frame: Frame, is_last: bool, settings: SimulateSettings, rng: np.random.Generator
) -> None:
    """Add the streets, buildings, gardens and the archway of one plan."""
    builder.frame = frame
    for row in (*_block_rows(plan), *_street_rows(plan), *_outer_rows(plan), *_pathway_rows(plan)):
        add_row(builder, row, settings, rng)
    for corner in np.flatnonzero(plan.gardens):
        _add_garden(builder, plan, int(corner), settings, rng)
    _add_arch(builder, plan, rng)
    if is_last:
        ends = [plan.exit_point(plan.exit_length + 9.0, side * 0.5 * PATHWAY) for side in (1.0, -1.0)]
        closing = Line.facing(ends[0], ends[1], plan.exit_direction)
        add_facade(builder, closing, (0.0, 9.0), draw_windows(rng), rng)


def _block_rows(plan: Plan) -> list[Row]:
    """Return the rows of the block itself: two long ones, and two between them."""
    rows = []
    for side in range(4):
        a, b = plan.corners[side], plan.corners[(side + 1) % 4]
        gardens = plan.gardens[side], plan.gardens[(side + 1) % 4]
        covered = plan.depth if side % 2 else 0.0
        trims = [garden if garden > 0.0 else covered for garden in gardens]
        along = unit(b - a)
        line = Line.facing(a + trims[0] * along, b - trims[1] * along, left_of(along))
        if line.length > 2.0:
            ends = [garden > 0.0 or covered == 0.0 for garden in gardens]
            rows.append(Row(line, plan.depth, (ends[0], ends[1]), True))
    return rows


def _street_rows(plan: Plan) -> list[Row]:
    """Return the rows on both sides of the street that arrives (region A), in two pieces with a bend."""
    half = 0.5 * plan.width
    joint = plan.ring(half)[0]
    before, after = unit(plan.bend - plan.start), unit(joint - plan.bend)
    west, east = plan.ring(plan.width)[[3, 0]]
    ends = {
        1.0: crossing(joint + half * left_of(after), after, west, east - west),
        -1.0: crossing(joint - half * left_of(after), after, plan.exit_point(0.0, -0.5 * PATHWAY), plan.exit_direction),
    }
    rows = []
    for side in (1.0, -1.0):
        first = plan.start + side * half * left_of(before)
        middle = crossing(first, before, joint + side * half * left_of(after), after)
        rows.append(Row(Line.facing(first, middle, side * left_of(before)), plan.depth, (False, False), True))
        rows.append(Row(Line.facing(middle, ends[side], side * left_of(after)), plan.depth, (False, True), True))
    return rows


def _outer_rows(plan: Plan) -> list[Row]:
    """Return the rows on the outside of the streets round the block."""
    outer = plan.ring(plan.width)
    south = unit(outer[1] - outer[0])
    first = crossing(outer[0], south, plan.exit_point(0.0, 0.5 * PATHWAY), plan.exit_direction)
    joint = plan.ring(0.5 * plan.width)[0]
    north_edge = crossing(joint + 0.5 * plan.width * left_of(south), south, outer[3], outer[0] - outer[3])
    last = north_edge + plan.depth * unit(outer[3] - outer[0])
    marks = ((first, outer[1]), (outer[1], outer[2]), (outer[2], outer[3]), (outer[3], last))
    rows = []
    for k, (a, b) in enumerate(marks):
        line = Line.facing(a, b, -left_of(unit(b - a)))
        if line.length > 4.0:
            rows.append(Row(line, plan.depth, (k == 0, False), True))
    return rows


def _pathway_rows(plan: Plan) -> list[Row]:
    """Return the rows on both sides of the pathway (region F)."""
    rows = []
    first, last = 0.5 * plan.width + plan.depth, plan.exit_length + 9.0
    for side in (1.0, -1.0):
        a, b = plan.exit_point(first, side * 0.5 * PATHWAY), plan.exit_point(last, side * 0.5 * PATHWAY)
        if last - first > 4.0:
            line = Line.facing(a, b, side * left_of(plan.exit_direction))
            rows.append(Row(line, plan.depth, (False, False), False))
    return rows


def _add_garden(
    builder: SceneBuilder, plan: Plan, corner: int, settings: SimulateSettings, rng: np.random.Generator
) -> None:
    """Add a garden at a corner with walls across the robot's way: it sees one face before the turn, the other after."""
    at, side = plan.corners[corner], plan.gardens[corner]
    along = unit(plan.corners[(corner + 1) % 4] - at)
    back = unit(plan.corners[corner - 1] - at)
    inset = rng.uniform(0.6, 1.4)
    for height in (rng.uniform(1.7, 2.4), rng.uniform(1.0, 1.5))[: 1 + int(rng.random() < 0.5)]:
        a = at + inset * back + 0.6 * along
        b = at + inset * back + (side - rng.uniform(0.3, 1.5)) * along
        add_garden_wall(builder, Line.facing(a, b, back), height, rng.uniform(0.2, 0.4))
        inset += rng.uniform(1.8, 3.0)
    if settings.variety > 0.0 and rng.random() < SHED_CHANCE * settings.variety:
        a = at + inset * back + 0.8 * along
        add_shed(builder, Line.facing(a, a + (side - 1.2) * along, back), rng)
    if rng.random() < 0.7:
        add_bush(builder, at + 0.6 * side * (along + back), rng)


def _add_arch(builder: SceneBuilder, plan: Plan, rng: np.random.Generator) -> None:
    """Add the archway over the pathway."""
    along = plan.exit_length * rng.uniform(0.62, 0.7)
    a, b = (plan.exit_point(along, side * 0.5 * PATHWAY) for side in (1.0, -1.0))
    line = Line.facing(a, b, plan.exit_direction)
    free = rng.uniform(3.6, 4.8)
    middle = 0.5 * line.length + rng.uniform(-0.3, 0.3)
    opening = (middle - 0.5 * free, middle + 0.5 * free, rng.uniform(3.0, 4.2))
    add_archway(builder, line, rng.uniform(3.5, 7.0), rng.uniform(7.0, 10.0), opening)


def block_waypoints(plan: Plan, frame: Frame, loops: int, rng: np.random.Generator) -> list[Waypoint]:
    """Return the way along the street, `loops` times round the block, and down the pathway, in the world's frame.

    Laps keep to the right lane, each a little differently. A lap begins where the street meets the ring; the pass
    after the last lap is the pathway.
    """
    along = (plan.bend - plan.start) / np.hypot(*(plan.bend - plan.start))
    aside = plan.lane * np.array([along[1], -along[0]])
    points = [Waypoint(plan.start), Waypoint(plan.bend + aside)]
    for lap in range(loops):
        corners = plan.ring(0.5 * plan.width + plan.lane + rng.uniform(-0.3, 0.3))
        if lap > 0:
            points.append(Waypoint(corners[0], True))
        points += [Waypoint(corner) for corner in corners[1:]]
    points.append(Waypoint(plan.exit_point(0.0, -plan.lane), True))
    points += [Waypoint(plan.exit_point(f * plan.exit_length, 0.0)) for f in (0.35, 1.0)]
    return [Waypoint(frame.place(point.xy), point.begins_pass) for point in points]


def offset_corners(corners: Floats, distance: float) -> Floats:
    """Return the corners of a counter-clockwise polygon whose sides are moved outward by `distance`."""
    sides = np.roll(corners, -1, axis=0) - corners
    moved = [a - distance * left_of(unit(s)) for a, s in zip(corners, sides, strict=True)]
    return np.array([crossing(moved[k - 1], sides[k - 1], moved[k], sides[k]) for k in range(len(corners))])
