"""Maps of walls: their prior, chains of them, and a map as rectangles, as centre lines and as the region covered."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.special import ive

from prf.kernels import constants as c
from prf.kernels.readings.sonar_features import MAY_CROSS
from prf.kernels.state.chain import Chain
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import make_grid
from prf.kernels.walls.cover import cover_all
from prf.kernels.walls.law import ALIKE, THICKEST, THINNEST, UNCOMMON
from prf.kernels.walls.shape import number_walls
from prf.kernels.walls.step import run_walls
from prf.kernels.walls.table import MOST_WALLS, N_ROW, N_WALL_COUNTS, Walls
from prf.model.coloring import Coloring, from_polygons, outline_of_rectangles
from prf.model.layout import make_graph
from prf.model.orientation import MEAN_STRENGTH, Orientation
from prf.model.ranges import FIRST_LEVEL
from prf.model.window import INTERIOR, Window

Floats = NDArray[np.float64]

SPREAD = 0.5
"""Standard deviation of the logarithm of a common value of the thickness."""
GROWN = 1e-6
"""Metres by which walls are grown, each a little differently, where rounding would decide what lies within what."""
FIRST_OF_WALLS = 1_000
"""Beams at least that are evaluated at first, where there are further stages."""
NEAR_SQUARES = 5
"""Side of the cells that say where returns are near, in squares that births are aimed at."""
N_WALL = 5
"""Numbers of a wall: x and y of both ends of its centre line, and its thickness, metres."""


@dataclasses.dataclass(frozen=True)
class WallPrior:
    """A Poisson process of walls with what its interactions cost (:mod:`prf.kernels.walls.law`)."""

    density: float = 0.4  # walls a square metre
    length: float = 1.5  # median, m
    thickness: float = 0.12  # median of its common values, m
    free_end: float = 0.5  # nats
    crossing: float = 3.0  # nats

    def common(self) -> Floats:
        """Return where the common values of the thickness start, (N_COMMON,) in metres."""
        found: Floats = self.thickness * np.exp(SPREAD * np.linspace(-1.0, 1.0, c.N_COMMON))
        return found

    def log_common(self, common: Floats) -> float:
        """Return the log prior of common values, up to a constant; -inf outside the bounds of a thickness."""
        if not ((common > THINNEST) & (common < THICKEST)).all():
            return -math.inf
        return float(-0.5 * ((np.log(common / self.thickness) / SPREAD) ** 2).sum() - np.log(common).sum())

    def lines(self, orientation: Orientation, strength: float, angle: float, common: Floats) -> Floats:
        """Return the laws of direction and thickness as the kernels read them, with the prior of what is sampled."""
        lines = np.zeros(c.N_LINES + c.N_COMMON)
        lines[c.ORIENTATION], lines[c.ANGLE] = strength, angle
        lines[c.COS_ANGLE], lines[c.SIN_ANGLE] = math.cos(4.0 * angle), math.sin(4.0 * angle)
        lines[c.LOG_MEAN] = math.log(ive(0, strength)) + strength
        lines[c.LOG_NORMALISER] = -self.log_common(common)
        if orientation.strength is None:
            lines[c.LOG_NORMALISER] += strength / MEAN_STRENGTH
        lines[c.N_LINES :] = common
        return lines


def thickness_density(thickness: Floats, common: Floats) -> Floats:
    """Return the density of thicknesses (n,) in their bounds, 1/m, given the common values."""
    z = (thickness[:, None] - common) / ALIKE
    peaks = np.exp(-0.5 * z * z).sum(axis=1) / (ALIKE * math.sqrt(2.0 * math.pi))
    even = UNCOMMON / (thickness * math.log(THICKEST / THINNEST))
    found: Floats = even + (1.0 - UNCOMMON) / len(common) * peaks
    return found


def scratch_walls(chain: Chain) -> Walls:
    """Return the table of a run, which :func:`prf.kernels.walls.table.fill` fills."""
    grid = make_grid(*Window(*chain.graph.window.tolist()), NEAR_SQUARES * chain.targets.grid.cell)
    capacity = len(chain.graph.edge_length) // 4 + MOST_WALLS
    return Walls(
        np.zeros((capacity, N_ROW)),
        np.zeros((4, capacity)),
        np.zeros(capacity, np.int64),
        np.zeros((MOST_WALLS, N_ROW)),
        np.zeros(MOST_WALLS, np.int64),
        np.zeros(N_WALL_COUNTS, np.int64),
        grid,
        np.zeros(grid.nx * grid.ny, np.uint8),
    )


def moves_of(prior: WallPrior | None) -> tuple[tuple[str, float], ...]:
    """Return the name and the weight of each move of a chain."""
    return c.MOVES if prior is None else c.WALL_MOVES


def first_level(prior: WallPrior | None) -> int:
    """Return how many beams are evaluated at first at least: a wall has many on it, few of which tell."""
    return FIRST_LEVEL if prior is None else FIRST_OF_WALLS


def graph_at(prior: WallPrior | None, coloring: Coloring, capacity: int) -> Graph:
    """Return the graph of a map, of walls as :func:`map_of_walls` returns it, with room for so many vertices."""
    graph = make_graph(coloring, capacity)
    if prior is not None:
        number_walls(graph)
    return graph


def has_walls(chain: Chain) -> bool:
    """Return whether the map of a chain is one of walls."""
    return bool(chain.density[c.WALL_DENSITY] > 0.0)


def run_in_walls(chain: Chain, rng: np.random.Generator, step: int) -> bool:
    """Run a chain of walls up to `step`; return False if it needs room first."""
    chain.cones.sight.counts[MAY_CROSS] = 1
    return bool(run_walls(chain, scratch_walls(chain), rng, step))


def cover(chain: Chain) -> None:
    """Count the walls of a map of walls over pixels, points and sensors, whose colours by parity are wrong."""
    if has_walls(chain):
        sensors = chain.sensors
        chain.cones.sight.counts[MAY_CROSS] = 1
        cover_all(chain.graph, chain.image, chain.points, np.zeros((4, 2)), sensors.black, sensors.xy)


def corners_of(walls: Floats) -> Floats:
    """Return the corners (n, 4, 2) of walls (n, N_WALL), counter-clockwise from the right of the first end."""
    a, b = walls[:, :2], walls[:, 2:4]
    unit = (b - a) / np.hypot(*(b - a).T)[:, None]
    right = 0.5 * walls[:, 4:5] * np.stack([unit[:, 1], -unit[:, 0]], axis=1)
    return np.stack([a + right, b + right, b - right, a - right], axis=1)


def map_of_walls(walls: Floats, window: Window) -> Coloring:
    """Return the graph of walls (n, N_WALL) as a chain has it: four sides each, which may cross others'.

    It is no valid map, but what :func:`walls_of` and :func:`united` take.
    """
    xy = corners_of(walls).reshape(-1, 2)
    first = np.arange(len(xy), dtype=np.int32)
    edges = np.stack([first, first - first % 4 + (first + 1) % 4], axis=1)
    return Coloring(window, xy, np.full(len(xy), INTERIOR, np.int8), edges, False)


def walls_of(rectangles: Coloring) -> Floats:
    """Return the walls (n, N_WALL) of a graph of rectangles, whatever the order of its edges."""
    n = len(rectangles.xy)
    after = np.zeros(n, np.int64)
    after[rectangles.edges[:, 0]] = rectangles.edges[:, 1]
    ring = np.stack([np.arange(n), after, after[after], after[after[after]]], axis=1)
    corner = rectangles.xy[ring[ring[:, 0] == ring.min(axis=1)]]
    longer = np.hypot(*(corner[:, 1] - corner[:, 0]).T) >= np.hypot(*(corner[:, 2] - corner[:, 1]).T)
    corner = np.where(longer[:, None, None], corner, np.roll(corner, -1, axis=1))
    a, b = 0.5 * (corner[:, 0] + corner[:, 3]), 0.5 * (corner[:, 1] + corner[:, 2])
    return np.column_stack([a, b, np.hypot(*(corner[:, 3] - corner[:, 0]).T)])


def united(rectangles: Coloring) -> Coloring:
    """Return the map that is black where a wall is.

    Walls that touch in a line or a point are grown first, by less than a file shows.
    """
    walls = walls_of(rectangles)
    for grown in (0.0, 1.0, 2.0, 4.0):
        found = outline_of_rectangles(corners_of(_grown(walls, grown * GROWN)), rectangles.window)
        if found is not None:
            return found
    return from_polygons(shapely.MultiPolygon(list(shapely.polygons(corners_of(walls)))), rectangles.window)


def _grown(walls: Floats, by: float) -> Floats:
    """Return walls longer and thicker by one to two times `by` metres, no two of them by the same."""
    by_each = by * (1.0 + np.arange(len(walls)) * 0.5 * (math.sqrt(5.0) - 1.0) % 1.0)
    a, b = walls[:, :2], walls[:, 2:4]
    ahead = by_each[:, None] * (b - a) / np.hypot(*(b - a).T)[:, None]
    return np.column_stack([a - ahead, b + ahead, walls[:, 4] + by_each])


@dataclasses.dataclass(frozen=True, eq=False)
class WallDraws:
    """The walls of many draws, one after the other; draw i owns the rows between offsets i and i + 1.

    Attributes
    ----------
    offsets : (n + 1,) int64 array
    wall : (sum of n_walls, 5) float64 array
        x and y of both ends of the centre line, and the thickness; metres.
    """

    offsets: NDArray[np.int64]
    wall: Floats

    @classmethod
    def of(cls, draws: Sequence[Floats]) -> WallDraws:
        """Return draws, walls (n, 5) each."""
        counts = np.array([len(walls) for walls in draws], np.int64)
        return cls(np.append(0, np.cumsum(counts)), np.concatenate([np.zeros((0, N_WALL)), *draws]))

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.offsets) - 1

    def __getitem__(self, i: int) -> Floats:
        """Return the walls (n, 5) of draw `i` (IndexError outside -n ... n - 1)."""
        i = range(len(self))[i]
        return self.wall[self.offsets[i] : self.offsets[i + 1]]
