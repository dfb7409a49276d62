"""The plan that a run of walls leaves: centre lines and doors, with how probable and how certain each is.

Walls and doors are those of the draw of highest posterior density, moved to where they lie in the mean; how many draws
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
PLACES = 9
"""Places along a wall at which it is looked for; a draw has the wall if it has it at half of them."""
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
    walls = [_wall(wall, draws) for wall in reference[seen]]
    found = doors_of(reference)
    if run.image is not None and len(found):
        found = found[run.image.seen_at(found.mean(axis=1))]
    every = [doors_of(draw) for draw in draws]
    doors = [_door(door, every) for door in found]
    return Plan(
        [wall for wall in walls if wall.probability >= LEAST_PROBABILITY],
        [door for door in doors if door.probability >= LEAST_PROBABILITY],
    )


def plan_of_walls(walls: Floats) -> Plan:
    """Return the plan of one map of walls (n, 5), of which nothing is known beside it."""
    found = [PlanWall(wall[:4].reshape(2, 2), float(wall[4]), 0.0, 0.0, 1.0) for wall in walls]
    doors = [PlanDoor(ends, float(np.hypot(*(ends[1] - ends[0]))), 0.0, 1.0) for ends in doors_of(walls)]
    return Plan(found, doors)


def _wall(wall: Floats, draws: list[Floats]) -> PlanWall:
    """Return a wall (5,) moved to its mean over the draws."""
    a, b = wall[:2], wall[2:4]
    length = float(np.hypot(*(b - a)))
    unit = (b - a) / length
    normal = np.array([-unit[1], unit[0]])
    share = (np.arange(PLACES) + 0.5) / PLACES
    places = a + share[:, None] * (b - a)
    rows = [_beside(places, float(wall[4]), unit, normal, draw) for draw in draws]
    has = np.array([np.isfinite(offset).mean() >= 0.5 for offset, _ in rows])
    if not has.any():
        return PlanWall(wall[:4].reshape(2, 2), float(wall[4]), 0.0, 0.0, 0.0)
    offset, thickness = (np.array(part)[has] for part in zip(*rows, strict=True))
    mean = np.nanmean(offset, axis=0)
    known = np.isfinite(mean)
    slope, middle = np.polyfit(share[known] - 0.5, mean[known], 1) if known.sum() > 1 else (0.0, mean[known].mean())
    ends = np.stack([a + (middle - 0.5 * slope) * normal, b + (middle + 0.5 * slope) * normal])
    spread = float(np.nanmean(offset, axis=1).std())
    return PlanWall(ends, float(thickness.mean()), float(thickness.std()), spread, float(has.mean()))


def _beside(places: Floats, thickness_here: float, unit: Floats, normal: Floats, draw: Floats) -> tuple[Floats, float]:
    """Return how far across (n,) a wall of a draw lies at each place, nan where none is the same; and its thickness.

    It is the same if its centre line, or the face on the same side, lies within :data:`BESIDE`: of a wall that is seen
    from one side the centre line is as uncertain as the thickness.
    """
    off, thickness = np.full(len(places), np.nan), np.full(len(places), np.nan)
    if len(draw) == 0:
        return off, np.nan
    a, step = draw[:, :2], draw[:, 2:4] - draw[:, :2]
    along, tilt = step @ unit, step @ normal
    same = np.abs(tilt) <= np.tan(TILT) * np.abs(along)
    a, along, tilt, thick = a[same], along[same], tilt[same], draw[same, 4]
    if len(a) == 0:
        return off, np.nan
    share = ((places[:, None] - a) @ unit) / along
    across = -((places[:, None] - a) @ normal) + share * tilt
    wider = 0.5 * (thick - thickness_here)
    away = np.min(np.abs([across, across + wider, across - wider]), axis=0)
    fits = (share >= 0.0) & (share <= 1.0) & (away <= BESIDE)
    nearest = np.where(fits, away, np.inf).argmin(axis=1)
    has = fits.any(axis=1)
    rows = np.arange(len(places))
    off[has], thickness[has] = across[rows, nearest][has], thick[nearest][has]
    return off, float(np.nanmedian(thickness)) if has.any() else np.nan


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
