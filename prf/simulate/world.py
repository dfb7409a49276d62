"""`World`: the truth of a simulation, occupied area in a window, and its walls as a sensor meets them.

Worlds are from GeoJSON, from grid maps of ROS (map_server's yaml file and image), or draws from the prior.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, from_polygons, occupied_polygons
from prf.model.coloring.polygons import turning_corners
from prf.model.window import SIDES, Window
from prf.results.geojson import area_of_cells, outline_of_cells
from prf.results.score import OccupiedArea, read_occupied_area
from prf.shell.cli.files import open_input
from prf.shell.errors import ConfigError, InputError

Floats = NDArray[np.float64]

STRAIGHT = 1e-9  # metres that a vertex may stick out of the line of its neighbours before it counts as a corner


@dataclass(frozen=True, eq=False)
class World:
    """What is occupied, and its boundary."""

    window: Window  # where the world is known. Its border is not a wall: nothing beyond it is ever met
    occupied: MultiPolygon  # occupied area inside the window, holes kept, in metres
    # (n, 4) ``x1 y1 x2 y2`` in metres, free space on the left of the way from 1 to 2; ring by ring, the end of a wall
    # is the beginning of the next to the last bit, but where the window cuts a ring. Neighbours are never in line
    walls: Floats

    @classmethod
    def from_polygons(cls, occupied: BaseGeometry, window: Window) -> World:
        """Return the world that is occupied on `occupied`, clipped to the window."""
        return cls.from_coloring(from_polygons(without_straight(occupied), window))

    @classmethod
    def from_coloring(cls, coloring: Coloring) -> World:
        """Return the world that is occupied where a coloring is black."""
        occupied = occupied_polygons(coloring)
        return cls(coloring.window, occupied, _walls(occupied, coloring.window))

    def coloring(self) -> Coloring:
        """Return the world as a coloring of its window."""
        if (
            self.occupied.is_empty or len(self.walls) == 0
        ):  # no ring determines which of the two colours fills the window
            return Coloring.empty(self.window, not self.occupied.is_empty)
        return from_polygons(self.occupied, self.window)

    def free_at(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return which points (n, 2) are free: inside the window, neither in occupied area nor on a wall."""
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        shapely.prepare(self.occupied)
        occupied = shapely.intersects_xy(self.occupied, points)
        free: NDArray[np.bool_] = self.window.contains(points) & ~occupied
        return free


def without_straight(region: BaseGeometry) -> MultiPolygon:
    """Return a region whose rings have no vertex at which nothing turns: unions leave them in the middle of walls.

    `region`: whatever has no area is left out.
    """
    cleaned = []
    for part in shapely.get_parts(region):
        rings = [_bent(ring) for ring in shapely.get_rings(part)] if isinstance(part, Polygon) else []
        if rings and len(rings[0]) > 2:
            cleaned.append(Polygon(rings[0], [ring for ring in rings[1:] if len(ring) > 2]))
    return MultiPolygon(cleaned)


def _bent(ring: BaseGeometry) -> Floats:
    """Return the corners (n, 2) of a ring, the first one not repeated."""
    return turning_corners(shapely.get_coordinates(ring)[:-1], STRAIGHT)


def _walls(occupied: MultiPolygon, window: Window) -> Floats:
    """Return the sides of all rings, outlines clockwise and holes counter-clockwise, without those on the border."""
    turned = [orient(polygon, sign=-1.0) for polygon in occupied.geoms]
    rings = shapely.get_rings(np.array(turned, dtype=object))
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    follows = ring[:-1] == ring[1:]
    walls = np.hstack([xy[:-1][follows], xy[1:][follows]])
    along = np.zeros(len(walls), dtype=np.bool_)
    for side in SIDES:
        at = window.side_coordinate(side)
        along |= (walls[:, 1 - side % 2] == at) & (walls[:, 3 - side % 2] == at)
    return np.ascontiguousarray(walls[~along])


MARGIN = 1.0  # metres of free space round polygons without a window
MAX_DRAWS = 1000
YAML_SUFFIXES = (".yaml", ".yml")
FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65  # of a yaml file that has none
PADDING = 2  # occupied cells round the map, so that no wall touches the window at a point
TOLERANCE = 1.0  # cells by which contours may be off: staircases of slanted walls become straight
ENTRY = re.compile(r"^(\w+)\s*:\s*([^#\n]*?)\s*(?:#.*)?$", re.MULTILINE)


def read_world(path: str | os.PathLike[str]) -> World:
    """Read a world from GeoJSON polygons of occupied area, or from the yaml file of a ROS map.

    `path`: geoJSON of any program, in metres; a property ``window`` is kept. Unknown cells of a ROS map are occupied.
    """
    if Path(path).suffix.lower() in YAML_SUFFIXES:
        return world_of_cells(read_cell_map(path))
    area = read_occupied_area(path)
    if area.window is None and area.region.is_empty:
        raise InputError(f"{path}: expected polygons of the occupied area, or a property window.")
    window = area.window or Window.beyond(area.region.bounds, MARGIN)
    try:
        return World.from_polygons(area.region, window)
    except InputError as error:
        raise InputError(f"{path}: {error}. Separate polygons that touch at a point.") from error


def draw_world(
    scale: float, window: Window, rng: np.random.Generator, accept: Callable[[World], bool]
) -> tuple[World, int]:
    """Draw from the Arak process until a draw can be used.

    `scale`: p in 1/m. `accept`: whether a world can be used. The world returned is a draw from the prior given that it
    can; beside it is how many draws went before it.
    """
    for n_redrawn in range(MAX_DRAWS):
        world = World.from_coloring(exact_draws(scale, window, 1, rng)[0])
        if accept(world):
            return world, n_redrawn
    raise ConfigError(
        f"scale {scale:g}: none of {MAX_DRAWS} draws leaves enough free space. Take a smaller scale, or another size."
    )


class CellMap(NamedTuple):
    """A grid map."""

    # occupied, unknown: (ny, nx) row 0 has the lowest y; free is what is neither
    occupied: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    origin: tuple[float, float]  # lower left corner of cell (0, 0), metres
    resolution: float  # side of a cell, metres

    def window(self, padding: int = 0) -> Window:
        """Return the window of the cells and `padding` more round them."""
        ny, nx = self.occupied.shape
        x0, y0 = (at - padding * self.resolution for at in self.origin)
        side = self.resolution
        return Window.checked(x0, y0, x0 + (nx + 2 * padding) * side, y0 + (ny + 2 * padding) * side)


def read_cell_map(path: str | os.PathLike[str]) -> CellMap:
    """Read the yaml file of a map of mode trinary, whose image is named relative to it (https://wiki.ros.org/map_server)."""
    with open_input(path) as stream:
        entries = dict(ENTRY.findall(stream.read().decode("utf-8", "replace")))
    try:
        x, y, yaw = map(float, entries["origin"].strip("[]").split(","))
        resolution = float(entries["resolution"])
        free = float(entries.get("free_thresh", FREE_THRESHOLD))
        taken = float(entries.get("occupied_thresh", OCCUPIED_THRESHOLD))
        shade = _shades(Path(path).parent / entries["image"].strip("'\""))
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{path}: not the yaml file of a map_server map ({error}). It has image, resolution and origin [x, y, yaw]."
        ) from error
    if yaw != 0.0 or entries.get("mode", "trinary") != "trinary":
        raise InputError(f"{path}: only maps of mode trinary that are not turned (yaw 0) can be read.")
    occupancy = shade if entries.get("negate", "0").lower() in ("1", "true") else 1.0 - shade
    cells = CellMap(occupancy > taken, (occupancy >= free) & (occupancy <= taken), (x, y), resolution)
    try:
        cells.window(PADDING)
    except ConfigError as error:
        raise InputError(f"{path}: {error}") from error
    return cells


def _shades(path: Path) -> NDArray[np.float64]:
    """Return an image from 0 (black) to 1 (white), (ny, nx), the lowest row first."""
    from PIL import Image  # noqa: PLC0415 - matplotlib brings it, and only these maps need it

    with open_input(path) as stream:
        try:
            with Image.open(stream) as image:
                return np.asarray(image.convert("L"), dtype=np.float64)[::-1] / 255.0
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(f"{path}: not an image that can be read ({reason}).") from error


def area_of_map(cells: CellMap) -> OccupiedArea:
    """Return the occupied area, staircases straightened, in the map's window."""
    return OccupiedArea(area_of_cells(cells.occupied, np.array(cells.origin), cells.resolution), cells.window())


def world_of_cells(cells: CellMap) -> World:
    """Return the world of a grid map, walls straight to about a cell.

    Cells that touch at a corner alone are joined, since a wall has an inside and an outside everywhere.
    """
    taken = _joined(np.pad(cells.occupied | cells.unknown, PADDING, constant_values=True))
    window = cells.window(PADDING)
    contours = outline_of_cells(taken, np.array(window[:2]), cells.resolution)
    return World.from_polygons(shapely.simplify(contours, TOLERANCE * cells.resolution), window)


def _joined(taken: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return cells after filling one beside every two that touch at a corner alone."""
    joined = taken.copy()
    while True:
        lower, upper = joined[:-1], joined[1:]
        rising = lower[:, :-1] & upper[:, 1:] & ~lower[:, 1:] & ~upper[:, :-1]
        falling = lower[:, 1:] & upper[:, :-1] & ~lower[:, :-1] & ~upper[:, 1:]
        if not (rising.any() or falling.any()):
            return joined
        joined[:-1, 1:] |= rising
        joined[:-1, :-1] |= falling
