"""Where a robot can be, and how it gets from place to place: a grid over the space in which it has clearance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage, sparse
from shapely.geometry.base import BaseGeometry

from prf.shell.errors import InputError
from prf.simulate.world import Floats, World

CELL = 0.1
"""Metres. Half a robot's play in a doorway: a coarser grid would lose doors."""
PLAY = 0.02
"""Metres between robot and walls: a step between two cells cuts a corner by 0.01 m, and the arcs of a buffer run inside
the true ones."""
MOST_CELLS = 2_500_000
NEIGHBOURS = ((0, 1), (1, -1), (1, 0), (1, 1))
"""Half of the eight steps to a neighbour; the other half is the way back."""


class Roadmap(NamedTuple):
    """The places a robot can reach from one another.

    Attributes
    ----------
    xy : (n, 2) float64
        Centres of cells, metres, row by row from the lowest y.
    clearance : (n,) float64
        Metres from each centre to the nearest place where the robot cannot be, about.
    steps : (n, n) sparse array
        Metres between neighbours, both ways.
    blocked : shapely geometry
        Where the centre of the robot must not be.
    """

    xy: Floats
    clearance: Floats
    steps: sparse.csr_array
    blocked: BaseGeometry

    @property
    def area(self) -> float:
        """Return the area in which the centre of the robot can be, in square metres, about."""
        return len(self.xy) * CELL**2

    def clear(self, start: Floats, ends: Floats) -> NDArray[np.bool_]:
        """Return whether the straight ways from a point (2,) to points (n, 2) keep clear of everything."""
        ways = np.stack([np.broadcast_to(start, ends.shape), ends], axis=1)
        free: NDArray[np.bool_] = ~shapely.intersects(self.blocked, shapely.linestrings(ways))
        return free


def roadmap(world: World, radius: float, start: tuple[float, float] | None = None) -> Roadmap:
    """Return the largest connected space for a robot, or that round `start`.

    Parameters
    ----------
    world : World
    radius : float
        Of the robot, metres; it stays inside the window too.
    start : (x, y), optional
        A place of the robot, metres.

    Raises
    ------
    InputError
        If the robot fits nowhere, or not at `start`, or the world is too large for the grid.
    """
    window = world.window
    shape = tuple(max(1, int(length / CELL)) for length in (window.height, window.width))
    if shape[0] * shape[1] > MOST_CELLS:
        most = MOST_CELLS * CELL**2
        raise InputError(f"world of {window.area:.0f} m2: paths are planned in up to {most:.0f} m2. Give --path FILE.")
    blocked = _blocked(world, radius)
    xy = _centres(world, shape)
    free = ~shapely.contains_xy(blocked, xy) & window._replace(
        x_min=window.x_min + radius,
        y_min=window.y_min + radius,
        x_max=window.x_max - radius,
        y_max=window.y_max - radius,
    ).contains(xy)
    free = free.reshape(shape)
    part, n_parts = ndimage.label(free, np.ones((3, 3)))
    if n_parts == 0:
        raise InputError(f"no space for a robot of radius {radius:g} m. Give a smaller --robot-radius, or a --path.")
    kept = part == _chosen(part, xy, radius, start)
    clearance = ndimage.distance_transform_edt(np.pad(kept, 1))[1:-1, 1:-1] * CELL
    places = kept.ravel()
    return Roadmap(xy[places], clearance.ravel()[places], _steps(kept, xy), blocked)


def _blocked(world: World, radius: float) -> BaseGeometry:
    """Return where the centre of the robot cannot be."""
    blocked = world.occupied.buffer(radius + PLAY, quad_segs=8)
    shapely.prepare(blocked)
    return blocked


def _centres(world: World, shape: tuple[int, ...]) -> Floats:
    n_y, n_x = shape
    window = world.window
    x = window.x_min + (np.arange(n_x) + 0.5) * window.width / n_x
    y = window.y_min + (np.arange(n_y) + 0.5) * window.height / n_y
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _chosen(part: NDArray[np.int32], xy: Floats, radius: float, start: tuple[float, float] | None) -> int:
    """Return the number of the largest part, or of the one at `start`."""
    if start is None:
        return int(np.bincount(part.ravel())[1:].argmax()) + 1
    places = np.flatnonzero(part.ravel())
    away = np.hypot(*(xy[places] - np.asarray(start)).T)
    nearest = int(away.argmin())
    if away[nearest] > 2.0 * CELL:
        raise InputError(f"--start {start[0]:g} {start[1]:g}: a robot of radius {radius:g} m does not fit there.")
    return int(part.ravel()[places[nearest]])


def _steps(kept: NDArray[np.bool_], xy: Floats) -> sparse.csr_array:
    """Return the lengths of the steps between neighbouring places."""
    number = np.full(kept.shape, -1)
    number[kept] = np.arange(np.count_nonzero(kept))
    grid = np.pad(number, 1, constant_values=-1)
    n_y, n_x = kept.shape
    ones, others = [], []
    for down, right in NEIGHBOURS:
        other = grid[1 + down : 1 + down + n_y, 1 + right : 1 + right + n_x]
        joined = (number >= 0) & (other >= 0)
        ones.append(number[joined])
        others.append(other[joined])
    one, other = np.concatenate(ones), np.concatenate(others)
    places = xy[kept.ravel()]
    length = np.hypot(*(places[one] - places[other]).T)
    n = len(places)
    steps = sparse.coo_array((length, (one, other)), (n, n))
    return sparse.csr_array(steps + steps.T)
