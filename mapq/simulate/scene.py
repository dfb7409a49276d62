"""Parts of a simulated world: walls, sheets, posts, foliage and movers, and the lines of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.raycast import Scene

Floats = NDArray[np.float64]

NO_SURFACE = -1
"""Surface number of what is not a plane."""

NO_HOLES = (0.0, 1.0, 0.0, 0.0)
"""One axis of a wall without holes."""

GRID_CELL = 1.0
"""Side of the grid's cells in metres: a beam crosses some tens of them, and few hold more than a window's parts."""

UP = (0.0, 0.0, 1.0)


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


@dataclass(frozen=True)
class Line:
    """A facade's place: from `start` to `end`, the building on the side of the unit vector `inward`."""

    start: Floats
    end: Floats
    inward: Floats

    @classmethod
    def facing(cls, start: Floats, end: Floats, inward: Floats) -> Line:
        """Return the line with the unit normal that points to the side of `inward`."""
        along = (end - start) / np.hypot(*(end - start))
        normal = np.array([-along[1], along[0]])
        return cls(start, end, normal if normal @ inward > 0.0 else -normal)

    @property
    def length(self) -> float:
        """Length in metres."""
        return float(np.hypot(*(self.end - self.start)))

    @property
    def along(self) -> Floats:
        """Unit vector from start to end."""
        return np.asarray((self.end - self.start) / self.length)

    def shifted(self, depth: float) -> Line:
        """Return the line moved into the building."""
        return Line(self.start + depth * self.inward, self.end + depth * self.inward, self.inward)

    def piece(self, first: float, last: float) -> Line:
        """Return the part between two distances from the start."""
        return Line(self.start + first * self.along, self.start + last * self.along, self.inward)


def unit(vector: Floats) -> Floats:
    """Return the vector (2,) at length 1."""
    return np.asarray(vector / np.hypot(*vector))


def left_of(vector: Floats) -> Floats:
    """Return the vector (2,) turned to the left by a right angle."""
    return np.array([-vector[1], vector[0]])


def rotated(vector: Floats, angle: float) -> Floats:
    """Return the vector (2,) turned to the left by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def crossing(a: Floats, da: Floats, b: Floats, db: Floats) -> Floats:
    """Return where the line through `a` along `da` meets the line through `b` along `db`, all (2,)."""
    factor = ((b[0] - a[0]) * db[1] - (b[1] - a[1]) * db[0]) / (da[0] * db[1] - da[1] * db[0])
    return np.asarray(a + factor * da)


class Frame(NamedTuple):
    """Place of a block in the world: ``origin + R(heading) (x, side * y)``; side is 1, or -1 for a mirrored block."""

    origin: Floats
    heading: float
    side: float

    def place(self, xy: Floats) -> Floats:
        """Return points (..., 2) of the block's frame in the world."""
        return self.origin + self.turn(xy)

    def turn(self, vector: Floats) -> Floats:
        """Return vectors (..., 2) of the block's frame in the world."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        x, y = vector[..., 0], self.side * vector[..., 1]
        return np.stack([c * x - s * y, s * x + c * y], axis=-1)


class World(NamedTuple):
    """A scene, and what each of its items is; the last entry of `surface`, `thing` and `kind` is the ground.

    Attributes
    ----------
    scene : Scene
    surface, thing, kind : (n_items + 1,) array
        True planar surface or `NO_SURFACE`; thing without planes, such as one tree, or -1; :class:`Kind`.
    normal : (n_surfaces, 3) float64
    partner : (n_surfaces,) int32
        The surface near which one looks like an error of the map if both are seen (a fence: itself); else
        `NO_SURFACE`.
    """

    scene: Scene
    surface: NDArray[np.int32]
    thing: NDArray[np.int32]
    kind: NDArray[np.uint8]
    normal: NDArray[np.float64]
    partner: NDArray[np.int32]


class _Items:
    """Rows of one shape, and what they are."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.rows: list[Sequence[float]] = []
        self.tags: list[tuple[int, int, int]] = []

    def add(self, row: Sequence[float], surface: int, thing: int, kind: Kind) -> None:
        self.rows.append(row)
        self.tags.append((surface, thing, int(kind)))

    def array(self) -> Floats:
        return np.array(self.rows, np.float64).reshape(-1, self.width)


class SceneBuilder:
    """Collects the parts of the world, in the frame of the block that is being built."""

    def __init__(self) -> None:
        self.frame = Frame(np.zeros(2), 0.0, 1.0)
        self._walls, self._sheets, self._posts = _Items(15), _Items(12), _Items(5)
        self._blobs, self._movers = _Items(6), _Items(13)
        self._normals: list[Sequence[float]] = [UP]
        self._partner = [NO_SURFACE]
        self._n_things = 0

    def thing(self) -> int:
        """Return the number of a new thing without planes."""
        self._n_things += 1
        return self._n_things - 1

    def surface(self, normal: Sequence[float] | Floats) -> int:
        """Return the number of a new planar surface with this normal (2 or 3 components, of the block's frame)."""
        n = np.asarray(normal, np.float64)
        turned = self.frame.turn(n[:2])
        whole = np.array([*turned, n[2] if len(n) == 3 else 0.0])
        self._normals.append(whole / np.linalg.norm(whole))
        self._partner.append(NO_SURFACE)
        return len(self._normals) - 1

    def look_alike(self, one: int, other: int) -> None:
        """Note two surfaces that are near each other and both true; a fence before a facade is its own partner."""
        self._partner[one], self._partner[other] = other, one

    def wall(
        self,
        a: Floats,
        b: Floats,
        z: tuple[float, float],
        kind: Kind,
        surface: int | None = None,
        holes: tuple[Sequence[float], Sequence[float]] = (NO_HOLES, NO_HOLES),
    ) -> int:
        """Add a vertical rectangle from `a` to `b` (2,) and return its surface, a new one if None is given."""
        along = b - a
        length = float(np.hypot(*along))
        if surface is None:
            surface = self.surface((-along[1], along[0]))
        start, direction = self.frame.place(a), self.frame.turn(along / length)
        self._walls.add((*start, *direction, length, *z, *holes[0], *holes[1]), surface, -1, kind)
        return surface

    def sheet(self, corner: Floats, a: Floats, b: Floats, kind: Kind, surface: int | None = None) -> int:
        """Add the parallelogram of a corner (3,) and two sides (3,), and return its surface, a new one if None."""
        if surface is None:
            surface = self.surface(np.cross(a, b))
        c, p, q = (
            np.array([*turned, z])
            for turned, z in (
                (self.frame.place(corner[:2]), corner[2]),
                (self.frame.turn(a[:2]), a[2]),
                (self.frame.turn(b[:2]), b[2]),
            )
        )
        normal = np.cross(p, q)
        normal /= np.linalg.norm(normal)
        dual = np.linalg.pinv(np.stack([p, q], axis=1))
        self._sheets.add((*c, *normal, *dual[0], *dual[1]), surface, -1, kind)
        return surface

    def post(self, xy: Floats, radius: float, z: tuple[float, float], kind: Kind = Kind.POST) -> None:
        """Add a vertical cylinder."""
        self._posts.add((*self.frame.place(xy), radius, *z), NO_SURFACE, self.thing(), kind)

    def blob(self, centre: Floats, radii: tuple[float, float], density: float) -> None:
        """Add a spheroid of foliage: centre (3,), horizontal and vertical radius, returns per metre."""
        place = self.frame.place(centre[:2])
        self._blobs.add((*place, centre[2], *radii, density), NO_SURFACE, self.thing(), Kind.FOLIAGE)

    def mover(
        self,
        start: Floats,
        velocity: Floats,
        times: tuple[float, float],
        half: tuple[float, float] | float,
        z: tuple[float, float],
        kind: Kind,
    ) -> None:
        """Add what moves evenly in the world's frame: a cylinder of radius `half`, or a box of two half sides."""
        is_box = isinstance(half, tuple)
        sides = half if isinstance(half, tuple) else (half, half)
        heading = velocity / np.hypot(*velocity)
        row = (float(is_box), *start, *velocity, *times, *sides, *z, *heading)
        self._movers.add(row, NO_SURFACE, self.thing(), kind)

    def finish(self, reach: float) -> World:
        """Return the world, with a grid that goes `reach` metres beyond everything that does not move."""
        groups = (self._walls, self._sheets, self._posts, self._blobs, self._movers)
        tags = np.array([tag for group in groups for tag in group.tags] + [(0, -1, Kind.GROUND)], np.int32)
        arrays = [group.array() for group in groups]
        boxes = np.concatenate([_wall_boxes(arrays[0]), _sheet_boxes(arrays[1]), _round_boxes(arrays[2], arrays[3])])
        start, items, grid, shape = _index(boxes, arrays[0], reach)
        walls, sheets, posts, blobs, movers = arrays
        scene = Scene(walls, sheets, posts, blobs, movers, start, items, grid, shape)
        return World(
            scene,
            tags[:, 0],
            tags[:, 1],
            tags[:, 2].astype(np.uint8),
            np.array(self._normals, np.float64),
            np.array(self._partner, np.int32),
        )


def _wall_boxes(walls: Floats) -> Floats:
    """Return x0, y0, x1, y1 (n, 4) of walls."""
    ends = walls[:, :2] + walls[:, 2:4] * walls[:, 4:5]
    return np.hstack([np.minimum(walls[:, :2], ends), np.maximum(walls[:, :2], ends)])


def _sheet_boxes(sheets: Floats) -> Floats:
    """Return x0, y0, x1, y1 (n, 4) of sheets, whose sides are the dual vectors of their coordinates."""
    boxes = np.zeros((len(sheets), 4))
    for box, sheet in zip(boxes, sheets, strict=True):
        sides = np.linalg.pinv(sheet[6:12].reshape(2, 3))
        corners = sheet[:3] + np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)]) @ sides.T
        box[:2], box[2:] = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    return boxes


def _round_boxes(posts: Floats, blobs: Floats) -> Floats:
    """Return x0, y0, x1, y1 (n, 4) of posts and foliage."""
    centre = np.vstack([posts[:, :2], blobs[:, :2]])
    radius = np.concatenate([posts[:, 2], blobs[:, 3]])[:, None]
    return np.hstack([centre - radius, centre + radius])


def _index(
    boxes: Floats, walls: Floats, reach: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], Floats, NDArray[np.int32]]:
    """Return the start of each cell, the items of cells, the grid's corner and side, and its shape."""
    low = np.floor(boxes[:, :2].min(axis=0) - reach)
    shape = np.ceil((boxes[:, 2:].max(axis=0) + reach - low) / GRID_CELL).astype(np.int64)
    # A little wider, so that what lies on a border is in both cells.
    first = np.floor((boxes[:, :2] - 1e-6 - low) / GRID_CELL).astype(np.int64)
    last = np.floor((boxes[:, 2:] + 1e-6 - low) / GRID_CELL).astype(np.int64)
    cells, items = [], []
    for item in range(len(boxes)):
        across = np.arange(first[item, 0], last[item, 0] + 1)
        upward = np.arange(first[item, 1], last[item, 1] + 1)
        i, j = np.tile(across, len(upward)), np.repeat(upward, len(across))
        if item < len(walls):
            near = _near_line(walls[item], low[0] + (i + 0.5) * GRID_CELL, low[1] + (j + 0.5) * GRID_CELL)
            i, j = i[near], j[near]
        cells.append(j * shape[0] + i)
        items.append(np.full(len(i), item))
    cell, found = np.concatenate(cells), np.concatenate(items)
    order = np.lexsort((found, cell))
    start = np.zeros(shape[0] * shape[1] + 1, np.int32)
    np.cumsum(np.bincount(cell, minlength=shape[0] * shape[1]), out=start[1:])
    grid = np.array([*low, GRID_CELL])
    return start, found[order].astype(np.int32), grid, shape.astype(np.int32)


def _near_line(wall: Floats, x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Return which cells, by their centres, a wall's line can cross."""
    away = np.abs((x - wall[0]) * wall[3] - (y - wall[1]) * wall[2])
    return np.asarray(away <= 0.7072 * GRID_CELL + 1e-6)
