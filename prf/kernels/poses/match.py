"""A pose matched to the map: a few Gauss-Newton steps from a point that does not depend on the pose they replace.

What they lead to, and its curvature, is the normal distribution of a proposal that is independent of the present pose.
The map, the other poses and the readings decide it, so that both ways have the same.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core, core_entry
from prf.kernels.poses.change import BEYOND
from prf.kernels.poses.moves import decide, first_free
from prf.kernels.poses.state import Poses, first_edge, log_error, place_ray, turn_between
from prf.kernels.readings.beams import Beams
from prf.kernels.readings.laser import ROOT_TWO_PI
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph

WIDTHS = (8.0, 4.0, 2.0, 1.0, 1.0)
"""Standard deviations of the range in each step, over the sensor's: wide first, where associations are wrong."""
INFLATION = 1.2
"""Standard deviations of the proposal over those of the curvature."""

# Entries of ``Poses.work``: scratch of this module.
NORMAL = 8  # lower triangle of the normal equations, by rows
GRADIENT = 14
ROOT = 17  # its Cholesky factor, by rows
STEP = 23
MEAN = 26  # the first of three: where the steps lead


@core
def add_terms(work: Array, jx: float, jy: float, jt: float, error: float, weight: float) -> None:
    """Add a residual to the normal equations."""
    work[NORMAL] += weight * jx * jx
    work[NORMAL + 1] += weight * jy * jx
    work[NORMAL + 2] += weight * jy * jy
    work[NORMAL + 3] += weight * jt * jx
    work[NORMAL + 4] += weight * jt * jy
    work[NORMAL + 5] += weight * jt * jt
    work[GRADIENT] += weight * jx * error
    work[GRADIENT + 1] += weight * jy * error
    work[GRADIENT + 2] += weight * jt * error


@core
def add_beam(model: Array, work: Array, pose: Array, ray: Array, xy: Array, width: float) -> None:
    """Add what a beam that meets the edge `xy` (4,) says about its pose, as far as it is no outlier.

    The distance to the line of an edge is N / D with N = (a - o) x e and D = u x e.
    """
    distance = ray[c.DISTANCE]
    s = width * max(model[c.NOISE], model[c.NOISE_RELATIVE] * distance)
    error = ray[c.RANGE] - distance
    hit = model[c.HIT] * math.exp(-0.5 * (error / s) ** 2) / (s * ROOT_TWO_PI)
    share = hit / (hit + model[c.OUTLIER_DENSITY])
    ex, ey = xy[2] - xy[0], xy[3] - xy[1]
    ux, uy = ray[c.DIRECTION_X], ray[c.DIRECTION_Y]
    across = ux * ey - uy * ex
    if share < 1e-3 or across == 0.0:
        return
    jx, jy = -ey / across, ex / across
    ox, oy = ray[c.ORIGIN_X] - pose[0], ray[c.ORIGIN_Y] - pose[1]
    jt = (-oy) * jx + ox * jy + distance * (ux * ex + uy * ey) / across
    add_terms(work, jx, jy, jt, error, model[c.WEIGHT] * share / (s * s))


@core
def add_priors(poses: Poses, work: Array, pose: Array, i: int) -> None:
    """Add the error of the given pose, and the steps of the odometry from and to the neighbours."""
    turn = turn_between(pose[2], poses.given[i, 2])
    add_terms(work, 1.0, 0.0, 0.0, poses.given[i, 0] - pose[0], poses.precision[i, 0])
    add_terms(work, 0.0, 1.0, 0.0, poses.given[i, 1] - pose[1], poses.precision[i, 0])
    add_terms(work, 0.0, 0.0, 1.0, turn, poses.precision[i, 1])
    if poses.motion.shape[0] == 0:
        return
    if i > 0:
        add_step(poses, work, poses.pose[i - 1], pose, i - 1, False)
    if i + 1 < poses.pose.shape[0]:
        add_step(poses, work, pose, poses.pose[i + 1], i, True)


@core
def add_step(poses: Poses, work: Array, before: Array, after: Array, k: int, is_before: bool) -> None:
    """Add the step k of the odometry, as the pose before or the one after has it, as far as it is no slip."""
    cosine, sine = math.cos(before[2]), math.sin(before[2])
    x, y = after[0] - before[0], after[1] - before[1]
    ahead, aside = cosine * x + sine * y, cosine * y - sine * x
    sign, by_ahead, by_aside = (-1.0, aside, -ahead) if is_before else (1.0, 0.0, 0.0)
    motion, weight = poses.motion[k], poses.weight[k]
    off_ahead, off_aside = ahead - motion[0], aside - motion[1]
    off_turn = turn_between(before[2] + motion[2], after[2])
    _, share = log_error(poses, k, off_ahead, off_aside, off_turn)
    add_terms(work, sign * cosine, sign * sine, by_ahead, -off_ahead, share * weight[0])
    add_terms(work, -sign * sine, sign * cosine, by_aside, -off_aside, share * weight[1])
    add_terms(work, 0.0, 0.0, sign, -off_turn, share * weight[2])


@core
def factor(work: Array) -> bool:
    """Write the Cholesky factor of the normal equations; False where they are not positive."""
    a = work[NORMAL]
    if not a > 0.0:
        return False
    work[ROOT] = math.sqrt(a)
    work[ROOT + 1] = work[NORMAL + 1] / work[ROOT]
    work[ROOT + 3] = work[NORMAL + 3] / work[ROOT]
    b = work[NORMAL + 2] - work[ROOT + 1] ** 2
    if not b > 1e-12 * work[NORMAL + 2]:
        return False
    work[ROOT + 2] = math.sqrt(b)
    work[ROOT + 4] = (work[NORMAL + 4] - work[ROOT + 3] * work[ROOT + 1]) / work[ROOT + 2]
    d = work[NORMAL + 5] - work[ROOT + 3] ** 2 - work[ROOT + 4] ** 2
    if not d > 1e-12 * work[NORMAL + 5]:
        return False
    work[ROOT + 5] = math.sqrt(d)
    return True


@core
def solve_root(work: Array, x: float, y: float, t: float) -> tuple[float, float, float]:
    """Return the vector whose product with the transposed Cholesky factor is (x, y, t)."""
    third = t / work[ROOT + 5]
    second = (y - work[ROOT + 4] * third) / work[ROOT + 2]
    return (x - work[ROOT + 1] * second - work[ROOT + 3] * third) / work[ROOT], second, third


@core
def newton_step(work: Array) -> tuple[float, float, float]:
    """Return the solution of the normal equations, which are factored."""
    x = work[GRADIENT] / work[ROOT]
    y = (work[GRADIENT + 1] - work[ROOT + 1] * x) / work[ROOT + 2]
    t = (work[GRADIENT + 2] - work[ROOT + 3] * x - work[ROOT + 4] * y) / work[ROOT + 5]
    return solve_root(work, x, y, t)


@core
def gather(graph: Graph, index: EdgeIndex, beams: Beams, poses: Poses, i: int, pose: Array, width: float) -> bool:
    """Set up and factor the normal equations of the pose i at a place (3,)."""
    work = poses.work
    for k in range(NORMAL, ROOT):
        work[k] = 0.0
    for at in range(poses.beam_start[i], poses.beam_start[i + 1]):
        if poses.returned[at] == 0:
            continue
        ray = poses.new_ray[at]
        ray[c.RANGE] = beams.ray[poses.beam_of[at], c.RANGE]
        place_ray(graph.window, beams.model, pose, poses.beam_local[at], 1, ray)
        edge, distance = first_edge(graph, index, ray, ray[c.RANGE] + BEYOND)
        if edge != c.NONE:
            ray[c.DISTANCE] = distance
            add_beam(beams.model, work, pose, ray, graph.edge_xy[edge], width)
    add_priors(poses, work, pose, i)
    return factor(work)


@core
def start_from(poses: Poses, i: int, mean: Array) -> None:
    """Write where the steps of the pose i begin: the given pose, or the next one along the odometry."""
    if poses.precision[i, 0] > 0.0:
        for k in range(3):
            mean[k] = poses.given[i, k]
        return
    before, motion = poses.pose[i - 1], poses.motion[i - 1]
    cosine, sine = math.cos(before[2]), math.sin(before[2])
    mean[0] = before[0] + cosine * motion[0] - sine * motion[1]
    mean[1] = before[1] + sine * motion[0] + cosine * motion[1]
    mean[2] = before[2] + motion[2]


@core
def match(graph: Graph, index: EdgeIndex, beams: Beams, poses: Poses, i: int) -> bool:
    """Write mean and root of the proposal for the pose i into `work`; False where there is none."""
    mean = poses.work[MEAN : MEAN + 3]
    start_from(poses, i, mean)
    window = graph.window
    for width in WIDTHS:
        if not (window[0] < mean[0] < window[2] and window[1] < mean[1] < window[3]):
            return False
        if not gather(graph, index, beams, poses, i, mean, width):
            return False
        x, y, t = newton_step(poses.work)
        mean[0] += x
        mean[1] += y
        mean[2] += t
    return True


@core
def half_square(poses: Poses, pose: Array) -> float:
    """Half the squared deviations of a pose from the mean of its proposal, in standard deviations."""
    work = poses.work
    x, y, t = pose[0] - work[MEAN], pose[1] - work[MEAN + 1], turn_between(work[MEAN + 2], pose[2])
    first = work[ROOT] * x + work[ROOT + 1] * y + work[ROOT + 3] * t
    second = work[ROOT + 2] * y + work[ROOT + 4] * t
    third = work[ROOT + 5] * t
    return 0.5 * (first * first + second * second + third * third) / (INFLATION * INFLATION)


@core
def match_pose(chain: Chain, poses: Poses, rng: Rng) -> bool:
    """Propose one pose from where a match to the map leads; the ratio has both densities."""
    first = first_free(poses)
    n = poses.pose.shape[0] - first
    if n <= 0:
        return False
    i = first + int(rng.random() * n)
    if not match(chain.graph, chain.edge_index, chain.beams, poses, i):
        return False
    x, y, t = solve_root(poses.work, rng.standard_normal(), rng.standard_normal(), rng.standard_normal())
    if INFLATION * abs(t) >= math.pi:  # densities are of a heading in one turn
        return False
    poses.new_pose[i, 0] = poses.work[MEAN] + INFLATION * x
    poses.new_pose[i, 1] = poses.work[MEAN + 1] + INFLATION * y
    poses.new_pose[i, 2] = poses.work[MEAN + 2] + INFLATION * t
    log_ratio = half_square(poses, poses.new_pose[i]) - half_square(poses, poses.pose[i])
    return decide(chain, poses, i, i, log_ratio, rng)


@core_entry
def measure_spread(graph: Graph, index: EdgeIndex, beams: Beams, poses: Poses) -> None:
    """Set `spread` of every pose to what it may vary by, the map and the other poses being as they are."""
    for i in range(poses.pose.shape[0]):
        if not gather(graph, index, beams, poses, i, poses.pose[i], 1.0):
            continue
        work, root = poses.work, poses.spread[i]
        # Of the inverse U^-1 U^-T of the normal equations L U the columns of U^-1 serve as well as its lower root.
        ax, ay, at = solve_root(work, 1.0, 0.0, 0.0)
        bx, by, bt = solve_root(work, 0.0, 1.0, 0.0)
        dx, dy, dt = solve_root(work, 0.0, 0.0, 1.0)
        xx, xy, yy = ax * ax + bx * bx + dx * dx, ax * ay + bx * by + dx * dy, ay * ay + by * by + dy * dy
        xt, yt, tt = ax * at + bx * bt + dx * dt, ay * at + by * bt + dy * dt, at * at + bt * bt + dt * dt
        root[0] = math.sqrt(xx)
        root[1] = xy / root[0]
        root[2] = math.sqrt(max(yy - root[1] * root[1], 1e-18))
        root[3] = xt / root[0]
        root[4] = (yt - root[3] * root[1]) / root[2]
        root[5] = math.sqrt(max(tt - root[3] * root[3] - root[4] * root[4], 1e-18))
