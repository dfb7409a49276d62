"""A round: the map at its start, its tiles, and the readings laid out for them once, the same whatever the map."""

from __future__ import annotations

import dataclasses
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
from prf.model.laser import beam_influence
from prf.model.layout import make_targets, read_coloring
from prf.model.sensors import LaserModel, SonarModel
from prf.model.window import INTERIOR
from prf.readings.ground import way_guards
from prf.sampler.posterior import (
    BORDER_MOVES,
    NO_LASER,
    NO_SONAR,
    Settings,
    poses_of,
    rays_of,
    return_points,
    white_places,
)
from prf.sampler.tiles.partition import random_tiles

Floats = NDArray[np.float64]

REL_TOL = 1e-6
"""Regions within which an obstacle matters are enlarged by this share: rounding must not let one slip through."""


@dataclasses.dataclass(frozen=True)
class TileData:
    """Readings laid out for tiles."""

    settings: Settings
    laser: LaserModel  # models; of no consequence without readings
    sonar: SonarModel  # models; of no consequence without readings
    ray: Floats  # (n, N_RAY): beams as :func:`prf.model.laser.make_rays` lays them out
    influence: Floats  # (n,): distance beyond which no obstacle changes the likelihood of the beam, metres
    end: Floats  # (n, 2): point whose tile answers for the beam: where the return lies, or half way without one
    pose: Floats  # (m, N_POSE): sonar readings
    triangle: Floats  # (m, 6): corners of a triangle that holds the cone of each
    returns: Floats  # (k, 2): impacts of readings
    targets: Targets  # the squares that hold these
    # (s, 2): places that must be white, metres: those of sensors, and the ends of pieces of the way driven
    sensors: Floats
    ways: Floats  # (w, N_SHAPE): guards of the way that was driven


def make_tile_data(settings: Settings) -> TileData:
    """Lay out the readings of a run for its tiles."""
    ray, pose = rays_of(settings), poses_of(settings)
    laser = (settings.laser or NO_LASER).model
    reach = ray[:, c.MAX_DISTANCE]
    influence = np.minimum(reach, beam_influence(laser, ray[:, c.RANGE]))
    returned = (ray[:, c.RANGE] >= 0.0) & np.isfinite(ray[:, c.RANGE])
    answered = np.where(returned, np.minimum(ray[:, c.RANGE], (1.0 - REL_TOL) * reach), 0.5 * reach)
    returns = return_points(settings)
    return TileData(
        settings=settings,
        laser=laser,
        sonar=(settings.sonar or NO_SONAR).model,
        ray=ray,
        influence=influence,
        end=ray[:, :2] + answered[:, None] * ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1],
        pose=pose,
        triangle=cone_triangles(pose),
        returns=returns,
        targets=make_targets(settings.window, settings.target_side(), returns),
        sensors=white_places(settings),
        ways=way_guards(settings.way, settings.driven_radius),
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


COARSE = 3.0
"""Cells in which a round finds edges on beams, in units of the cells of a chain."""

NO_PROBES = np.zeros(0, np.int64)


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
    tiles = random_tiles(data.settings.window, n_tiles, data.returns, least, chain.image.grid, rng)
    vertex_tile = tiles_at(tiles, coloring.xy)
    vertex_tile[coloring.side != INTERIOR] = c.NONE
    first, last = vertex_tile[coloring.edges].T
    move_probabilities = chain.move_probabilities.copy()
    move_probabilities[list(BORDER_MOVES)] = 0.0  # left to the steps between rounds
    return Round(
        coloring,
        chain.image.grid,
        chain.image.black.copy(),
        tiles,
        np.where(first == last, first, c.NONE).astype(np.int32),
        list_segments(make_grid(*data.settings.window, COARSE * data.settings.cell_size()), coloring.segments()),
        seeds=rng.integers(0, 2**63, len(tiles)),
        looks=np.arange(1, n_looks + 1) * (steps // len(tiles)) // n_looks,
        probes=probes,
        density=chain.density.copy(),
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
