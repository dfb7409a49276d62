"""Uncertain poses of one chain: their prior, and their readings as any pose would have them."""

import math
from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.cones import MAX_DISTANCE, READING
from prf.kernels.readings.sonar_features import BORDER, POSE_COS, POSE_SIN, POSE_X, POSE_Y
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.geometry import ray_hit
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import ABS_TOL, REL_TOL, exit_distance, walk

# Columns of ``Poses.beam_local`` and ``Poses.cone_local``: a reading in the frame of its pose.
LOCAL_X = 0
LOCAL_Y = 1
LOCAL_COS = 2
LOCAL_SIN = 3
N_LOCAL = 4

# Moves of poses, rows of ``Poses.outcomes``.
WALK = 0
MATCH = 1
SHIFT = 2
BEND = 3
WARP = 4
POSE_MOVES = ("move pose", "match pose to map", "shift stretch", "bend stretch", "warp map and poses")

# Entries of ``Poses.sums``.
LOG_POSE_PRIOR = 0
LOG_CHANGE = 1  # of the likelihood, by the proposal in work
N_POSE_SUMS = 2

TWO_PI = 2.0 * math.pi
SLIPPED = 5.0
"""Times by which steps err more in which the robot slipped."""
SLIP_REACH = 0.3
"""Metres: half of the times that it is carried it is so farther than sqrt(3) times this."""


class Poses(NamedTuple):
    """Poses of the scans in use, in order of time, and scratch for proposals. Readings are listed by pose.

    What kind of reading one is - a return, or censored - was decided at the poses where chains start, and stays.
    """

    pose: Array  # (n, 3) f8 metres, radians
    start: Array  # (n, 3) f8 where chains start, about
    given: Array  # (n, 3) f8
    precision: Array  # (n, 2) f8 of independent errors of given poses: 1/m², 1/rad²; 0: none, the first pose is held
    motion: Array  # (n - 1, 3) f8 measured step to the next pose, in the frame of the former; (0, 3): no odometry
    weight: Array  # (n - 1, 3) f8 precision of that
    slip: Array  # (n - 1, 2) f8 log densities of a slip, and of being carried, without error, over that of no error
    spread: Array  # (n, 6) f8 lower triangle, by rows, of a square root of what a pose may vary by, the map given
    fields: Array  # (k, ny, nx, 2) f8 m, coefficients of fields of motion along which scans can bend together
    field_grid: Array  # (3,) f8 m, place of the coefficients 0, 0, and the side of their squares
    mixture: Array  # (ny, nx, 2) f8 m, coefficients of a mixture of these
    beam_start: Array  # (n + 1,) i8
    beam_of: Array  # (n_beams,) i4
    beam_local: Array  # (n_beams, N_LOCAL) f8
    returned: Array  # (n_beams,) u1
    cone_start: Array  # (n + 1,) i8
    cone_of: Array  # (n_cones,) i4
    cone_local: Array  # (n_cones, N_LOCAL) f8
    cone_half: Array  # (n_cones,) f8 half of the field of view, radians
    cone_reading: Array  # (n_cones,) f8 m; inf for no return
    site_start: Array  # (n + 1,) i8
    site_local: Array  # (n_sites, 2) f8 distinct places of sensors
    new_pose: Array  # (n, 3) f8 of the proposal
    new_ray: Array  # (n_beams, N_RAY) f8
    new_edge: Array  # (n_beams,) i4
    new_cone: Array  # (n_cones, N_POSE) f8
    cells: Array  # (most cells of a cone,) i4
    near: Array  # (most cells of a cone,) f8
    work: Array  # (48,) f8
    outcomes: Array  # (len(POSE_MOVES), N_OUTCOMES) i8
    sums: Array  # (N_POSE_SUMS,) f8


@core
def turn_between(start: float, end: float) -> float:
    """Angle from one heading to another, in [-pi, pi)."""
    turn = end - start
    return turn - TWO_PI * math.floor((turn + math.pi) / TWO_PI)


@core
def log_given(poses: Poses, at: Array, i: int) -> float:
    """Log density of the error of the given pose i, up to a constant."""
    x = at[i, 0] - poses.given[i, 0]
    y = at[i, 1] - poses.given[i, 1]
    turn = turn_between(poses.given[i, 2], at[i, 2])
    return -0.5 * (poses.precision[i, 0] * (x * x + y * y) + poses.precision[i, 1] * turn * turn)


@core
def log_error(poses: Poses, i: int, ahead: float, aside: float, turn: float) -> tuple[float, float]:
    """Log density of an error of the odometry's step i, over that of no error, and how much of its precision pulls.

    It is normal; or that of a slip; or the robot was carried.
    """
    weight = poses.weight[i]
    normal = -0.5 * (weight[0] * ahead * ahead + weight[1] * aside * aside + weight[2] * turn * turn)
    if poses.slip[i, 0] == -math.inf:
        return normal, 1.0
    slipped = poses.slip[i, 0] + normal / (SLIPPED * SLIPPED)
    away = (ahead * ahead + aside * aside) / (SLIP_REACH * SLIP_REACH)
    carried = poses.slip[i, 1] - 1.5 * math.log1p(away)
    most = max(normal, max(slipped, carried))
    a, b = math.exp(normal - most), math.exp(slipped - most)
    total = a + b + math.exp(carried - most)
    return most + math.log(total), (a + b / (SLIPPED * SLIPPED)) / total


@core
def log_step(poses: Poses, before: Array, after: Array, i: int) -> float:
    """Log density of the odometry's step i from a pose (3,) to the next, up to a constant."""
    cosine = math.cos(before[2])
    sine = math.sin(before[2])
    x = after[0] - before[0]
    y = after[1] - before[1]
    ahead = cosine * x + sine * y - poses.motion[i, 0]
    aside = cosine * y - sine * x - poses.motion[i, 1]
    turn = turn_between(before[2] + poses.motion[i, 2], after[2])
    return log_error(poses, i, ahead, aside, turn)[0]


@core
def log_pose_prior(poses: Poses, at: Array, low: int, high: int) -> float:
    """Log prior of what the poses from `low` to `high` take part in, the poses being `at` (n, 3)."""
    total = 0.0
    for i in range(low, high + 1):
        total += log_given(poses, at, i)
    if poses.motion.shape[0] > 0:
        for i in range(max(low - 1, 0), min(high, at.shape[0] - 2) + 1):
            total += log_step(poses, at[i], at[i + 1], i)
    return total


@core
def window_reach(window: Array, x: float, y: float, ux: float, uy: float) -> float:
    """Distance at which a ray from inside the window leaves it."""
    along_x = math.inf
    along_y = math.inf
    if ux != 0.0:
        along_x = ((window[2] if ux > 0.0 else window[0]) - x) / ux
    if uy != 0.0:
        along_y = ((window[3] if uy > 0.0 else window[1]) - y) / uy
    return min(along_x, along_y)


@core
def place_local(pose: Array, local: Array, placed: Array) -> None:
    """Write origin and unit direction of a reading into the first four columns of `placed`."""
    cosine = math.cos(pose[2])
    sine = math.sin(pose[2])
    placed[0] = pose[0] + cosine * local[LOCAL_X] - sine * local[LOCAL_Y]
    placed[1] = pose[1] + sine * local[LOCAL_X] + cosine * local[LOCAL_Y]
    placed[2] = cosine * local[LOCAL_COS] - sine * local[LOCAL_SIN]
    placed[3] = sine * local[LOCAL_COS] + cosine * local[LOCAL_SIN]


@core
def place_ray(window: Array, model: Array, pose: Array, local: Array, returned: int, ray: Array) -> None:
    """Write the columns of a beam at a pose, all but its impact; its reading stays if it is a return."""
    place_local(pose, local, ray)
    leaves = window_reach(window, ray[0], ray[1], ray[2], ray[3])
    ray[c.MAX_DISTANCE] = min(leaves, model[c.MAX_RANGE])
    if returned == 0:
        ray[c.RANGE] = -leaves if leaves < model[c.MAX_RANGE] else math.inf


@core
def cone_reach(window: Array, pose: Array, half: float) -> float:
    """Distance at which a cone from inside the window first leaves it."""
    x, y = pose[POSE_X], pose[POSE_Y]
    heading = math.atan2(pose[POSE_SIN], pose[POSE_COS])
    reach = math.inf
    for side in range(2):
        angle = heading + (half if side == 1 else -half)
        reach = min(reach, window_reach(window, x, y, math.cos(angle), math.sin(angle)))
    for k in range(4):
        if abs(turn_between(0.5 * math.pi * k, heading)) <= half:
            ux = 1.0 if k == 0 else (-1.0 if k == 2 else 0.0)
            uy = 1.0 if k == 1 else (-1.0 if k == 3 else 0.0)
            reach = min(reach, window_reach(window, x, y, ux, uy))
    return reach


@core
def place_cone(poses: Poses, window: Array, maximum: float, pose: Array, at: int, cone: Array) -> None:
    """Write the columns of the cone listed at a place, at a pose, all but its extent.

    A return is heard wherever the window ends: what returned it lies beyond, and is then a stray to this map.
    """
    place_local(pose, poses.cone_local[at], cone)
    half = poses.cone_half[at]
    reading = poses.cone_reading[at]
    cone[BORDER] = math.tan(half)
    cone[READING] = reading
    cone[MAX_DISTANCE] = min(cone_reach(window, cone, half), maximum)
    if reading != math.inf:
        cone[MAX_DISTANCE] = max(cone[MAX_DISTANCE], reading * (1.0 + REL_TOL))


@core
def first_edge(graph: Graph, index: EdgeIndex, ray: Array, near: float) -> tuple[int, float]:
    """First edge on a ray within its reach, and its distance; (NONE, inf) if there is none.

    The way up to `near` is searched first: most impacts lie where the reading is.
    """
    reach = ray[c.MAX_DISTANCE]
    best, best_edge = reach, c.NONE
    limit = min(near, reach)
    while True:
        n = walk(index.grid, ray[0], ray[1], ray[0] + limit * ray[2], ray[1] + limit * ray[3], index.path)
        for k in range(n):
            cell = index.path[k]
            for place in range(index.cell_count[cell]):
                edge = index.cell_edges[cell, place]
                t = ray_hit(ray, graph.edge_xy[edge])
                if t < best:
                    best = t
                    best_edge = edge
            leaves = exit_distance(index.grid, cell, ray[0], ray[1], ray[2], ray[3])
            if best_edge != c.NONE and best <= leaves * (1.0 - REL_TOL) - ABS_TOL:
                return best_edge, best
        if limit >= reach:
            return best_edge, best if best_edge != c.NONE else math.inf
        limit = reach


@core_entry
def place_readings(poses: Poses, window: Array, laser: Array, maximum: float, ray: Array, cone: Array) -> None:
    """Write all beams and cones, (n_beams, N_RAY) and (n_cones, N_POSE), at the present poses, but for impacts."""
    for i in range(poses.pose.shape[0]):
        for at in range(poses.beam_start[i], poses.beam_start[i + 1]):
            place_ray(window, laser, poses.pose[i], poses.beam_local[at], poses.returned[at], ray[poses.beam_of[at]])
        for at in range(poses.cone_start[i], poses.cone_start[i + 1]):
            place_cone(poses, window, maximum, poses.pose[i], at, cone[poses.cone_of[at]])
    poses.sums[LOG_POSE_PRIOR] = log_pose_prior(poses, poses.pose, 0, poses.pose.shape[0] - 1)
