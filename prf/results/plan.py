"""The plan that a run of walls leaves: centre lines and doors, with how probable and how certain each is.

Walls and doors are those of the draw of highest posterior density, moved to where they usually lie; how many draws
have them is counted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from prf.model.window import Window
from prf.results import names
from prf.results.run import RunData
from prf.shell.cli.storage import dump_object
from prf.shell.errors import InputError

Floats = NDArray[np.float64]

BESIDE, TILT = 0.1, np.deg2rad(5.0)
"""Metres and radians from a wall up to which one of another draw is the same."""
MOST_DRAWS = 100
"""Draws that are counted, evenly spaced."""
PLACES, APART = 9, 0.1
"""Places along a wall, at least, at which it is looked for, and metres between them at most; a draw has the wall if it
has it at half of them, and an end of the wall that fewer than half of the draws have is cut off."""
NARROWEST, WIDEST = 0.55, 1.5
"""Metres of a door."""
LEAST_JAMB = 0.2
"""Metres of wall that ends at a door."""
TOUCHING, LEAST_BUILDING = 0.05, 4.0
"""Metres between walls that touch, and of walls that are no furniture."""
LEAST_PROBABILITY = 0.5
"""Walls and doors that fewer draws have are left out."""
DOOR_BESIDE, DOOR_WIDER = 0.3, 0.2
"""Metres between middles, and between widths, of doors that are the same."""


class PlanWall(NamedTuple):
    """A wall: its centre line, thickness and errors in metres, and the share of draws that have it."""

    ends: Floats  # (2, 2)
    thickness: float
    thickness_sd: float
    offset_sd: float  # across the wall
    probability: float


class PlanDoor(NamedTuple):
    """A gap between jambs: its ends in metres, its width, and the share of draws that have it."""

    ends: Floats  # (2, 2)
    width: float
    width_sd: float
    probability: float


class Plan(NamedTuple):
    """Walls and doors."""

    walls: list[PlanWall]
    doors: list[PlanDoor]

    @property
    def length(self) -> float:
        """Metres of walls."""
        return float(sum(np.hypot(*(wall.ends[1] - wall.ends[0])) for wall in self.walls))


def no_walls(name: str) -> InputError:
    """Return the error that maps have no walls."""
    return InputError(f"{name}: its maps are polygons, not walls. Sample, or anneal, with --prior walls.")


def plan_of(run: RunData) -> Plan:
    """Return the plan of a run of walls (InputError if its maps are polygons, or it has no draws yet)."""
    if run.walls is None:
        raise no_walls(run.name)
    n = len(run.walls)
    if n == 0:
        raise InputError(f"{run.name}: no draws yet, so no plan. Resume with prf sample --resume.")
    reference = run.walls[int(np.argmax(run.functionals["log_posterior"]))]
    draws = [run.walls[int(i)] for i in np.unique(np.linspace(0, n - 1, MOST_DRAWS).astype(np.int64))]
    lines = reference[:, :4].reshape(-1, 2, 2)
    seen = np.ones(len(lines), np.bool_) if run.image is None else run.image.sees(lines)
    walls = [(wall, _wall(wall, draws)) for wall in reference[seen]]
    walls = [(wall, found) for wall, found in walls if found.probability >= LEAST_PROBABILITY]
    # A gap beside a wall that is no part of the plan is no door.
    gaps = doors_of(np.array([wall for wall, _ in walls]).reshape(-1, 5))
    if run.image is not None and len(gaps):
        gaps = gaps[run.image.seen_at(gaps.mean(axis=1))]
    of_draws = [doors_of(draw) for draw in draws]
    doors = [_door(gap, of_draws) for gap in gaps]
    return Plan([found for _, found in walls], [door for door in doors if door.probability >= LEAST_PROBABILITY])


def plan_of_walls(walls: Floats) -> Plan:
    """Return the plan of one map of walls (n, 5), of which nothing is known beside it."""
    found = [PlanWall(wall[:4].reshape(2, 2), float(wall[4]), 0.0, 0.0, 1.0) for wall in walls]
    doors = [PlanDoor(ends, float(np.hypot(*(ends[1] - ends[0]))), 0.0, 1.0) for ends in doors_of(walls)]
    return Plan(found, doors)


def _wall(wall: Floats, draws: list[Floats]) -> PlanWall:
    """Return a wall (5,) moved to its median over the draws."""
    a, b = wall[:2], wall[2:4]
    length = float(np.hypot(*(b - a)))
    unit = (b - a) / length
    normal = np.array([-unit[1], unit[0]])
    n = max(PLACES, int(np.ceil(length / APART)))
    share = (np.arange(n) + 0.5) / n
    places = a + share[:, None] * (b - a)
    rows = [_beside(places, float(wall[4]), unit, normal, draw) for draw in draws]
    has = np.array([there.mean() >= 0.5 for there, _, _ in rows])
    if not has.any():
        return PlanWall(wall[:4].reshape(2, 2), float(wall[4]), 0.0, 0.0, 0.0)
    there, offset, thickness = (np.array(part)[has] for part in zip(*rows, strict=True))
    middle, slope = _line(share - 0.5, offset)
    kept = np.flatnonzero(there.mean(axis=0) >= 0.5)
    reach = np.array([kept[0], kept[-1] + 1]) / n if len(kept) else np.array([0.0, 1.0])
    ends = a + reach[:, None] * (b - a) + (middle + slope * (reach - 0.5))[:, None] * normal
    spread = float(np.nanmean(offset, axis=1).std())
    return PlanWall(ends, float(np.median(thickness)), float(thickness.std()), spread, float(has.mean()))


def _line(along: Floats, offset: Floats) -> tuple[float, float]:
    """Return offset at 0 and slope of the usual line of draws: (draws, n) offsets, nan where unknown, at places (n,).

    Both are medians: that a few draws have other furniture there does not move a wall.
    """
    known = np.isfinite(offset)
    first, last = known.argmax(axis=1), offset.shape[1] - 1 - known[:, ::-1].argmax(axis=1)
    long = last > first
    rows = np.arange(len(offset))
    rise = offset[rows, last] - offset[rows, first]
    slope = float(np.median(rise[long] / (along[last] - along[first])[long])) if long.any() else 0.0
    return float(np.median(np.nanmean(offset - slope * along, axis=1))), slope


def _beside(
    places: Floats, thickness_here: float, unit: Floats, normal: Floats, draw: Floats
) -> tuple[NDArray[np.bool_], Floats, float]:
    """Return at which places (n,) a draw has the wall; how far across the part most like it lies (n,); its thickness.

    All in metres, offsets nan where that part is not. It is the same wall if its centre line, or the face on the same
    side, lies within :data:`BESIDE`: of a wall seen from one side the centre line is as uncertain as the thickness.
    """
    none = np.zeros(len(places), np.bool_), np.full(len(places), np.nan), np.nan
    a, step = draw[:, :2], draw[:, 2:4] - draw[:, :2]
    along, tilt = step @ unit, step @ normal
    same = np.abs(tilt) <= np.tan(TILT) * np.abs(along)
    a, along, tilt, thick = a[same], along[same], tilt[same], draw[same, 4]
    if len(a) == 0:
        return none
    share = ((places[:, None] - a) @ unit) / along
    across = -((places[:, None] - a) @ normal) + share * tilt
    wider = 0.5 * (thick - thickness_here)
    away = np.min(np.abs([across, across + wider, across - wider]), axis=0)
    fits = (share >= 0.0) & (share <= 1.0) & (away <= BESIDE)
    if not fits.any():
        return none
    # A place that is the same by its face alone counts half of one whose centre line is the same.
    likeness = np.where(fits, 1.0 - 0.5 * np.minimum(np.abs(across) / BESIDE, 1.0), 0.0)
    best = int(likeness.sum(axis=0).argmax())
    return fits.any(axis=1), np.where(fits[:, best], across[:, best], np.nan), float(thick[best])


def doors_of(walls: Floats) -> Floats:
    """Return the gaps (n, 2, 2) between the end of a wall and the next wall ahead of it, each once.

    Both are parts of a building: what does not hang together over a few metres is furniture.
    """
    found: list[Floats] = []
    walls = walls[_are_building(walls)]
    for i, wall in enumerate(walls):
        for end, far in ((wall[2:4], wall[:2]), (wall[:2], wall[2:4])):
            length = float(np.hypot(*(end - far)))
            if length < LEAST_JAMB:
                continue
            unit = (end - far) / length
            ahead = _first_ahead(end, unit, np.delete(walls, i, axis=0))
            if not NARROWEST <= ahead <= WIDEST:
                continue
            ends = np.stack([end, end + ahead * unit])
            middle = ends.mean(axis=0)
            if all(np.hypot(*(other.mean(axis=0) - middle)) > DOOR_BESIDE for other in found):
                found.append(ends)
    return np.array(found).reshape(-1, 2, 2)


def _are_building(walls: Floats) -> NDArray[np.bool_]:
    """Return which walls (n,) are parts of walls that touch and are long enough together."""
    if len(walls) == 0:
        return np.zeros(0, np.bool_)
    lines = shapely.linestrings(walls[:, :4].reshape(-1, 2, 2))
    one, other = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=float(walls[:, 4].max()) + TOUCHING)
    apart = shapely.distance(lines[one], lines[other]) - 0.5 * (walls[one, 4] + walls[other, 4])
    touch = apart <= TOUCHING
    links = csr_array((touch[touch], (one[touch], other[touch])), (len(walls), len(walls)))
    part = connected_components(links, directed=False)[1]
    return np.asarray(np.bincount(part, shapely.length(lines))[part] >= LEAST_BUILDING)


def _first_ahead(place: Floats, unit: Floats, walls: Floats) -> float:
    """Return the distance from the end of a wall to the first other one ahead; 0 if it lies in one, inf if none is."""
    if len(walls) == 0:
        return float("inf")
    step = walls[:, 2:4] - walls[:, :2]
    length = np.hypot(*step.T)
    u = step / length[:, None]
    n = np.stack([-u[:, 1], u[:, 0]], axis=1)
    low, high = np.zeros(len(walls)), np.full(len(walls), np.inf)
    off = place - walls[:, :2]
    for axis, least, most in ((u, np.zeros(len(walls)), length), (n, -0.5 * walls[:, 4], 0.5 * walls[:, 4])):
        at, change = (off * axis).sum(axis=1), axis @ unit
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (least - at) / change, (most - at) / change
        low, high = np.fmax(low, np.fmin(first, second)), np.fmin(high, np.fmax(first, second))
    hit = low <= high
    return float(low[hit].min()) if hit.any() else float("inf")


def _door(door: Floats, every: list[Floats]) -> PlanDoor:
    """Return a door (2, 2) with its mean width over the draws, and the share of them that have it."""
    middle, width = door.mean(axis=0), float(np.hypot(*(door[1] - door[0])))
    widths = []
    for doors in every:
        if len(doors) == 0:
            continue
        away = np.hypot(*(doors.mean(axis=1) - middle).T)
        other = np.hypot(*(doors[:, 1] - doors[:, 0]).T)
        fits = (away <= DOOR_BESIDE) & (np.abs(other - width) <= DOOR_WIDER)
        if fits.any():
            widths.append(float(other[fits][away[fits].argmin()]))
    if not widths:
        return PlanDoor(door, width, 0.0, 0.0)
    return PlanDoor(door, float(np.mean(widths)), float(np.std(widths)), len(widths) / len(every))


def plan_text(plan: Plan, window: Window) -> str:
    """Return a plan as a FeatureCollection of centre lines and doors (docs/export.md)."""
    features = [
        _feature(wall.ends, {"layer": "wall", **{name: getattr(wall, name) for name in PlanWall._fields[1:]}})
        for wall in plan.walls
    ] + [
        _feature(door.ends, {"layer": "door", **{name: getattr(door, name) for name in PlanDoor._fields[1:]}})
        for door in plan.doors
    ]
    content = {"type": "FeatureCollection", "frame": "metres", "window": list(window), "features": features}
    return dump_object(names.PLAN_SCHEMA, content) + "\n"


def _feature(ends: Floats, properties: dict[str, Any]) -> dict[str, Any]:
    rounded = {name: round(value, 5) if isinstance(value, float) else value for name, value in properties.items()}
    geometry = {"type": "LineString", "coordinates": ends.tolist()}
    return {"type": "Feature", "geometry": geometry, "properties": rounded}
