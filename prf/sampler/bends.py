"""Fields along which map and poses can bend together: the softest directions of their posterior, as splines of place.

A loop of corridors can bend by centimetres as a whole where no wall and no pose can move by a millimetre alone. Its
softest directions are those of the normal equations of all poses and vertices at once, among the displacements that a
field can make: what a mixture of these proposes (:mod:`prf.kernels.poses.field`) the readings hardly contradict.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, coo_matrix, csr_matrix, diags, eye, hstack, kron, vstack
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from prf.kernels import constants as c
from prf.kernels.poses.state import Poses
from prf.kernels.state.chain import Chain
from prf.poses.graph import pull_of
from prf.poses.model import PosePrior

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

N_FIELDS = 8
SIDE, MOST_SIDES = 1.0, 40
"""Metres between coefficients, and how many there are along the longer side of the window at most."""
LOOSE = 0.3
"""Metres by which vertices may be elsewhere, one standard deviation, where no reading holds them."""
SMOOTH = 0.1
"""Metres: the same of second differences of coefficients."""
LARGE = 10.0
"""Metres: the same of coefficients."""
LEVER = 3.0
"""Metres: how far a turn of a pose moves what it sees, for what is soft."""
SLANTED = 0.05
"""Sine of the angle between beam and wall below which a beam does not count."""


class Fields(NamedTuple):
    """Fields of motion: cubic splines."""

    grid: Floats  # (3,) metres: place of the coefficients 0, 0, and the side of their squares
    coefficients: Floats  # (k, ny, nx, 2) metres, one standard deviation of the posterior along each


NO_FIELDS = Fields(np.array([0.0, 0.0, 1.0]), np.zeros((0, 1, 1, 2)))


def soft_fields(chain: Chain, poses: Poses, prior: PosePrior) -> Fields:
    """Return the softest fields at the present map and poses; none without a wall that beams end on."""
    vertex, normal = normal_matrix(chain, poses, prior)
    if not len(vertex):
        return NO_FIELDS
    window = chain.graph.window
    side = max(SIDE, float(max(window[2] - window[0], window[3] - window[1])) / MOST_SIDES)
    grid = np.array([window[0] - side, window[1] - side, side])
    nx, ny = (np.ceil((window[2:] - window[:2]) / side).astype(int) + 4).tolist()
    of_poses = _motion_of_poses(poses, grid, (nx, ny))
    of_all = vstack([of_poses, _motion_of_vertices(chain, vertex, grid, (nx, ny))]).tocsc()
    bending = _bending(nx, ny)
    stiffness = of_all.T @ normal @ of_all + block_diag([bending, bending]) / SMOOTH**2 + eye(2 * nx * ny) / LARGE**2
    moved = diags(np.tile([1.0, 1.0, LEVER**2], len(poses.pose))) @ of_poses
    stiffness, moved = stiffness.tocsc(), csr_matrix(of_poses.T @ moved)
    solved = LinearOperator(stiffness.shape, splu(stiffness).solve, dtype=np.float64)
    first = np.random.default_rng(0).standard_normal(2 * nx * ny)
    _, found = eigsh(moved, N_FIELDS, stiffness, which="LM", Minv=solved, v0=first, tol=1e-3)
    return Fields(grid, np.ascontiguousarray(found.reshape(2, ny, nx, N_FIELDS).transpose(3, 1, 2, 0)))


def normal_matrix(chain: Chain, poses: Poses, prior: PosePrior) -> tuple[Ints, csr_matrix]:
    """Return the vertices of edges, and the normal matrix of poses, each in its own frame, and of these vertices.

    Rows (3 n + 2 n_vertices): ahead, to the side, turn of each pose, x and y of each vertex.
    """
    graph, ray, edge = chain.graph, chain.beams.ray, chain.beams.impact_edge
    n = len(poses.pose)
    hit = np.flatnonzero((edge != c.NONE) & np.isfinite(ray[:, c.RANGE]) & (ray[:, c.RANGE] >= 0.0))
    owner = np.empty(len(ray), np.int64)
    owner[poses.beam_of] = np.repeat(np.arange(n), np.diff(poses.beam_start))
    slopes, weight, share = _slopes(chain, poses.pose[owner[hit]], ray[hit], graph.edge_xy[edge[hit]])
    ends = graph.edge_vertices[edge[hit]]
    used = graph.edge_vertices[graph.members[c.EDGES, : graph.counts[c.EDGES]]]
    vertex, number = np.unique(used), np.zeros(len(graph.vertex_xy), np.int64)
    number[vertex] = np.arange(len(vertex))
    by_wall = -slopes[:, 3:]
    values = np.column_stack([slopes[:, :3], (1.0 - share)[:, None] * by_wall, share[:, None] * by_wall])
    first = np.column_stack([3 * owner[hit], *(3 * n + 2 * number[ends]).T])
    columns = first[:, [0, 0, 0, 1, 1, 2, 2]] + [0, 1, 2, 0, 1, 0, 1]
    rows = np.repeat(np.arange(len(hit)), 7)
    size = 3 * n + 2 * len(vertex)
    jacobian = coo_matrix((values.ravel(), (rows, columns.ravel())), shape=(len(hit), size)).tocsr()
    held, _ = pull_of(prior, poses.pose).equations(poses.pose)
    loose = block_diag([held, eye(2 * len(vertex)) / LOOSE**2])
    return vertex, (jacobian.T @ diags(weight) @ jacobian + loose).tocsr()


def _slopes(chain: Chain, pose: Floats, ray: Floats, xy: Floats) -> tuple[Floats, Floats, Floats]:
    """Return how distances change, their precision as far as beams are no outliers, and where along edges they end.

    Changes (n, 5): by a step of the pose ahead and to the side, by its turn, and by a shift of the place along x and y.
    """
    model, distance = chain.beams.model, ray[:, c.DISTANCE]
    s = np.maximum(model[c.NOISE], model[c.NOISE_RELATIVE] * distance)
    hit = model[c.HIT] * np.exp(-0.5 * ((ray[:, c.RANGE] - distance) / s) ** 2) / (s * np.sqrt(2.0 * np.pi))
    along, unit = xy[:, 2:] - xy[:, :2], ray[:, [c.DIRECTION_X, c.DIRECTION_Y]]
    length2 = np.einsum("ij,ij->i", along, along)
    across = unit[:, 0] * along[:, 1] - unit[:, 1] * along[:, 0]
    slanted = np.abs(across) < SLANTED * np.sqrt(length2)
    across = np.where(slanted, 1.0, across)
    by_x, by_y = -along[:, 1] / across, along[:, 0] / across
    origin = ray[:, [c.ORIGIN_X, c.ORIGIN_Y]]
    off = origin - pose[:, :2]
    by_turn = -off[:, 1] * by_x + off[:, 0] * by_y + distance * np.einsum("ij,ij->i", unit, along) / across
    cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    slopes = np.column_stack([cosine * by_x + sine * by_y, cosine * by_y - sine * by_x, by_turn, by_x, by_y])
    weight = np.where(slanted, 0.0, model[c.WEIGHT] * hit / (hit + model[c.OUTLIER_DENSITY]) / s**2)
    ends = origin + distance[:, None] * unit
    share = np.clip(np.einsum("ij,ij->i", ends - xy[:, :2], along) / length2, 0.0, 1.0)
    return slopes, weight, share


def _motion_of_poses(poses: Poses, grid: Floats, size: tuple[int, int]) -> csr_matrix:
    """Return how coefficients of x, then of y, displace poses in their own frames: rows ahead, aside, turn of each."""
    n = len(poses.pose)
    free = np.ones(n)
    free[0] = poses.precision[0, 0] > 0.0
    value, by_x, by_y = splines(poses.pose[:, :2], grid, size)
    cosine, sine = diags(free * np.cos(poses.pose[:, 2])), diags(free * np.sin(poses.pose[:, 2]))
    ahead, aside = hstack([cosine @ value, sine @ value]), hstack([-sine @ value, cosine @ value])
    turn = hstack([diags(-0.5 * free) @ by_y, diags(0.5 * free) @ by_x])
    return vstack([ahead, aside, turn]).tocsr()[np.arange(3 * n).reshape(3, n).T.ravel()]


def _motion_of_vertices(chain: Chain, vertex: Ints, grid: Floats, size: tuple[int, int]) -> csr_matrix:
    """Return how they displace vertices, of which those on the border stay: rows x, y of each."""
    graph, n = chain.graph, len(vertex)
    free = np.ones(len(graph.vertex_xy))
    free[graph.members[c.BOUNDARY_VERTICES, : graph.counts[c.BOUNDARY_VERTICES]]] = 0.0
    value = diags(free[vertex]) @ splines(graph.vertex_xy[vertex], grid, size)[0]
    return block_diag([value, value]).tocsr()[np.arange(2 * n).reshape(2, n).T.ravel()]


def splines(place: Floats, grid: Floats, size: tuple[int, int]) -> tuple[csr_matrix, csr_matrix, csr_matrix]:
    """Return the cubic splines of coefficients (ny, nx) at places (n, 2) as matrices, and slopes along x and y."""
    nx, ny = size
    at = (place - grid[:2]) / grid[2]
    cell = np.floor(at).astype(np.int64)
    t = (at - cell)[:, :, None]
    s = 1.0 - t
    value = np.concatenate([s**3, 4.0 - 6.0 * t**2 + 3.0 * t**3, 4.0 - 6.0 * s**2 + 3.0 * s**3, t**3], axis=2) / 6.0
    slope = 0.5 * np.concatenate([-(s**2), t * (3.0 * t - 4.0), -s * (3.0 * s - 4.0), t**2], axis=2) / grid[2]
    column, row = (np.clip(cell[:, k, None] + np.arange(-1, 3), 0, n - 1) for k, n in enumerate(size))
    number = (row[:, :, None] * nx + column[:, None, :]).ravel()
    rows = np.repeat(np.arange(len(place)), 16)

    def matrix(along_x: Floats, along_y: Floats) -> csr_matrix:
        product = along_y[:, 1, :, None] * along_x[:, 0, None, :]
        return coo_matrix((product.ravel(), (rows, number)), shape=(len(place), nx * ny)).tocsr()

    return matrix(value, value), matrix(slope, value), matrix(value, slope)


def _bending(nx: int, ny: int) -> csr_matrix:
    """Return the form whose value is the sum of the squared second differences of coefficients."""

    def difference(n: int, order: int) -> csr_matrix:
        found = eye(n, format="csr")
        for _ in range(order):
            found = found[1:] - found[:-1]
        return found

    twist = np.sqrt(2.0) * kron(difference(ny, 1), difference(nx, 1))
    parts = [kron(eye(ny), difference(nx, 2)), kron(difference(ny, 2), eye(nx)), twist]
    return csr_matrix(sum(part.T @ part for part in parts))
