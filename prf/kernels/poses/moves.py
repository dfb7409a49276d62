"""Moves of poses on a map that stays: one pose, a stretch of them shifted or bent (docs/moves.md)."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.poses.change import keep_poses, readings_change, sites_are_white
from prf.kernels.poses.state import LOG_CHANGE, LOG_POSE_PRIOR, Poses, log_pose_prior
from prf.kernels.state.chain import Chain

LEAST_SCALE = 0.1
MOST_SCALE = 4.0
"""A random walk is scaled by a factor between these, even in its logarithm."""


@core
def random_scale(rng: Rng) -> float:
    """Draw the factor of a random walk."""
    return LEAST_SCALE * math.pow(MOST_SCALE / LEAST_SCALE, rng.random())


@core
def spread_of(poses: Poses, i: int, scale: float, rng: Rng, out: Array) -> None:
    """Draw a displacement (3,) as a pose may vary, times `scale`."""
    root = poses.spread[i]
    a = rng.standard_normal() * scale
    b = rng.standard_normal() * scale
    d = rng.standard_normal() * scale
    out[0] = root[0] * a
    out[1] = root[1] * a + root[2] * b
    out[2] = root[3] * a + root[4] * b + root[5] * d


@core
def first_free(poses: Poses) -> int:
    """The first pose that may move: the second where odometry alone holds the poses."""
    return 1 if poses.precision[0, 0] == 0.0 else 0


@core
def decide(chain: Chain, poses: Poses, low: int, high: int, log_ratio: float, rng: Rng) -> bool:
    """Accept or reject the new poses `low` to `high`; `log_ratio` is the log of the ratio of proposal densities."""
    if low < first_free(poses):
        return False
    graph, index = chain.graph, chain.edge_index
    for i in range(low, high + 1):
        if not sites_are_white(graph, index, poses, i, graph.counts[c.ANCHOR_BLACK]):
            return False
    prior = -log_pose_prior(poses, poses.pose, low, high)
    swap_poses(poses, low, high)
    prior += log_pose_prior(poses, poses.pose, low, high)
    swap_poses(poses, low, high)
    needed = math.log(1.0 - rng.random()) - prior - log_ratio
    if not readings_change(graph, index, chain.beams, chain.cones, poses, low, high, needed):
        return False
    keep_poses(chain.beams, chain.cones, poses, low, high)
    poses.sums[LOG_POSE_PRIOR] += prior
    graph.sums[c.LOG_LIKELIHOOD] += poses.sums[LOG_CHANGE]
    return True


@core
def swap_poses(poses: Poses, low: int, high: int) -> None:
    """Exchange present and new poses: the prior of a stretch looks at its neighbours too."""
    for i in range(low, high + 1):
        for k in range(3):
            kept = poses.pose[i, k]
            poses.pose[i, k] = poses.new_pose[i, k]
            poses.new_pose[i, k] = kept


@core
def move_pose(chain: Chain, poses: Poses, rng: Rng) -> bool:
    """Displace one pose by a random walk: symmetric."""
    first = first_free(poses)
    n = poses.pose.shape[0] - first
    if n <= 0:
        return False
    i = first + int(rng.random() * n)
    spread_of(poses, i, random_scale(rng), rng, poses.work)
    for k in range(3):
        poses.new_pose[i, k] = poses.pose[i, k] + poses.work[k]
    return decide(chain, poses, i, i, 0.0, rng)


@core
def draw_stretch(poses: Poses, rng: Rng) -> tuple[int, int]:
    """First and last pose of a stretch: its length even in the logarithm, its place uniform."""
    first = first_free(poses)
    n = poses.pose.shape[0] - first
    length = min(n, int(2.0 * math.pow(0.5 * n + 0.5, rng.random())))
    low = first + int(rng.random() * (n - length + 1))
    return low, low + length - 1


@core
def move_stretch(chain: Chain, poses: Poses, bends: bool, rng: Rng) -> bool:
    """Move a stretch of poses rigidly, or by shares that rise and fall along it: symmetric, its Jacobian 1.

    A turn is about the pose in the middle, which it leaves; a bend either turns or shifts, since both together would
    not be undone by their opposites.
    """
    if poses.pose.shape[0] - first_free(poses) < 2:
        return False
    low, high = draw_stretch(poses, rng)
    middle = (low + high) // 2
    spread_of(poses, middle, random_scale(rng) / math.sqrt(high - low + 1.0), rng, poses.work)
    x, y, turn = poses.work[0], poses.work[1], poses.work[2]
    if bends and rng.random() < 0.5:
        x, y = 0.0, 0.0
    elif bends:
        turn = 0.0
    centre_x, centre_y = poses.pose[middle, 0], poses.pose[middle, 1]
    half = 0.5 * (high - low) + 1.0
    for i in range(low, high + 1):
        share = 1.0
        if bends:
            share = 0.5 + 0.5 * math.cos(math.pi * (i - middle) / half)
        cosine, sine = math.cos(share * turn), math.sin(share * turn)
        dx, dy = poses.pose[i, 0] - centre_x, poses.pose[i, 1] - centre_y
        poses.new_pose[i, 0] = centre_x + cosine * dx - sine * dy + share * x
        poses.new_pose[i, 1] = centre_y + sine * dx + cosine * dy + share * y
        poses.new_pose[i, 2] = poses.pose[i, 2] + share * turn
    return decide(chain, poses, low, high, 0.0, rng)
