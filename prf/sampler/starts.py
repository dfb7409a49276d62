"""Where chains start: the empty map, the contour of an occupancy grid, or where a draw of the prior leads.

Chains that start alike may agree for lack of time to separate. Contours differ from chain to chain in the readings that
they use, draws of the prior in everything. No step on the way to a start is a step of the chain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from prf.configuration import Start
from prf.kernels import constants as c
from prf.kernels.score.occupancy import Cells, update_beams
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.grid import make_grid, most_cells
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, from_polygons, occupied_polygons
from prf.model.laser import unit_vectors, window_exit
from prf.model.layout import read_coloring
from prf.model.window import Window
from prf.readings.ground import cleared
from prf.sampler.state import make_chain, run_chain
from prf.sampler.target import LaserData, Target, occupied_cost, one_colour_map, white_places
from prf.shell.errors import ConfigError, InputError

LOWEST_POWER = 0.003
"""Power of the likelihood with which a chain leaves a draw of the prior."""
RISE = 30
"""Looks over which the power rises to 1."""
LOOK = 10_000
"""Steps between two looks."""
MOST_DOUBLINGS = 20
"""How often, from look to look, the cost of an occupied sensor doubles if one still is."""
CELL = 0.1
"""Side of the cells of the grid, metres; larger where the window would have too many."""
MOST_CELLS = 10_000_000
GRID_SHARE = 0.5
"""Share of the readings that a chain's grid is made of."""
OCCUPIED = 0.35
"""Share of hits among hits and misses above which a cell is taken to be black."""
CLEAR = 1.2
"""Sides of a cell round every sensor that are kept white."""
BORDER = 0.05
"""Black keeps away from the border of the window by this, metres."""
SEAM = 0.005
"""Metres that black loses all round: parts that touch in a point come apart."""
LEAST_PART = 2.0
"""Smallest area of a part that is kept, in cells."""
TOLERANCES = (1.0, 0.5, 0.1)
"""Sides of a cell by which corners may be straightened; the next is tried where the one before makes no map."""


def find_start_map(
    start: Start, target: Target, rng: np.random.Generator, stop_requested: Callable[[], bool]
) -> Coloring:
    """Return a map to start from, every sensor in white."""
    if start == "grid":
        return contour_map(target, rng)
    return from_prior(target, rng, stop_requested) if start == "prior" else one_colour_map(target)


def from_prior(target: Target, rng: np.random.Generator, stop_requested: Callable[[], bool]) -> Coloring:
    """Return where a chain from an exact draw of the prior arrives.

    The power of its likelihood rises from next to nothing to 1, so that colours settle before walls. An occupied sensor
    costs a finite number of nats; in the end that number rises until there is none. What is black round a sensor even
    then, or when the search is cut short, is cut out.
    """
    draw = exact_draws(target.scale, target.window, 1, rng)[0]
    chain = make_chain(target.with_execution(resolution=None), draw)
    cost = occupied_cost(target, len(chain.sensors.xy))
    for look in range(1, RISE + MOST_DOUBLINGS + 1):
        if stop_requested() or (look > RISE and chain.graph.counts[c.OCCUPIED] == 0):
            break
        chain.density[c.LIKELIHOOD_POWER] = LOWEST_POWER ** (1.0 - min(look, RISE) / RISE)
        chain.density[c.OCCUPIED_COST] = cost * 2.0 ** max(0, look - RISE)
        chain = run_chain(chain, rng, look * LOOK)
        recompute_sums(chain)
    coloring = read_coloring(chain.graph)
    return map_of_region(occupied_polygons(coloring), target) if chain.graph.counts[c.OCCUPIED] else coloring


def contour_map(target: Target, rng: np.random.Generator) -> Coloring:
    """Return the contour of an occupancy grid of a random half of the laser readings."""
    if target.laser is None:
        raise ConfigError("sampler.start grid: needs the readings of a laser. Choose another start.")
    window = target.window
    cell = max(CELL, float(np.sqrt(window.area / MOST_CELLS)))
    chosen = rng.random(target.laser.readings.n_beams) < GRID_SHARE
    return map_of_region(_occupied_region(window, target.laser, chosen, cell), target, cell)


def map_of_region(region: BaseGeometry, target: Target, cell: float = CELL) -> Coloring:
    """Return a map that is black on a region as far as a map can be, and white round every sensor and on the way.

    Corners are straightened by about a cell. Where no straightening makes a valid map, it is the empty one.
    """
    places = shapely.points(np.unique(white_places(target), axis=0))
    clear = shapely.union_all(shapely.buffer(places, CLEAR * cell, quad_segs=2))
    clear = shapely.union(clear, cleared(target.way, target.driven_radius))
    x0, y0, x1, y1 = target.window
    inner = shapely.box(x0 + BORDER, y0 + BORDER, x1 - BORDER, y1 - BORDER)
    for tolerance in TOLERANCES:
        smooth = shapely.simplify(region, tolerance * cell)
        black = shapely.intersection(shapely.difference(shapely.make_valid(smooth), clear), inner)
        parts = shapely.get_parts(shapely.buffer(black, -SEAM, join_style="mitre"))
        kept = parts[(shapely.get_dimensions(parts) == 2) & (shapely.area(parts) > LEAST_PART * cell**2)]
        try:
            return from_polygons(shapely.MultiPolygon(list(kept)), target.window)
        except InputError:
            continue
    return one_colour_map(target)


def _occupied_region(window: Window, laser: LaserData, chosen: NDArray[np.bool_], cell: float) -> BaseGeometry:
    """Return the union of the cells that the chosen beams end in often enough, holes of a cell closed."""
    grid = make_grid(*window, cell)
    n = grid.nx * grid.ny
    cells = Cells(
        grid,
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n),
        np.zeros(4),
        np.empty(most_cells(grid), np.int32),
    )
    hit = laser.readings.select(chosen & (laser.readings.range < laser.model.limit))
    direction = unit_vectors(hit.angle)
    length = np.minimum(hit.range, window_exit(window, hit.origin, direction))
    segments = np.ascontiguousarray(np.hstack([hit.origin, hit.origin + length[:, None] * direction]))
    update_beams(cells, segments, np.ascontiguousarray(hit.range <= length))
    (black,) = np.nonzero((cells.hits > 0) & (cells.hits >= OCCUPIED * (cells.hits + cells.misses)))
    low = np.stack([grid.x0 + (black % grid.nx) * cell, grid.y0 + (black // grid.nx) * cell], axis=1)
    squares = shapely.union_all(shapely.box(*low.T, *(low + cell).T))
    wide = shapely.buffer(squares, 1.01 * cell, join_style="mitre")
    closed: BaseGeometry = shapely.buffer(wide, -1.01 * cell, join_style="mitre")
    return closed
