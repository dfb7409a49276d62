"""Map and poses displaced together: walls go with the scans that see them, where either alone could not move.

A field u of small motions moves every interior vertex and every pose but one that is held: either the same rigid motion
times a share that falls from 1 in its middle to 0 at its radius; or a random mixture of fields that were made before
(:mod:`prf.poses.fields`), splines along which the scans can bend all together. A point p moves to
p' = p + u((p + p') / 2): the way back is then the same with the field's opposite, which is as probable, and the
Jacobian of a point is det(I + Du/2) / det(I - Du/2), taken half way. A heading turns as a rigid body would there. What
the field is does not depend on map or poses. One that is so steep that a point might have two such places is not used,
nor is its opposite.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.poses.change import BOX, keep_poses, readings_change, sites_are_white
from prf.kernels.poses.moves import first_free, random_scale, spread_of
from prf.kernels.poses.state import LOG_CHANGE, LOG_POSE_PRIOR, Poses, is_white, log_pose_prior
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex, index_edge
from prf.kernels.state.geometry import inside_loop, segments_meet
from prf.kernels.state.graph import Graph, vertex_sine_now
from prf.kernels.state.grid import walk
from prf.kernels.state.guards import GUARD_WAY, KIND, Guards, meets_any
from prf.kernels.state.prior import log_prior

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
SLACK = 1e-6
"""Metres by which a box is enlarged: more than impacts are rounded by."""
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
    if poses.precision[0] == 0.0 and rng.random() < SHARE_OF_ALL:
        work[CENTRE], work[CENTRE + 1] = poses.pose[0, 0], poses.pose[0, 1]
        work[RADIUS] = math.inf
        spread_of(poses, 0, random_scale(rng), rng, work[MOTION : MOTION + 3])
        return abs(work[MOTION + 2]) < 1.0
    i = int(rng.random() * start.shape[0])
    work[CENTRE], work[CENTRE + 1] = start[i, 0], start[i, 1]
    widest = 2.0 * max(window[2] - window[0], window[3] - window[1])
    is_held = poses.precision[0] == 0.0
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
        shift += share * poses.precision[0]
        turn += share * (poses.precision[1] + poses.precision[0] * (dx * dx + dy * dy))
        inside += share
    if poses.precision[0] > 0.0:
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


@core
def warp_vertices(graph: Graph, trial: Graph, poses: Poses) -> tuple[bool, float]:
    """Displace the interior vertices; return whether all stay inside, and the log of the Jacobian."""
    total, window, work = 0.0, graph.window, poses.work
    for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES):
        for i in range(graph.counts[kind]):
            v = graph.members[kind, i]
            x, y = graph.vertex_xy[v, 0], graph.vertex_xy[v, 1]
            if kind == c.INTERIOR_VERTICES:
                if not displace(poses, x, y):
                    return False, 0.0
                x, y = work[PLACE], work[PLACE + 1]
                total += work[LOG_SCALED]
                if not (window[0] < x < window[2] and window[1] < y < window[3]):
                    return False, 0.0
            trial.vertex_xy[v, 0] = x
            trial.vertex_xy[v, 1] = y
    return True, total


@core
def warp_poses(poses: Poses) -> tuple[bool, float]:
    """Displace all poses but a held one; return whether that was possible, and the log of the Jacobian."""
    total, work = 0.0, poses.work
    for k in range(3):
        poses.new_pose[0, k] = poses.pose[0, k]
    for i in range(first_free(poses), poses.pose.shape[0]):
        if not displace(poses, poses.pose[i, 0], poses.pose[i, 1]):
            return False, 0.0
        poses.new_pose[i, 0], poses.new_pose[i, 1] = work[PLACE], work[PLACE + 1]
        poses.new_pose[i, 2] = poses.pose[i, 2] + work[TURNED]
        total += work[LOG_SCALED]
    return True, total


@core
def meets_listed(trial: Graph, index: EdgeIndex, edge: int, n_cells: int) -> bool:
    """Whether an edge, whose cells are in `path`, meets one listed there with which it has no vertex in common."""
    p = trial.edge_xy[edge]
    a, b = trial.edge_vertices[edge, 0], trial.edge_vertices[edge, 1]
    for k in range(n_cells):
        cell = index.path[k]
        for place in range(index.cell_count[cell]):
            other = index.cell_edges[cell, place]
            q = trial.edge_xy[other]
            u, v = trial.edge_vertices[other, 0], trial.edge_vertices[other, 1]
            is_apart = u != a and u != b and v != a and v != b
            if is_apart and segments_meet(p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]):
                return True
    return False


@core
def place_edges(trial: Graph, index: EdgeIndex, guards: Guards) -> bool:
    """Write and index the edges between displaced vertices; False where two meet, one is barred, or room is short."""
    index.cell_count[:] = 0
    for i in range(trial.counts[c.EDGES]):
        edge = trial.members[c.EDGES, i]
        xy = trial.edge_xy[edge]
        for end in range(2):
            v = trial.edge_vertices[edge, end]
            xy[2 * end] = trial.vertex_xy[v, 0]
            xy[2 * end + 1] = trial.vertex_xy[v, 1]
        trial.edge_length[edge] = math.sqrt((xy[2] - xy[0]) ** 2 + (xy[3] - xy[1]) ** 2)
        n = walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path)
        if meets_listed(trial, index, edge, n):
            return False
        if guards.lists.shape[0] > 1 and meets_any(guards, xy, index.path, n, True):
            return False
        if index_edge(index, edge, xy):
            return False
    return True


@core
def find_box(graph: Graph, trial: Graph, box: Array) -> None:
    """Write the box of all edges that are displaced, before and after, a little enlarged."""
    box[0], box[1], box[2], box[3] = math.inf, math.inf, -math.inf, -math.inf
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        old, new = graph.edge_xy[edge], trial.edge_xy[edge]
        if old[0] == new[0] and old[1] == new[1] and old[2] == new[2] and old[3] == new[3]:
            continue
        for k in range(2):
            box[k] = min(box[k], min(min(old[k], old[2 + k]), min(new[k], new[2 + k])) - SLACK)
            box[2 + k] = max(box[2 + k], max(max(old[k], old[2 + k]), max(new[k], new[2 + k])) + SLACK)


@core
def place_angles(trial: Graph) -> None:
    """Write the sines of the angles at displaced vertices."""
    for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES):
        for i in range(trial.counts[kind]):
            v = trial.members[kind, i]
            trial.vertex_sine[v] = vertex_sine_now(trial, v)


@core
def anchor_after(graph: Graph, trial: Graph, loop: Array) -> int:
    """Colour of the window's centre after edges swept over it or not."""
    window = graph.window
    x, y = 0.5 * (window[0] + window[2]), 0.5 * (window[1] + window[3])
    black = graph.counts[c.ANCHOR_BLACK]
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        old, new = graph.edge_xy[edge], trial.edge_xy[edge]
        for k in range(2):
            loop[0, k], loop[1, k], loop[2, k], loop[3, k] = old[k], old[2 + k], new[2 + k], new[k]
        if inside_loop(x, y, loop, 4):
            black = 1 - black
    return black


@core
def way_is_white(trial: Graph, index: EdgeIndex, guards: Guards, anchor_black: int, work: Array) -> bool:
    """Whether no wall was carried over the way that was driven, to which no edge is near."""
    for guard in range(guards.shape.shape[0]):
        shape = guards.shape[guard]
        if shape[KIND] == GUARD_WAY and not is_white(trial, index, anchor_black, shape[1], shape[2], work):
            return False
    return True


@core
def keep_map(graph: Graph, index: EdgeIndex, trial: Graph, trial_index: EdgeIndex, anchor_black: int) -> None:
    """Make the displaced map the present one."""
    for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES):
        for i in range(graph.counts[kind]):
            v = graph.members[kind, i]
            graph.vertex_sine[v] = trial.vertex_sine[v]
            for k in range(2):
                graph.vertex_xy[v, k] = trial.vertex_xy[v, k]
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        graph.edge_length[edge] = trial.edge_length[edge]
        for k in range(4):
            graph.edge_xy[edge, k] = trial.edge_xy[edge, k]
    for cell in range(index.cell_count.shape[0]):
        index.cell_count[cell] = trial_index.cell_count[cell]
        for place in range(index.cell_count[cell]):
            index.cell_edges[cell, place] = trial_index.cell_edges[cell, place]
    graph.counts[c.ANCHOR_BLACK] = anchor_black


@core
def warp(chain: Chain, trial: Graph, trial_index: EdgeIndex, poses: Poses, rng: Rng) -> bool:
    """Displace map and poses by a random field.

    `trial` has arrays of its own for places, lengths and angles, `trial_index` for its lists; the rest they share.
    Not with values at points, whose colours it would change.
    """
    graph = chain.graph
    if chain.points.column.shape[1] > 0:
        return False
    last = poses.pose.shape[0] - 1
    if not draw_field(graph.window, poses, rng):
        return False
    is_inside, log_vertices = warp_vertices(graph, trial, poses)
    if not is_inside:
        return False
    is_found, log_poses = warp_poses(poses)
    if not is_found or not place_edges(trial, trial_index, chain.guards):
        return False
    anchor_black = anchor_after(graph, trial, chain.proposal.loop)
    for i in range(last + 1):
        if not sites_are_white(trial, trial_index, poses, i, anchor_black):
            return False
    if not way_is_white(trial, trial_index, chain.guards, anchor_black, poses.work):
        return False
    place_angles(trial)
    map_prior = log_prior(trial, chain.density[c.SCALE])
    pose_prior = log_pose_prior(poses, poses.new_pose, 0, last)
    change = map_prior - graph.sums[c.LOG_PRIOR] + pose_prior - poses.sums[LOG_POSE_PRIOR]
    needed = math.log(1.0 - rng.random()) - change - log_vertices - log_poses
    find_box(graph, trial, poses.work[BOX : BOX + 4])
    if not readings_change(trial, trial_index, chain.beams, chain.cones, poses, 0, last, needed):
        return False
    keep_poses(chain.beams, chain.cones, poses, 0, last)
    keep_map(graph, chain.edge_index, trial, trial_index, anchor_black)
    graph.sums[c.LOG_PRIOR] = map_prior
    graph.sums[c.LOG_LIKELIHOOD] += poses.sums[LOG_CHANGE]
    poses.sums[LOG_POSE_PRIOR] = pose_prior
    return True
