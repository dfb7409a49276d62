"""The ways by which sound comes back: walls, corners of the room, edges, rough patches, two walls in turn.

Each function lists at most two echoes from the transducer `p` to the transducer `q`. Both stand in the mirror world
of one wall (`mirror`) when that wall reflects the sound on its way out and again on its way back; `real_p`, `real_q`
are where they are.
"""

import math
from typing import NamedTuple

from prf.kernels._jit import core
from prf.kernels.echo_levels import Acoustics, Echoes, collect, is_audible, off_axis, toward, zones
from prf.kernels.echo_scene import (
    NO_WALL,
    Ear,
    EchoScene,
    crossing_place,
    height_over,
    image_of,
    is_clear,
    is_seen,
    place_along,
)

FARTHEST = 30.0
"""Fresnel argument at which what fades over the end of a wall is given up: 42 dB under the mirror."""
ENDLESS = 1e6
"""Fresnel argument of an end that is no end."""
NUDGE = 1e-4
"""Metres. What reflects at the end of a wall is looked for this far inside, off the wall that adjoins."""


class Link(NamedTuple):
    """Who speaks to whom: both transducers as they are and as `mirror` shows them, `gain` of the mirror, twice.

    `receiver` indexes the lists of echoes, `delay` is what `p` fires later than `q`, as metres of path; `same`: p is q.
    """

    real_p: Ear
    real_q: Ear
    p: Ear
    q: Ear
    mirror: int
    gain: float
    receiver: int
    delay: float
    same: bool


@core
def both_see(scene: EchoScene, link: Link, x: float, y: float, skip: int, skip_too: int) -> bool:
    """Whether both transducers see a point."""
    if not is_seen(scene, link.real_p, link.p, link.mirror, x, y, skip, skip_too):
        return False
    return link.same or is_seen(scene, link.real_q, link.q, link.mirror, x, y, skip, skip_too)


@core
def zones_to_end(
    scene: EchoScene, sound: Acoustics, link: Link, w: int, end: int, beyond: bool, length: float
) -> float:
    """Fresnel argument of an end of wall `w`: sqrt(4 / wavelength) of what the path by it is longer than by the foot.

    Negative if the foot lies beyond that end; an end in a right-angled corner is no end.
    """
    if scene.partner[w, end] != NO_WALL:
        return ENDLESS
    x, y = scene.wall[w, 2 * end], scene.wall[w, 2 * end + 1]
    path = math.hypot(x - link.p.x, y - link.p.y) + math.hypot(x - link.q.x, y - link.q.y)
    v = 2.0 * math.sqrt(max(path - length, 0.0) / sound.wavelength)
    return -v if beyond else v


@core
def wall_echo(scene: EchoScene, sound: Acoustics, echoes: Echoes, link: Link, w: int) -> None:
    """Mirror reflection: mirror / L, times the share of the Fresnel zones round the foot that lie on the wall."""
    p, q = link.p, link.q
    hp = height_over(scene, w, p.x, p.y)
    hq = height_over(scene, w, q.x, q.y)
    if hp <= 0.0 or hq <= 0.0:
        return
    sp = place_along(scene, w, p.x, p.y)
    across = place_along(scene, w, q.x, q.y) - sp
    foot = sp + across * hp / (hp + hq)
    length = math.sqrt(across * across + (hp + hq) * (hp + hq))
    if length >= 2.0 * sound.max_range or not foot_counts(scene, w, foot):
        return
    first = -zones_to_end(scene, sound, link, w, 0, foot < 0.0, length)
    last = zones_to_end(scene, sound, link, w, 1, foot > scene.length[w], length)
    if first >= FARTHEST or last <= -FARTHEST:
        return
    re, im = zones(sound, first, last)
    rim = min(NUDGE, 0.1 * scene.length[w])
    s = min(max(foot, rim), scene.length[w] - rim)
    x = scene.wall[w, 0] + s * scene.along[w, 0]
    y = scene.wall[w, 1] + s * scene.along[w, 1]
    arrival = math.hypot(x - p.x, y - p.y) + math.hypot(x - q.x, y - q.y)
    size = scene.mirror[w] * link.gain * toward(sound, p, x, y) * toward(sound, q, x, y) / arrival
    if is_audible(sound, size * math.sqrt(re * re + im * im), arrival) and both_see(scene, link, x, y, w, NO_WALL):
        collect(sound, echoes, link.receiver, link.delay, arrival, length, size * re, size * im)


@core
def foot_counts(scene: EchoScene, w: int, foot: float) -> bool:
    """Whether a foot may lie there: beyond an end in a right-angled corner the corner's echo takes over."""
    if foot < 0.0:
        return scene.partner[w, 0] == NO_WALL
    return foot <= scene.length[w] or scene.partner[w, 1] == NO_WALL


@core
def corner_echo(scene: EchoScene, sound: Acoustics, echoes: Echoes, link: Link, k: int) -> None:
    """Two reflections in a corner of the room: mirror^2 / L back to where they came from, from any direction.

    By either order of the walls the sound comes from p turned about the corner by twice its angle; the ray between
    the two passes the corner at a distance h, and only what passes on one side of it, up to the walls' far ends,
    meets both walls.
    """
    p, q = link.p, link.q
    before, after = scene.before[k], scene.after[k]
    vx, vy = scene.corner[k, 0], scene.corner[k, 1]
    over = 0.5 * math.pi - scene.turn[k]
    px, py = p.x - vx, p.y - vy
    qx, qy = q.x - vx, q.y - vy
    dp, dq = math.sqrt(px * px + py * py), math.sqrt(qx * qx + qy * qy)
    if dp >= 2.0 * sound.max_range or dq >= 2.0 * sound.max_range:
        return
    over_before, over_after = height_over(scene, before, p.x, p.y), height_over(scene, after, p.x, p.y)
    if over_before <= 0.0 or over_after <= 0.0:
        return
    if height_over(scene, before, q.x, q.y) <= 0.0 or height_over(scene, after, q.x, q.y) <= 0.0:
        return
    mirror = scene.mirror[before] * scene.mirror[after] * link.gain
    if not is_audible(sound, 2.0 * mirror * toward(sound, p, vx, vy) / (dp + dq), dp + dq):
        return
    widest = min(over_before * scene.length[before], over_after * scene.length[after]) / dp
    # Angle at the corner from q to p, counter-clockwise: the wall `after` lies clockwise of both, `before` beyond.
    between = math.atan2(qx * py - qy * px, qx * px + qy * py)
    visible = False
    for order in range(2):
        side = 1.0 if order == 0 else -1.0
        bend = side * between - 2.0 * over
        length = math.sqrt(dp * dp + dq * dq + 2.0 * dp * dq * math.cos(bend))
        h = dp * dq * math.sin(bend) / length
        scale = math.sqrt(2.0 * (dp + dq) / (sound.wavelength * dp * dq))
        re, im = zones(sound, -h * scale, (widest - h) * scale)
        # The first wall is `before` in the first order; seen from p it lies clockwise of the corner.
        aside = max(h, 0.0)
        out = turned(sound, p, -px, -py, dp, -side * aside)
        back = turned(sound, q, -qx, -qy, dq, side * aside)
        size = mirror * out * back / length
        if is_audible(sound, size * math.sqrt(re * re + im * im), length):
            visible = visible or both_see(scene, link, vx, vy, before, after)
            if not visible:
                return
            arrival = length if h > 0.0 else dp + dq
            collect(sound, echoes, link.receiver, link.delay, arrival, length, size * re, size * im)


@core
def turned(sound: Acoustics, ear: Ear, dx: float, dy: float, distance: float, aside: float) -> float:
    """Amplitude of the transducer toward (dx, dy) away, `aside` metres to the left of it."""
    x = dx - aside * dy / distance
    y = dy + aside * dx / distance
    return off_axis(sound, (x * ear.ux + y * ear.uy) / math.sqrt(x * x + y * y))


@core
def edge_echo(scene: EchoScene, sound: Acoustics, echoes: Echoes, link: Link, k: int) -> None:
    """Reflection by the rounding of an edge, a cylinder of radius a: about sqrt(a/d) / 2d, within its normals."""
    p, q = link.p, link.q
    before, after = scene.before[k], scene.after[k]
    vx, vy = scene.corner[k, 0], scene.corner[k, 1]
    dp, dq = math.hypot(p.x - vx, p.y - vy), math.hypot(q.x - vx, q.y - vy)
    if dp + dq >= 2.0 * sound.max_range:
        return
    nx = (p.x - vx) / dp + (q.x - vx) / dq
    ny = (p.y - vy) / dp + (q.y - vy) / dq
    # The normal there must lie between those of the two walls: ahead of the one that comes, behind the one that goes.
    if nx * scene.along[before, 0] + ny * scene.along[before, 1] < 0.0:
        return
    if nx * scene.along[after, 0] + ny * scene.along[after, 1] > 0.0:
        return
    if height_over(scene, before, p.x, p.y) <= 0.0 and height_over(scene, after, p.x, p.y) <= 0.0:
        return
    focus = sound.edge_radius * dp / (2.0 * dp + sound.edge_radius)
    size = math.sqrt(focus / ((focus + dq) * dp * (dp + dq))) * min(-scene.turn[k] / (0.5 * math.pi), 1.0)
    size *= math.sqrt(scene.mirror[before] * scene.mirror[after]) * link.gain
    size *= toward(sound, p, vx, vy) * toward(sound, q, vx, vy)
    if is_audible(sound, size, dp + dq) and both_see(scene, link, vx, vy, before, after):
        collect(sound, echoes, link.receiver, link.delay, dp + dq, dp + dq, size, 0.0)


@core
def patch_echo(scene: EchoScene, sound: Acoustics, echoes: Echoes, link: Link, k: int) -> None:
    """Diffuse scattering by a patch of a rough wall: amplitude gain sqrt(d cos cos) / d^2, of a phase of its own."""
    p, q = link.p, link.q
    w = scene.patch_wall[k]
    x, y = scene.patch[k, 0], scene.patch[k, 1]
    hp, hq = height_over(scene, w, p.x, p.y), height_over(scene, w, q.x, q.y)
    if hp <= 0.0 or hq <= 0.0:
        return
    dp, dq = math.hypot(p.x - x, p.y - y), math.hypot(q.x - x, q.y - y)
    if dp + dq >= 2.0 * sound.max_range:
        return
    size = scene.patch_gain[k] * math.sqrt(0.5 * (dp + dq) * hp * hq / (dp * dq)) / (dp * dq)
    size *= link.gain * toward(sound, p, x, y) * toward(sound, q, x, y)
    if is_audible(sound, size, dp + dq) and both_see(scene, link, x, y, w, NO_WALL):
        re, im = size * math.cos(scene.patch_phase[k]), size * math.sin(scene.patch_phase[k])
        collect(sound, echoes, link.receiver, link.delay, dp + dq, dp + dq, re, im)


@core
def two_wall_echo(scene: EchoScene, sound: Acoustics, echoes: Echoes, link: Link, one: int, two: int) -> None:
    """Two reflections in walls that do not make a corner: the image of the image, if both feet lie on their walls."""
    p, q = link.p, link.q
    first = image_of(scene, one, p)
    if height_over(scene, two, first.x, first.y) <= 0.0 or height_over(scene, two, q.x, q.y) <= 0.0:
        return
    second = image_of(scene, two, first)
    length = math.hypot(second.x - q.x, second.y - q.y)
    size = scene.mirror[one] * scene.mirror[two] / length
    if not is_audible(sound, size, length):
        return
    s = crossing_place(scene, two, second.x, second.y, q.x, q.y)
    if not s >= 0.0:
        return
    bx, by = scene.wall[two, 0] + s * scene.along[two, 0], scene.wall[two, 1] + s * scene.along[two, 1]
    s = crossing_place(scene, one, first.x, first.y, bx, by)
    if not s >= 0.0:
        return
    ax, ay = scene.wall[one, 0] + s * scene.along[one, 0], scene.wall[one, 1] + s * scene.along[one, 1]
    out, back = toward(sound, p, ax, ay), toward(sound, q, bx, by)
    size *= out * back
    if min(out, back) < sound.detour:
        return
    if not is_audible(sound, size, length) or not is_clear(scene, p.x, p.y, ax, ay, one, NO_WALL, NO_WALL):
        return
    if is_clear(scene, ax, ay, bx, by, one, two, NO_WALL) and is_clear(scene, bx, by, q.x, q.y, two, NO_WALL, NO_WALL):
        collect(sound, echoes, link.receiver, link.delay, length, length, size, 0.0)
