"""Every mirror echo in random rooms against images and shapely; joints, corners and patches of walls."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from prf.kernels.echo_scene import NO_WALL
from prf.shell.errors import InputError
from prf.simulate.reflectors import join_walls, make_echo_scene
from prf.simulate.sonar import FAINT, SonarPhysics, trace_echoes
from tests.reference.slow_echoes import slow_mirror_echoes

Floats = NDArray[np.float64]

MIRRORS = SonarPhysics(rough_share=0.0, corners=False, edges=False, noise=False, cross_talk=False)
AHEAD = np.zeros((1, 3))
TABLES = 0.01
"""By how much levels may differ: directions, Fresnel integrals and the steps of the gain are looked up in tables."""


def random_room(seed: int) -> tuple[Floats, Floats]:
    """Return the walls of a room with turned boxes in it, and places in its free space."""
    rng = np.random.default_rng(seed)
    free = shapely.box(0.0, 0.0, 6.0, 4.0)
    for _ in range(4):
        box = shapely.affinity.rotate(shapely.box(0, 0, *rng.uniform(0.1, 1.5, 2)), rng.uniform(0, 360))
        free = free.difference(shapely.affinity.translate(box, *rng.uniform([0, 0], [6, 4])))
    free = max(getattr(free, "geoms", [free]), key=lambda part: part.area)
    rings = [shapely.geometry.polygon.orient(free).exterior, *shapely.geometry.polygon.orient(free).interiors]
    walls = np.concatenate([np.hstack([(xy := np.array(ring.coords))[:-1], xy[1:]]) for ring in rings])
    places = rng.uniform([0, 0], [6, 4], (60, 2))
    return walls, places[shapely.contains_xy(free.buffer(-0.05), places)][:6]


@pytest.mark.parametrize("seed", range(4))
def test_every_mirror_echo_is_found_with_its_level(seed: int) -> None:
    walls, places = random_room(seed)
    walls = join_walls(walls)
    n_echoes = 0
    for k, place in enumerate(np.repeat(places[:4], 4, axis=0)):
        heading = 2.4 * k
        traced = trace_echoes(walls, np.array([*place, heading]), MIRRORS, np.random.default_rng(1), AHEAD)[0]
        slow = slow_mirror_echoes(walls, place, heading, MIRRORS)
        slow = slow[slow[:, 0] < MIRRORS.max_range]
        for one, two in ((traced, slow), (slow, traced)):
            for distance, level in one[swing(one) > 2.0 * FAINT]:
                off = np.abs(swing(two) - swing(np.array([[distance, level]])))
                near = np.abs(two[:, 0] - distance) < 1e-3
                assert off[near].min(initial=np.inf) < TABLES * max(swing(np.array([[distance, level]]))[0], 1.0)
        n_echoes += np.sum(swing(slow) > 2.0 * FAINT)
    assert n_echoes > 12


def swing(echoes: Floats) -> Floats:
    """Amplitude over the threshold when the echo comes."""
    return 10.0 ** ((echoes[:, 1] + MIRRORS.gain_db(echoes[:, 0])) / 20.0)


def test_straight_joints_vanish_and_corners_stay() -> None:
    square = np.array([[0, 0, 2, 0], [2, 0, 2, 2], [2, 2, 0, 2], [0, 2, 0, 0]], dtype=np.float64)
    cut = np.concatenate([[[0.7, 0, 2, 0], [0, 0, 0.7, 0]], square[[2, 1, 3]]])
    np.testing.assert_array_equal(join_walls(cut), join_walls(square))
    assert len(join_walls(square)) == 4
    touching = np.concatenate([square, [[1.0, 0.0, 1.0, -1.0]], [[1.0, 0.0, 0.0, 0.0]]])
    assert len(join_walls(touching)) == 6


def test_ends_that_differ_by_rounding_are_one_vertex() -> None:
    walls = np.array([[0, 0, 1, 0], [1 + 1e-9, 1e-9, 3, 0]])
    np.testing.assert_allclose(join_walls(walls), [[0, 0, 3, 0]], atol=1e-12)


def test_walls_of_no_length_are_nothing() -> None:
    assert join_walls(np.array([[1.0, 1, 1, 1]])).shape == (0, 4)
    with pytest.raises(InputError, match="walls"):
        join_walls(np.array([[0.0, 0, 1, np.inf]]))


def test_corners_of_rooms_and_edges_are_told_apart() -> None:
    """An L-shaped room: five corners of the room, one edge that sticks out into it."""
    xy = np.array([(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)], dtype=np.float64)
    walls = np.hstack([xy, np.roll(xy, -1, axis=0)])
    scene = make_echo_scene(walls, np.ones((1, 2)), MIRRORS, np.random.default_rng(1))
    assert np.sum(scene.turn > 0.0) == 5
    assert scene.corner[scene.turn < 0.0].tolist() == [[2.0, 2.0]]
    np.testing.assert_allclose(np.abs(scene.turn), 0.5 * math.pi)
    assert np.sum(scene.partner == NO_WALL) == 2


def test_patches_cover_the_rough_walls_evenly() -> None:
    physics = dataclasses.replace(MIRRORS, rough_share=0.5)
    walls = np.array([[0.0, k, 3.0, k] for k in range(200)])
    scene = make_echo_scene(walls, np.zeros((1, 2)), physics, np.random.default_rng(1))
    rough = np.unique(scene.patch_wall)
    # 100 of 200, standard deviation 7.
    assert 72 <= len(rough) <= 128
    assert len(scene.patch_wall) == 60 * len(rough)
    np.testing.assert_allclose((scene.patch_gain**2).sum(), physics.patch_gain**2 * 3.0 * len(rough))
    np.testing.assert_allclose(scene.mirror[rough], physics.rough_mirror)
    assert (np.delete(scene.mirror, rough) == physics.mirror).all()
