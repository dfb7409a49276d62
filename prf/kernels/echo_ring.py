"""A ring of transducers that fire in groups: every echo of every pair, then what each receiver makes of them."""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels._jit import core, jit
from prf.kernels.echo_levels import Acoustics, Echoes
from prf.kernels.echo_paths import Link, corner_echo, edge_echo, patch_echo, two_wall_echo, wall_echo
from prf.kernels.echo_receiver import Listening, listen
from prf.kernels.echo_scene import NO_WALL, Ear, EchoScene, height_over, image_of, place_along

LARGEST_RING = 1.0
"""Metres from the middle of the robot within which all of its transducers sit."""


class Effects(NamedTuple):
    """Which ways of the sound there are."""

    walls: bool
    corners: bool
    edges: bool
    patches: bool
    detours: bool


class Nearby(NamedTuple):
    """Scratch: what lies within earshot of the robot, and which walls stand in the beam of each transducer.

    `walls`, `corners`, `patches` indices, `n` (3,) how many of each; `mirrors` (r, walls) indices, `n_mirrors` (r,).
    """

    walls: np.ndarray
    corners: np.ndarray
    patches: np.ndarray
    mirrors: np.ndarray
    n: np.ndarray
    n_mirrors: np.ndarray


class Ring(NamedTuple):
    """Transducers on the robot (r, 3): place and axis; `group` (r,): those of a number fire together.

    `firing` (r,) scratch: what each fires later than the first, as metres of path; `spread` the longest of these, 0:
    at once.
    `cross_talk` whether the others of a group hear an echo; `beam` radians off the axis within which walls mirror
    sound.
    """

    place: np.ndarray
    group: np.ndarray
    firing: np.ndarray
    spread: float
    cross_talk: bool
    beam: float


@core
def wall_distance(scene: EchoScene, w: int, x: float, y: float) -> float:
    """Distance of a point from wall `w`."""
    s = min(max(place_along(scene, w, x, y), 0.0), scene.length[w])
    return math.hypot(
        scene.wall[w, 0] + s * scene.along[w, 0] - x,
        scene.wall[w, 1] + s * scene.along[w, 1] - y,
    )


@core
def gather(scene: EchoScene, near: Nearby, x: float, y: float, reach: float) -> None:
    """List the walls, corners and patches within `reach` of a point."""
    near.n[:] = 0
    for w in range(scene.length.size):
        if wall_distance(scene, w, x, y) <= reach:
            near.walls[near.n[0]] = w
            near.n[0] += 1
    for k in range(scene.turn.size):
        if math.hypot(scene.corner[k, 0] - x, scene.corner[k, 1] - y) <= reach:
            near.corners[near.n[1]] = k
            near.n[1] += 1
    for k in range(scene.patch_wall.size):
        if math.hypot(scene.patch[k, 0] - x, scene.patch[k, 1] - y) <= reach:
            near.patches[near.n[2]] = k
            near.n[2] += 1


@core
def in_beam(scene: EchoScene, ear: Ear, w: int, beam: float) -> bool:
    """Whether a part of wall `w`, seen from its free side, lies within `beam` of the axis."""
    if height_over(scene, w, ear.x, ear.y) <= 0.0:
        return False
    ax, ay = scene.wall[w, 0] - ear.x, scene.wall[w, 1] - ear.y
    bx, by = scene.wall[w, 2] - ear.x, scene.wall[w, 3] - ear.y
    first = math.atan2(ear.ux * ay - ear.uy * ax, ear.ux * ax + ear.uy * ay)
    # From its free side a wall runs counter-clockwise.
    last = first + math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return (first <= beam and last >= -beam) or last >= 2.0 * math.pi - beam


@core
def gather_mirrors(scene: EchoScene, near: Nearby, ear: Ear, beam: float, transducer: int) -> None:
    """List the nearby walls in the beam of a transducer."""
    n = 0
    for c in range(near.n[0]):
        if in_beam(scene, ear, near.walls[c], beam):
            near.mirrors[transducer, n] = near.walls[c]
            n += 1
    near.n_mirrors[transducer] = n


@core
def scattered(scene: EchoScene, sound: Acoustics, echoes: Echoes, near: Nearby, effects: Effects, link: Link) -> None:
    """List the echoes of everything nearby but the mirror of `link`, and in a mirror of all but rough patches."""
    if effects.walls:
        for c in range(near.n[0]):
            if near.walls[c] != link.mirror:
                wall_echo(scene, sound, echoes, link, near.walls[c])
    for c in range(near.n[1]):
        k = near.corners[c]
        if scene.turn[k] > 0.0:
            if effects.corners and scene.before[k] != link.mirror and scene.after[k] != link.mirror:
                corner_echo(scene, sound, echoes, link, k)
        elif effects.edges:
            edge_echo(scene, sound, echoes, link, k)
    if effects.patches and link.mirror == NO_WALL:
        for c in range(near.n[2]):
            patch_echo(scene, sound, echoes, link, near.patches[c])


@core
def behind(scene: EchoScene, link: Link, m: int) -> Link:
    """The pair where wall `m` shows it, which reflects the sound on its way out and on its way back."""
    if m == NO_WALL:
        return link
    p, q = image_of(scene, m, link.p), image_of(scene, m, link.q)
    return Link(link.p, link.q, p, q, m, scene.mirror[m] * scene.mirror[m], link.receiver, link.delay, link.same)


@core
def link_echoes(
    scene: EchoScene,
    sound: Acoustics,
    echoes: Echoes,
    near: Nearby,
    effects: Effects,
    ring: Ring,
    link: Link,
    emitter: int,
) -> None:
    """List the echoes of the world, of the worlds that walls in both beams show, and of two walls in turn."""
    n_mirrors = near.n_mirrors[emitter] if effects.detours else 0
    # The world as it is comes first, so that its echoes are traced by the same call: that halves the machine code.
    for c in range(-1, n_mirrors):
        m = near.mirrors[emitter, c] if c >= 0 else NO_WALL
        if m == NO_WALL or link.same or in_beam(scene, link.q, m, ring.beam):
            scattered(scene, sound, echoes, near, effects, behind(scene, link, m))
    for c in range(n_mirrors):
        m = near.mirrors[emitter, c]
        for d in range(near.n_mirrors[link.receiver]):
            w = near.mirrors[link.receiver, d]
            if w != m and scene.partner[m, 0] != w and scene.partner[m, 1] != w:
                two_wall_echo(scene, sound, echoes, link, m, w)


@core
def ear_at(ring: Ring, k: int, x: float, y: float, cosine: float, sine: float) -> Ear:
    """Transducer `k` of a robot at (x, y) with that cosine and sine of its heading."""
    rx, ry, turn = ring.place[k, 0], ring.place[k, 1], ring.place[k, 2]
    c, s = math.cos(turn), math.sin(turn)
    return Ear(x + cosine * rx - sine * ry, y + sine * rx + cosine * ry, cosine * c - sine * s, sine * c + cosine * s)


@core
def ring_echoes(
    scene: EchoScene, sound: Acoustics, effects: Effects, ring: Ring, near: Nearby, echoes: Echoes, pose: np.ndarray
) -> None:
    """List every echo that each transducer of a robot at `pose` (x, y, heading) receives in the cycle of its group."""
    x, y, cosine, sine = pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2])
    gather(scene, near, x, y, sound.max_range + LARGEST_RING)
    echoes.n_heard[:] = 0
    for t in range(ring.group.size):
        gather_mirrors(scene, near, ear_at(ring, t, x, y, cosine, sine), ring.beam, t)
    for t in range(ring.group.size):
        p = ear_at(ring, t, x, y, cosine, sine)
        for r in range(ring.group.size):
            if r == t or (ring.cross_talk and ring.group[r] == ring.group[t]):
                q = ear_at(ring, r, x, y, cosine, sine)
                link = Link(p, q, p, q, NO_WALL, 1.0, r, ring.firing[t] - ring.firing[r], r == t)
                link_echoes(scene, sound, echoes, near, effects, ring, link, t)


@core
def sense_poses(
    scene: EchoScene,
    sound: Acoustics,
    effects: Effects,
    ring: Ring,
    listening: Listening,
    near: Nearby,
    echoes: Echoes,
    poses: np.ndarray,
    rng: np.random.Generator,
    ranges: np.ndarray,
) -> None:
    """The loop of :func:`sense_ring`, without reference counts."""
    for m in range(poses.shape[0]):
        for r in range(ring.group.size):
            ring.firing[r] = ring.spread * rng.random()
        ring_echoes(scene, sound, effects, ring, near, echoes, poses[m])
        for r in range(ring.group.size):
            ranges[m, r] = listen(sound, listening, echoes, r, rng)


@jit
def sense_ring(
    scene: EchoScene,
    sound: Acoustics,
    effects: Effects,
    ring: Ring,
    listening: Listening,
    near: Nearby,
    echoes: Echoes,
    poses: np.ndarray,
    rng: np.random.Generator,
    ranges: np.ndarray,
) -> None:
    """Write the readings of a ring at each pose (m, 3) into `ranges` (m, r), inf: no return.

    `echoes` keeps those of the last pose.
    """
    sense_poses(scene, sound, effects, ring, listening, near, echoes, poses, rng, ranges)
