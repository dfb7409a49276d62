"""Fields of small motions that displace map and poses together.

A field u is either the same rigid motion times a share that falls from 1 in its middle to 0 at its radius; or a random
mixture of fields that were made before (:mod:`prf.sampler.bends`), splines along which map and poses can bend all
together. A point p moves to p' = p + u((p + p') / 2): the way back is then the same with the field's opposite, which is
as probable, and the Jacobian of a point is det(I + Du/2) / det(I - Du/2), taken half way. A heading turns as a rigid
body would there. What the field is does not depend on map or poses. One that is so steep that a point might have two
such places is not used, nor is its opposite.
"""

import math

from prf.kernels._jit import Array, Rng, core
from prf.kernels.poses.moves import random_scale, spread_of
from prf.kernels.poses.state import Poses

# Entries of ``Poses.work``: the field, and what it does at one place.
CENTRE = 30
RADIUS = 32  # inf: all is moved alike; 0: as the mixture of fields says
MOTION = 33  # x, y, turn
PLACE = 36  # of a point after it, 2
TURNED = 38
LOG_SCALED = 39  # log of the Jacobian
MOVED = 40  # the field at a place, 2
SLOPES = 42  # its derivatives there: of x by x and y, of y by x and y

ITERATIONS = 60
EXACT = 1e-15
"""Metres over the size of coordinates below which a step towards the fixed point is rounding."""
STEEPEST = 1.718
"""Slope of the share of a field of radius 1 at most: 6 r (1 - r²)², greatest at r = 1 / sqrt(5)."""
SHARE_OF_ALL = 0.3
"""Share of fields that move all alike, or all but a pose that is held."""
NARROWEST = 1.0
"""Least radius, metres."""
SHARE_OF_MIXTURES = 0.5
"""Share of fields that are mixtures, where there are fields to mix."""
LEAST_MIXED = 0.1
MOST_MIXED = 1.5
"""A mixture is scaled by a factor between these, even in its logarithm; at 1 it is about a draw of the posterior."""
LEAST_SCALE = 0.03
MOST_SCALE = 2.0
"""Fields are scaled by a factor between these, even in its logarithm, of what the errors of given poses allow."""


@core
def draw_field(window: Array, poses: Poses, rng: Rng) -> bool:
    """Draw a field: its middle where a pose started, its radius even in the logarithm. A held pose lies beyond it.

    Or a mixture; or, where the first pose is held, all but that moves alike, by what the first may vary by to the rest.
    Return whether half of it shrinks distances to a half at most: it then has one fixed point, found from anywhere.
    """
    work, start = poses.work, poses.start
    if poses.fields.shape[0] > 0 and rng.random() < SHARE_OF_MIXTURES:
        return draw_mixture(poses, rng)
    if poses.precision[0, 0] == 0.0 and rng.random() < SHARE_OF_ALL:
        work[CENTRE], work[CENTRE + 1] = poses.pose[0, 0], poses.pose[0, 1]
        work[RADIUS] = math.inf
        spread_of(poses, 0, random_scale(rng), rng, work[MOTION : MOTION + 3])
        return abs(work[MOTION + 2]) < 1.0
    i = int(rng.random() * start.shape[0])
    work[CENTRE], work[CENTRE + 1] = start[i, 0], start[i, 1]
    widest = 2.0 * max(window[2] - window[0], window[3] - window[1])
    is_held = poses.precision[0, 0] == 0.0
    if is_held:
        widest = math.sqrt((start[i, 0] - poses.pose[0, 0]) ** 2 + (start[i, 1] - poses.pose[0, 1]) ** 2)
        if widest == 0.0:
            return False
    work[RADIUS] = math.inf
    if is_held or rng.random() >= SHARE_OF_ALL:
        work[RADIUS] = min(widest, NARROWEST * math.pow(max(widest / NARROWEST, 1.0), rng.random()))
    scale = LEAST_SCALE * math.pow(MOST_SCALE / LEAST_SCALE, rng.random())
    place, turn = prior_spread(poses, work)
    work[MOTION] = scale * place * rng.standard_normal()
    work[MOTION + 1] = scale * place * rng.standard_normal()
    work[MOTION + 2] = scale * turn * rng.standard_normal()
    slope = STEEPEST * math.sqrt(work[MOTION] ** 2 + work[MOTION + 1] ** 2) / work[RADIUS]
    return slope + (1.0 + STEEPEST) * abs(work[MOTION + 2]) < 1.0


@core
def add_scaled(total: Array, field: Array, scale: float) -> None:
    """Add a field times a number."""
    for i in range(total.shape[0]):
        for j in range(total.shape[1]):
            for k in range(2):
                total[i, j, k] += scale * field[i, j, k]


@core
def draw_mixture(poses: Poses, rng: Rng) -> bool:
    """Mix the fields by random numbers; return whether the slope of the mixture is less than 1 everywhere."""
    mixed, n = poses.mixture, poses.fields.shape[0]
    poses.work[RADIUS] = 0.0
    scale = LEAST_MIXED * math.pow(MOST_MIXED / LEAST_MIXED, rng.random()) / math.sqrt(n)
    mixed[:] = 0.0
    for field in range(n):
        add_scaled(mixed, poses.fields[field], scale * rng.standard_normal())
    # A derivative of a spline is a mean of the differences of its coefficients.
    along_x, along_y = 0.0, 0.0
    for i in range(mixed.shape[0]):
        for j in range(mixed.shape[1]):
            for k in range(2):
                if j > 0:
                    along_x = max(along_x, abs(mixed[i, j, k] - mixed[i, j - 1, k]))
                if i > 0:
                    along_y = max(along_y, abs(mixed[i, j, k] - mixed[i - 1, j, k]))
    return math.sqrt(2.0 * (along_x * along_x + along_y * along_y)) < poses.field_grid[2]


@core
def bump(t: float, k: int) -> tuple[float, float]:
    """Value and slope of the k-th of the four cubic splines over a cell, at a share t of it."""
    s = 1.0 - t
    if k == 0:
        return s * s * s / 6.0, -0.5 * s * s
    if k == 1:
        return (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0, 0.5 * t * (3.0 * t - 4.0)
    if k == 2:
        return (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0, -0.5 * s * (3.0 * s - 4.0)
    return t * t * t / 6.0, 0.5 * t * t


@core
def mixture_at(poses: Poses, x: float, y: float) -> None:
    """Write the mixture at a place, and its slopes."""
    work, mixed, side = poses.work, poses.mixture, poses.field_grid[2]
    column, row = (x - poses.field_grid[0]) / side, (y - poses.field_grid[1]) / side
    left, low = math.floor(column), math.floor(row)
    for k in range(6):
        work[MOVED + k] = 0.0
    for i in range(4):
        by_y, slope_y = bump(row - low, i)
        at_y = min(max(int(low) + i - 1, 0), mixed.shape[0] - 1)
        for j in range(4):
            by_x, slope_x = bump(column - left, j)
            at_x = min(max(int(left) + j - 1, 0), mixed.shape[1] - 1)
            for k in range(2):
                value = mixed[at_y, at_x, k]
                work[MOVED + k] += by_x * by_y * value
                work[SLOPES + 2 * k] += slope_x * by_y * value / side
                work[SLOPES + 2 * k + 1] += by_x * slope_y * value / side


@core
def field_at(poses: Poses, x: float, y: float) -> None:
    """Write the field at a place, and its slopes."""
    work = poses.work
    radius, turn = work[RADIUS], work[MOTION + 2]
    if radius == 0.0:
        mixture_at(poses, x, y)
        return
    dx, dy = x - work[CENTRE], y - work[CENTRE + 1]
    inside = share_at(work, dx, dy)
    share = inside * inside * inside
    slope = 0.0 if radius == math.inf else -6.0 * inside * inside / (radius * radius)
    ux, uy = work[MOTION] - turn * dy, work[MOTION + 1] + turn * dx
    work[MOVED], work[MOVED + 1] = share * ux, share * uy
    work[SLOPES], work[SLOPES + 1] = ux * slope * dx, ux * slope * dy - share * turn
    work[SLOPES + 2], work[SLOPES + 3] = uy * slope * dx + share * turn, uy * slope * dy


@core
def share_at(work: Array, dx: float, dy: float) -> float:
    """The base, whose cube is the share of the motion that a place at (dx, dy) from the middle has."""
    radius = work[RADIUS]
    return 1.0 if radius == math.inf else max(0.0, 1.0 - (dx * dx + dy * dy) / (radius * radius))


@core
def prior_spread(poses: Poses, work: Array) -> tuple[float, float]:
    """By how much the prior lets the field shift and turn, about, one standard deviation: metres, radians."""
    shift, turn, inside = 0.0, 0.0, 0.0
    for i in range(poses.start.shape[0]):
        dx, dy = poses.start[i, 0] - work[CENTRE], poses.start[i, 1] - work[CENTRE + 1]
        share = share_at(work, dx, dy) ** 6
        shift += share * poses.precision[i, 0]
        turn += share * (poses.precision[i, 1] + poses.precision[i, 0] * (dx * dx + dy * dy))
        inside += share
    if poses.precision[0, 0] > 0.0:
        return 1.0 / math.sqrt(shift), 1.0 / math.sqrt(turn)
    # Errors of odometry add up over the poses inside.
    return math.sqrt(inside / poses.weight[0, 0]), math.sqrt(inside / poses.weight[0, 2])


@core
def displace(poses: Poses, x: float, y: float) -> bool:
    """Write where a point is moved, its turn and the log of its Jacobian; False where no fixed point was found."""
    work = poses.work
    tolerance = EXACT * (abs(x) + abs(y) + 1.0)
    px, py = x, y
    for _ in range(ITERATIONS):
        field_at(poses, 0.5 * (x + px), 0.5 * (y + py))
        qx, qy = x + work[MOVED], y + work[MOVED + 1]
        done = abs(qx - px) + abs(qy - py) <= tolerance
        px, py = qx, qy
        if done:
            work[PLACE], work[PLACE + 1] = px, py
            jacobian(work)
            return True
    return False


@core
def jacobian(work: Array) -> None:
    """Write turn and log Jacobian of a point by the slopes of the field half way."""
    a, b = 0.5 * work[SLOPES], 0.5 * work[SLOPES + 1]
    d, e = 0.5 * work[SLOPES + 2], 0.5 * work[SLOPES + 3]
    forward = (1.0 + a) * (1.0 + e) - b * d
    backward = (1.0 - a) * (1.0 - e) - b * d
    # (I - A)^-1 (I + A): its antisymmetric part and its trace give the turn of the nearest rotation.
    m11 = (1.0 - e) * (1.0 + a) + b * d
    m12 = (1.0 - e) * b + b * (1.0 + e)
    m21 = d * (1.0 + a) + (1.0 - a) * d
    m22 = d * b + (1.0 - a) * (1.0 + e)
    work[TURNED] = math.atan2(m21 - m12, m11 + m22)
    work[LOG_SCALED] = math.log(forward / backward)
