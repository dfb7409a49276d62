"""Maps of walls as the sampler makes them: starts, refusals, the laws that are sampled, draws as regions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.configuration import Configuration
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.walls.law import ALIKE
from prf.model.coloring import Coloring, check
from prf.model.layout import read_coloring
from prf.model.orientation import Orientation
from prf.model.walls import WallPrior, corners_of, map_of_walls, thickness_density, walls_of
from prf.model.window import Window
from prf.sampler.chain import Draw
from prf.sampler.directions import redraw_wall_laws
from prf.sampler.lines import Face, allowed, found_faces, lines_map, with_bodies
from prf.sampler.prepare import read_prepared
from prf.sampler.target import Target, make_chain, white_places
from prf.shell.cli.settings import SettingError
from prf.shell.errors import ConfigError

WINDOW = Window(0.0, 0.0, 10.0, 8.0)
WALLS = np.array(
    [[1.0, 1.0, 5.0, 1.0, 0.1], [1.0, 1.0, 1.0, 6.0, 0.1], [5.0, 1.0, 5.0, 6.0, 0.2], [2.0, 4.0, 3.0, 4.0, 0.5]]
)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tiles": 4}, "neither tiles nor temperatures"),
        ({"temperatures": 3}, "neither tiles nor temperatures"),
        ({"start": "prior"}, "walls start empty or from a grid"),
    ],
)
def test_what_walls_do_not_have_is_refused(data_dir: Path, changes: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_prepared([str(data_dir / "demo-rooms.log.gz")], Configuration.of(prior="walls", **changes))


def test_a_cost_of_black_ground_is_refused() -> None:
    with pytest.raises((ConfigError, SettingError, ValueError), match="free_space"):
        Configuration.of(prior="walls", free_space=1.0)


def test_a_chain_starts_from_walls_that_cover_no_sensor_and_are_where_returns_lie(data_dir: Path) -> None:
    target = read_prepared([str(data_dir / "demo-rooms.log.gz")], Configuration.of(prior="walls")).target
    found = walls_of(lines_map(target, np.random.default_rng(2)))
    assert len(found) > 10
    shapes = shapely.polygons(corners_of(found))
    assert not shapely.intersects(shapely.union_all(shapes), shapely.points(white_places(target))).any()
    assert np.hypot(*(found[:, 2:4] - found[:, :2]).T).sum() > 40.0
    assert target.laser is not None
    ends = target.laser.readings.within(target.laser.model.limit).impacts()
    near = shapely.distance(shapely.union_all(shapely.boundary(shapes)), shapely.points(ends)) < 0.1
    assert near.mean() > 0.8


def test_faces_of_a_wall_seen_from_both_sides_are_one_wall() -> None:
    rng = np.random.default_rng(1)
    along = rng.uniform(2.0, 6.0, 300)
    above = np.arange(300) % 2 == 0
    ends = np.column_stack([along, np.where(above, 3.1, 2.9) + 0.005 * rng.standard_normal(300)])
    origin = np.column_stack([along, np.where(above, 5.0, 1.0)])
    (wall,) = with_bodies(found_faces(ends, origin, 0.03, rng), 0.5)
    assert wall[4] == pytest.approx(0.2, abs=0.01)
    np.testing.assert_allclose(sorted(wall[[0, 2]]), [2.0, 6.0], atol=0.1)
    np.testing.assert_allclose(wall[[1, 3]], 3.0, atol=0.01)


def test_a_face_without_another_has_its_wall_behind_it() -> None:
    face = Face(np.array([6.0, 3.0]), np.array([2.0, 3.0]))  # free below: on its right is y > 3
    (wall,) = with_bodies([face], 0.2)
    assert wall[1] == pytest.approx(2.9)
    target = Target(WINDOW, 0.1, walls=WallPrior(), way=np.array([[3.0, 2.9, 4.0, 2.9]]), driven_radius=0.1)
    assert len(allowed(np.array([wall]), target)) == 0
    assert len(allowed(np.zeros((0, 5)), target)) == 0


def test_laws_of_direction_and_thickness_follow_the_walls() -> None:
    """Common values come to lie at the thicknesses of many walls, the angle along them; sums stay those of the map."""
    rng, prior = np.random.default_rng(3), WallPrior()
    n = 60
    a = rng.uniform((1.0, 1.0), (6.0, 6.0), (n, 2))
    turn = 0.3 + 0.5 * np.pi * rng.integers(0, 2, n)
    walls = np.column_stack(
        [a, a + np.column_stack([np.cos(turn), np.sin(turn)]), np.where(np.arange(n) % 2, 0.1, 0.25)]
    )
    target = Target(WINDOW, 0.1, orientation=Orientation(None, None), walls=prior)
    chain = make_chain(target, map_of_walls(walls, WINDOW))
    angles, nearest = [], []
    for _ in range(400):
        redraw_wall_laws(chain, prior, target.orientation, rng)
        angles.append(chain.lines[c.ANGLE])
        nearest.append(np.abs(chain.lines[c.N_LINES :, None] - [0.1, 0.25]).min(axis=0))
    assert np.abs(np.array(angles[200:]) - 0.3).max() < 0.1
    assert np.median(nearest[200:], axis=0).max() < ALIKE
    kept = chain.graph.sums[c.LOG_PRIOR]
    fresh = make_chain(target, read_coloring(chain.graph))
    fresh.lines[:] = chain.lines
    recompute_sums(fresh)
    assert kept == pytest.approx(fresh.graph.sums[c.LOG_PRIOR])
    grid = np.linspace(0.02, 1.0, 200_001)
    assert np.trapezoid(thickness_density(grid, np.array([0.1, 0.2, 0.3])), grid) == pytest.approx(1.0, abs=1e-4)


def test_regions_of_walls_are_valid_maps() -> None:
    draw = Draw(0, map_of_walls(WALLS, WINDOW), np.zeros(1), np.zeros(0, np.bool_))
    check(draw.region)
    assert Draw(0, Coloring.empty(WINDOW), np.zeros(1), np.zeros(0, np.bool_)).region.n_edges == 0
