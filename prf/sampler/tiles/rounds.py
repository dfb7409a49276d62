"""A round: the map at its start, its tiles, and the readings laid out for them once, the same whatever the map.

Tiles and the length of a round are drawn by chance, readings and window, never by the map.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings.cones import MAX_DISTANCE
from prf.kernels.readings.sonar_features import BORDER, POSE_COS, POSE_SIN, POSE_X, POSE_Y
from prf.kernels.state.cell_lists import SegmentLists, list_segments
from prf.kernels.state.chain import Chain
from prf.kernels.state.grid import Grid, make_grid
from prf.kernels.state.targets import Targets
from prf.model.coloring import Coloring
from prf.model.layout import make_targets, read_coloring
from prf.model.ranges import beam_influence
from prf.model.sensors import LaserModel, SonarModel
from prf.model.window import INTERIOR, Window
from prf.readings.way import way_guards
from prf.sampler.chain import FIRST_THIN
from prf.sampler.target import NO_LASER, NO_SONAR, Target, poses_of, rays_of, return_points, white_places

Floats = NDArray[np.float64]

REL_TOL = 1e-6
"""Regions within which an obstacle matters are enlarged by this share: rounding must not let one slip through."""
COARSE = 3.0
"""Cells in which a round finds edges on beams, in units of the cells of a chain."""
NARROWEST = 0.35
"""Least width of a tile, as a share of the side of a square tile."""
STEPS_PER_READING = 4
"""Steps of a round: to begin and to end it costs time in proportion to the readings."""
ROUND_LENGTHS = (64 * FIRST_THIN, 1024 * FIRST_THIN)
"""Steps of the shortest and of the longest round; a longer one would keep Ctrl-C and the clock waiting."""
LOOK_STEPS = 4 * FIRST_THIN
"""Steps between two looks at the tiles of a round, where draws are recorded: each costs some milliseconds."""
PLAIN_SHARE = 1.0 / 64.0
"""Share of a round's steps that the chain makes on the whole window, where nothing stays because of a border.

They cannot be shared out, and each takes longer: memory for all readings does not fit a processor's caches.
"""
QUANTILES = (0.3, 0.7)
"""Between these shares of a rectangle's returns, or of its side where it has none, a cut is drawn."""

NO_PROBES = np.zeros(0, np.int64)


@dataclasses.dataclass(frozen=True)
class TileData:
    """Readings laid out for tiles."""

    target: Target
    laser: LaserModel  # models; of no consequence without readings
    sonar: SonarModel  # models; of no consequence without readings
    ray: Floats  # (n, N_RAY): beams as :func:`prf.model.ranges.make_rays` lays them out
    weight: Floats  # (n,): readings that each stands for
    influence: Floats  # (n,): distance beyond which no obstacle changes the likelihood of the beam, metres
    end: Floats  # (n, 2): point whose tile answers for the beam: where the return lies, or half way without one
    pose: Floats  # (m, N_POSE): sonar readings
    triangle: Floats  # (m, 6): corners of a triangle that holds the cone of each
    returns: Floats  # (k, 2): impacts of readings
    targets: Targets  # the squares that hold these
    # (s, 2): places that must be white, metres: those of sensors, and the ends of pieces of the way driven
    sensors: Floats
    ways: Floats  # (w, N_SHAPE): guards of the way that was driven


def make_tile_data(target: Target) -> TileData:
    """Lay out the readings of a run for its tiles."""
    ray, pose = rays_of(target), poses_of(target)
    laser = (target.laser or NO_LASER).model
    reach = ray[:, c.MAX_DISTANCE]
    influence = np.minimum(reach, beam_influence(laser, ray[:, c.RANGE]))
    returned = (ray[:, c.RANGE] >= 0.0) & np.isfinite(ray[:, c.RANGE])
    answered = np.where(returned, np.minimum(ray[:, c.RANGE], (1.0 - REL_TOL) * reach), 0.5 * reach)
    returns = return_points(target)
    return TileData(
        target=target,
        laser=laser,
        sonar=(target.sonar or NO_SONAR).model,
        ray=ray,
        weight=(target.laser or NO_LASER).readings.weight,
        influence=influence,
        end=ray[:, :2] + answered[:, None] * ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1],
        pose=pose,
        triangle=cone_triangles(pose),
        returns=returns,
        targets=make_targets(target.window, target.target_side(), returns),
        sensors=white_places(target),
        ways=way_guards(target.way, target.driven_radius),
    )


def cone_triangles(pose: Floats) -> Floats:
    """Return triangles (m, 6) that hold all of each cone up to its reach."""
    far, across = pose[:, [MAX_DISTANCE]] * (1.0 + REL_TOL), pose[:, BORDER] * (1.0 + REL_TOL)
    corners = [pose[:, [POSE_X, POSE_Y]] - REL_TOL * far * pose[:, [POSE_COS, POSE_SIN]]]
    for side in (-1.0, 1.0):
        x = pose[:, POSE_COS] - side * across * pose[:, POSE_SIN]
        y = pose[:, POSE_SIN] + side * across * pose[:, POSE_COS]
        corners.append(pose[:, [POSE_X, POSE_Y]] + far * np.stack([x, y], axis=1))
    return np.concatenate(corners, axis=1)


class Round(NamedTuple):
    """Map and tiles of a round, and how its chains step."""

    coloring: Coloring
    pixels: Grid  # of the image
    black: NDArray[np.uint8]  # (n_pixels,): their colours
    tiles: Floats  # (k, 4)
    edge_tile: NDArray[np.int32]  # (n_edges,): tile inside which an edge lies, or ``NONE``
    edges: SegmentLists  # by cells
    seeds: NDArray[np.int64]  # (k,)
    looks: NDArray[np.int64]  # (n,): steps of a tile at which what is there is kept; the last is the end
    probes: NDArray[np.int64]  # (n_probes,): pixels whose colour is kept with it
    density: Floats  # of the chain
    lines: Floats  # of the chain
    tuning: Floats  # of the chain
    move_probabilities: Floats  # of the chain, but for moves on the border
    aim: Floats  # (n_targets,): probabilities of the targets, summed

    @property
    def steps(self) -> int:
        """Steps in each tile."""
        return int(self.looks[-1])


def make_round(
    data: TileData,
    chain: Chain,
    n_tiles: int,
    least: float,
    steps: int,
    rng: np.random.Generator,
    n_looks: int = 1,
    probes: NDArray[np.int64] = NO_PROBES,
) -> Round:
    """Begin a round: draw its tiles and find what lies inside each; `probes` (n_probes,)."""
    coloring = read_coloring(chain.graph)
    tiles = random_tiles(data.target.window, n_tiles, data.returns, least, chain.image.grid, rng)
    vertex_tile = tiles_at(tiles, coloring.xy)
    vertex_tile[coloring.side != INTERIOR] = c.NONE
    first, last = vertex_tile[coloring.edges].T
    move_probabilities = chain.move_probabilities.copy()
    move_probabilities[list(c.BORDER_MOVES)] = 0.0  # left to the steps between rounds
    return Round(
        coloring,
        chain.image.grid,
        chain.image.black.copy(),
        tiles,
        np.where(first == last, first, c.NONE).astype(np.int32),
        list_segments(make_grid(*data.target.window, COARSE * data.target.cell_size()), coloring.segments()),
        seeds=rng.integers(0, 2**63, len(tiles)),
        looks=np.arange(1, n_looks + 1) * (steps // len(tiles)) // n_looks,
        probes=probes,
        density=chain.density.copy(),
        lines=chain.lines.copy(),
        tuning=chain.tuning.copy(),
        move_probabilities=move_probabilities / move_probabilities.sum(),
        aim=chain.targets.cumulative.copy(),
    )


def tiles_at(tiles: Floats, xy: Floats) -> NDArray[np.int32]:
    """Return the number (n,) of the tile that holds each point, NONE if no one does; `tiles` (k, 4), `xy` (n, 2)."""
    number = np.full(len(xy), c.NONE, np.int32)
    for k, tile in enumerate(tiles):
        number[((tile[:2] <= xy) & (xy < tile[2:])).all(axis=1)] = k
    return number


def narrowest(window: Window, n_tiles: int) -> float:
    """Return the least width of a tile, metres."""
    return NARROWEST * math.sqrt(window.area / n_tiles)


def looks_of(length: int) -> int:
    """Return the number of looks in a round of `length` steps."""
    return max(1, length // LOOK_STEPS)


def round_length(target: Target) -> int:
    """Return the steps of a round: `FIRST_THIN` times a power of two, so that epochs and draws fall on its end."""
    readings = (target.laser, target.sonar)
    wanted = STEPS_PER_READING * sum(sensor.readings.n_beams for sensor in readings if sensor is not None)
    length, longest = ROUND_LENGTHS
    while length < min(wanted, longest):
        length *= 2
    return length


def first_round() -> int:
    """Return the step at which the first round begins."""
    return ROUND_LENGTHS[0]


def random_tiles(
    window: Window, n: int, returns: Floats, least: float, pixels: Grid, rng: np.random.Generator
) -> Floats:
    """Cut the window into rectangles until there are `n`, or none is large enough to be cut.

    The rectangle with the most returns is cut next, across, at a quantile of its returns drawn by chance: tiles
    then hold about as many readings each. A cut that runs between pixels lets every pixel belong to one tile.

    `returns` (m, 2).
    """
    parts = [(np.array(window, np.float64), returns[window.contains(returns)])]
    while len(parts) < n:
        sides = [float(np.max(box[2:] - box[:2])) for box, _ in parts]
        wide = [i for i, side in enumerate(sides) if side >= 2.0 * least]
        if not wide:
            break
        chosen = max(wide, key=lambda i: (len(parts[i][1]), sides[i]))
        box, inside = parts.pop(chosen)
        axis = _axis(box, least, rng)
        at = _cut(box, inside, axis, least, pixels, rng)
        low, high = box.copy(), box.copy()
        low[2 + axis] = high[axis] = at
        below = inside[:, axis] < at
        parts[chosen:chosen] = [(low, inside[below]), (high, inside[~below])]
    return np.array([box for box, _ in parts])


def _axis(box: Floats, least: float, rng: np.random.Generator) -> int:
    """Return the axis along which a box is cut: drawn in proportion to the sides that are long enough."""
    sides = box[2:] - box[:2]
    weight = np.where(sides >= 2.0 * least, sides, 0.0)
    return int(rng.random() * weight.sum() >= weight[0])


def _cut(box: Floats, returns: Floats, axis: int, least: float, pixels: Grid, rng: np.random.Generator) -> float:
    """Return where a box is cut along an axis."""
    share = rng.uniform(*QUANTILES)
    low, high = float(box[axis]), float(box[2 + axis])
    at = low + share * (high - low) if len(returns) == 0 else float(np.quantile(returns[:, axis], share))
    at = min(max(at, low + least), high - least)
    if pixels.nx == 0:
        return at
    start = (pixels.x0, pixels.y0)[axis]
    line = start + round((at - start) / pixels.cell) * pixels.cell
    return line if low < line < high else at
