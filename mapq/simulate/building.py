"""Office buildings: facades with recessed windows and doors, setbacks, blank walls between neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapq.simulate.kinds import Kind
from mapq.simulate.scene import SceneBuilder

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Windows:
    """The grid of windows of one building.

    Attributes
    ----------
    pitch, width : float
        From window to window along the facade, and of one window, in metres.
    storey, sill, height : float
        Of a storey, of the parapet below the window, and of the window.
    recess : float
        How far the pane lies behind the facade.
    """

    pitch: float
    width: float
    storey: float
    sill: float
    height: float
    recess: float


@dataclass(frozen=True)
class Line:
    """A facade's place: from `start` to `end`, the building on the side of the unit vector `inward`."""

    start: Vector
    end: Vector
    inward: Vector

    @classmethod
    def facing(cls, start: Vector, end: Vector, inward: Vector) -> Line:
        """Return the line with the unit normal that points to the side of `inward`."""
        along = (end - start) / np.hypot(*(end - start))
        normal = np.array([-along[1], along[0]])
        return cls(start, end, normal if normal @ inward > 0.0 else -normal)

    @property
    def length(self) -> float:
        """Length in metres."""
        return float(np.hypot(*(self.end - self.start)))

    @property
    def along(self) -> Vector:
        """Unit vector from start to end."""
        return np.asarray((self.end - self.start) / self.length)

    def shifted(self, depth: float) -> Line:
        """Return the line moved into the building."""
        return Line(self.start + depth * self.inward, self.end + depth * self.inward, self.inward)

    def piece(self, first: float, last: float) -> Line:
        """Return the part between two distances from the start."""
        return Line(self.start + first * self.along, self.start + last * self.along, self.inward)


def draw_windows(rng: np.random.Generator) -> Windows:
    """Return the windows of one building."""
    pitch = rng.uniform(2.2, 4.2)
    storey = rng.uniform(3.0, 3.8)
    return Windows(
        pitch,
        pitch * rng.uniform(0.45, 0.72),
        storey,
        rng.uniform(0.7, 1.1),
        storey * rng.uniform(0.42, 0.55),
        rng.uniform(0.15, 0.4),
    )


def add_building(
    builder: SceneBuilder,
    front: Line,
    depth: float,
    height: float,
    open_sides: tuple[bool, bool],
    gaps: tuple[bool, bool],
    rng: np.random.Generator,
) -> None:
    """Add a building behind its front line.

    Parameters
    ----------
    builder : SceneBuilder
    front : Line
    depth, height : float
        In metres.
    open_sides : pair of bool
        Whether the side at the line's start, and at its end, faces a street and has windows.
    gaps : pair of bool
        Whether a narrow gap separates that side from a neighbour: two walls close to each other, and true.
    rng : Generator
    """
    windows = draw_windows(rng)
    back = front.shifted(depth)
    builder.wall(back.start, back.end, (0.0, height), Kind.SIDE_WALL)
    setback = height > 2.4 * windows.storey and rng.random() < 0.2
    lower = windows.storey * np.floor(height / windows.storey - 1.0) if setback else height
    add_facade(builder, front, (0.0, lower), windows, rng)
    if setback:
        inset = rng.uniform(1.0, 2.5)
        add_facade(builder, front.shifted(inset), (lower, height), windows, rng)
        flat = np.array([*(front.inward * inset), 0.0])
        builder.sheet(np.array([*front.start, lower]), np.array([*(front.end - front.start), 0.0]), flat, Kind.ROOF)
    for end, is_open, is_gap in zip((0, 1), open_sides, gaps, strict=True):
        corners = (front.start, back.start) if end == 0 else (front.end, back.end)
        if is_open:
            inward = front.along if end == 0 else -front.along
            add_facade(builder, Line(*corners, inward), (0.0, height), windows, rng)
        else:
            builder.wall(*corners, (0.0, height), Kind.SIDE_WALL, look_alike=is_gap)


def add_facade(
    builder: SceneBuilder, line: Line, z: tuple[float, float], windows: Windows, rng: np.random.Generator
) -> None:
    """Add a facade with as many windows as fit, and a door where it stands on the ground."""
    surface = builder.surface(line.inward)
    columns = int((line.length - 0.8) / windows.pitch)
    storeys = int((z[1] - z[0]) / windows.storey)
    if columns < 1 or storeys < 1:
        builder.wall(line.start, line.end, z, Kind.FACADE, surface)
        return
    margin = 0.5 * (line.length - columns * windows.pitch)
    upper = z[0]
    if z[0] == 0.0:
        upper = min(windows.storey, z[1])
        door = int(rng.integers(columns))
        first, last = margin + door * windows.pitch, margin + (door + 1) * windows.pitch
        _add_door(builder, line.piece(first, last), windows, surface)
        _add_windows(builder, line.piece(0.0, first), (0.0, upper), windows, surface, (margin, door))
        right = line.piece(last, line.length)
        _add_windows(builder, right, (0.0, upper), windows, surface, (0.0, columns - door - 1))
    if upper < z[1] - 1e-9:
        _add_windows(builder, line, (upper, z[1]), windows, surface, (margin, columns))


def _add_door(builder: SceneBuilder, line: Line, windows: Windows, surface: int) -> None:
    """Add one column of the ground floor with a door instead of a window."""
    first = 0.5 * (line.length - windows.width)
    height = min(2.3, windows.storey - 0.2)
    holes = ((first, line.length, windows.width, first + windows.width), (0.0, height + 1.0, height, height))
    builder.wall(line.start, line.end, (0.0, windows.storey), Kind.FACADE, surface, holes)
    _add_recess(builder, line.piece(first, first + windows.width), (0.0, height), windows.recess)


def _add_windows(
    builder: SceneBuilder,
    line: Line,
    z: tuple[float, float],
    windows: Windows,
    surface: int,
    columns: tuple[float, int],
) -> None:
    """Add a part of a facade with storeys of windows; `columns`: where the first one begins, and how many."""
    margin, n_columns = columns
    n_storeys = int((z[1] - z[0]) / windows.storey + 1e-9)
    if n_columns < 1 or n_storeys < 1:
        builder.wall(line.start, line.end, z, Kind.FACADE, surface)
        return
    first = margin + 0.5 * (windows.pitch - windows.width)
    low = z[0] + windows.sill
    across = (first, windows.pitch, windows.width, first + n_columns * windows.pitch - 1e-6)
    upward = (low, windows.storey, windows.height, low + n_storeys * windows.storey - 1e-6)
    builder.wall(line.start, line.end, z, Kind.FACADE, surface, (across, upward))
    for column in range(n_columns):
        u = first + column * windows.pitch
        opening = line.piece(u, u + windows.width)
        bottoms = [low + storey * windows.storey for storey in range(n_storeys)]
        for bottom in bottoms:
            _add_pane(builder, opening, (bottom, bottom + windows.height), windows.recess)
        _add_jambs(builder, opening, (bottoms[0], bottoms[-1] + windows.height), windows.recess)
    for storey in range(n_storeys):
        bottom = low + storey * windows.storey
        for edge in (bottom, bottom + windows.height):
            _add_ledge(builder, line, edge, windows.recess)


def _add_recess(builder: SceneBuilder, opening: Line, z: tuple[float, float], recess: float) -> None:
    """Add what is behind one hole: a pane or a door, its two sides, and its lintel."""
    _add_pane(builder, opening, z, recess)
    _add_jambs(builder, opening, z, recess)
    _add_ledge(builder, opening, z[1], recess)


def _add_pane(builder: SceneBuilder, opening: Line, z: tuple[float, float], recess: float) -> None:
    pane = opening.shifted(recess)
    builder.wall(pane.start, pane.end, z, Kind.RECESS)


def _add_jambs(builder: SceneBuilder, opening: Line, z: tuple[float, float], recess: float) -> None:
    """Add the two sides of the openings of one column, in one piece: behind the facade nobody sees it."""
    for corner in (opening.start, opening.end):
        builder.wall(corner, corner + recess * opening.inward, z, Kind.REVEAL)


def _add_ledge(builder: SceneBuilder, line: Line, z: float, recess: float) -> None:
    """Add the sills or the lintels of a storey."""
    along, inward = np.array([*(line.end - line.start), 0.0]), np.array([*(recess * line.inward), 0.0])
    builder.sheet(np.array([*line.start, z]), along, inward, Kind.REVEAL)
