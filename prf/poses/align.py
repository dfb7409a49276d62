"""All scans aligned at once: points of one place and direction lie on one line, whoever saw them.

The world is cut into squares, anew in every round; points of a square whose normals agree are taken for one wall, and
poses move so that they lie on one line. Squares shrink as poses come to agree. Offsets of lines are eliminated, so that
a round is one sparse linear system in the poses, as in bundle adjustment with planes (Liu, Zhang 2021).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.linalg import LinearOperator, cg, splu

from prf.poses.graph import Disturbance, Pull
from prf.poses.plane import Floats, compose
from prf.poses.scans import WallPoints
from prf.shell.cli.console import Report, report_nothing

Ints = NDArray[np.int64]
SECTORS = 8  # of the direction of normals
EXACT, MOST = 1e-5, 1000  # share of the right hand side that a solution leaves at most, and rounds of its search
ROUNDS = 24
SETTLING = 5
"""Last rounds, with several layouts of the smallest squares together; the mean of all but the first is the result."""
DRAWING = 10  # rounds of a draw; of fewer all lie too near the poses at which it begins
LAYOUTS, MOST_ROWS = 4, 500_000  # so many, unless there would be more points of all
SMALLEST, LARGEST = 0.4, 1.5  # metres, sides of squares
NARROW, WIDE = 0.1, 0.5  # metres, and share of the side: distance from a line at which a point counts a quarter
BLUR = 0.1  # of that distance: how far points are off besides the noise, so that wrong lines pull less than the prior
SLOPE = 1.0  # one over the variance of the mean normal of a line, 1/rad2
STEP = np.array([0.3, 0.3, 0.1])  # m, m, rad: largest change of a pose in a round


class Lines(NamedTuple):
    """Points on common lines, linear in the changes of their states."""

    owner: Ints  # (m,) state
    line: Ints  # (m,) line
    along: Floats  # (m,) metres along the line, from the middle of its points
    lever: Floats  # (m, 3) change of the distance from the line by a change of the state
    distance: Floats  # (m,) metres
    weight: Floats  # (m,) 1/m2
    n_lines: int


def align(
    scans: WallPoints, poses: Floats, pull: Pull, error: float, rng: np.random.Generator, layouts: int = LAYOUTS
) -> Floats:
    """Return poses (n, 3) at which the scans agree.

    `error`: metres that points lie apart at first, about. `layouts`: of squares that are looked at together at the end.
    """
    first = float(np.clip(4.0 * error, SMALLEST, LARGEST))
    sides = np.geomspace(first, SMALLEST, ROUNDS - SETTLING)
    tolerances = np.geomspace(WIDE * first, NARROW, ROUNDS - SETTLING)
    for side, tolerance in zip(sides, tolerances, strict=True):
        poses = _moved(poses, _solve(common_lines(scans, poses, side, tolerance, rng), poses, pull))
    settled = []
    for _ in range(SETTLING):
        poses = _moved(poses, _solve(settled_lines(scans, poses, rng, layouts), poses, pull))
        settled.append(poses)
    return np.asarray(np.mean(settled[1:], axis=0))


def _moved(poses: Floats, change: Floats) -> Floats:
    return compose(poses, np.clip(change, -STEP, STEP))


def disturbed(
    scans: WallPoints,
    poses: Floats,
    pull: Pull,
    rng: np.random.Generator,
    sign: float = 1.0,
    report: Report = report_nothing,
) -> Floats:
    """Return about a draw (n, 3) of the posterior: poses at which the scans agree if all errs once more as it may.

    Points, given poses and steps are disturbed by errors of their densities and the scans aligned again, from `poses`
    (randomize then optimize, Bardsley et al. 2014). `sign`: -1 gives the draw of the opposite errors. The share
    done is reported.
    """
    upright = np.abs(np.einsum("ij,ij->i", scans.normal, scans.point)) / np.linalg.norm(scans.point, axis=1)
    push = sign * rng.standard_normal(len(scans.owner)) * upright / np.sqrt(scans.weight)
    n, k = len(poses), len(pull.relations.tail)
    disturbance = Disturbance(sign * rng.standard_normal((n, 3)), sign * rng.standard_normal((k, 3)))
    layout, settled = np.random.default_rng(0), []
    for done in range(1, DRAWING + 1):
        lines = settled_lines(scans, poses, layout)
        pushed = lines._replace(distance=lines.distance + np.resize(push, len(lines.distance)))
        poses = _moved(poses, _solve(pushed, poses, pull, disturbance))
        settled.append(poses)
        report(done / DRAWING)
    return np.asarray(np.mean(settled[1 - SETTLING :], axis=0))


def settled_lines(scans: WallPoints, poses: Floats, rng: np.random.Generator, layouts: int = LAYOUTS) -> Lines:
    """Return the lines of several layouts of the smallest squares, one after another, each with a share of the weight.

    What a long wall says of poses far apart depends on where squares cut it: of one layout alone the poses of a loop of
    corridors came out decimetres apart.
    """
    n = int(np.clip(MOST_ROWS // max(len(scans.owner), 1), 1, layouts))
    found = [common_lines(scans, poses, SMALLEST, NARROW, rng) for _ in range(n)]
    first = np.cumsum([0, *(each.n_lines for each in found)])
    line = np.concatenate([each.line + start for each, start in zip(found, first, strict=False)])
    parts = {
        name: np.concatenate([getattr(each, name) for each in found])
        for name in ("owner", "along", "lever", "distance", "weight")
    }
    parts["weight"] /= n
    return Lines(line=line, n_lines=int(first[-1]), **parts)


def common_lines(scans: WallPoints, poses: Floats, side: float, tolerance: float, rng: np.random.Generator) -> Lines:
    """Return the lines of squares of a side (m), laid at random, in which points of several states lie."""
    world, normal = scans.at(poses)
    column, row = np.floor((world + rng.uniform(0.0, side, 2)) / side).astype(np.int64).T
    turn = np.arctan2(normal[:, 1], normal[:, 0]) + rng.uniform(0.0, 2.0 * np.pi)
    sector = np.floor(turn * (SECTORS / (2.0 * np.pi))).astype(np.int64) % SECTORS
    line = _numbered(sector, column, row)
    n = int(line.max(initial=-1)) + 1
    sure = scans.weight / (1.0 + scans.weight * (BLUR * tolerance) ** 2)
    weight, across = sure, _mean(line, normal, sure, n)
    for _ in range(3):
        centre, across = _mean(line, world, weight, n), _straight(across)
        off = world - centre[line]
        distance = np.einsum("ij,ij->i", across[line], off)
        along = across[line, 0] * off[:, 1] - across[line, 1] * off[:, 0]
        weight = sure / np.square(1.0 + np.square(distance / tolerance))
        slope = np.bincount(line, weight * along * distance, n) / (np.bincount(line, weight * along**2, n) + SLOPE)
        across = across - slope[:, None] * np.column_stack([-across[:, 1], across[:, 0]])
    along -= _mean(line, along[:, None], weight, n)[line, 0]
    own = poses[scans.owner, 2]
    cosine, sine = np.cos(own), np.sin(own)
    x, y = across[line].T
    ahead, aside = cosine * x + sine * y, cosine * y - sine * x
    lever = np.column_stack([ahead, aside, scans.point[:, 0] * aside - scans.point[:, 1] * ahead])
    return Lines(scans.owner, line, along, lever, distance, weight, n)


def _numbered(*columns: Ints) -> Ints:
    """Return for each row a number of its combination of values."""
    key = np.zeros(len(columns[0]), np.int64)
    for each in columns:
        key = key * (int(np.ptp(each)) + 1) + each - each.min()
    return np.unique(key, return_inverse=True)[1].astype(np.int64)


def _straight(vector: Floats) -> Floats:
    return np.asarray(vector / np.maximum(np.linalg.norm(vector, axis=1), 1e-9)[:, None])


def _mean(line: Ints, values: Floats, weight: Floats, n: int) -> Floats:
    total = np.bincount(line, weight, n)
    return np.column_stack([np.bincount(line, weight * each, n) / total for each in values.T])


def _solve(lines: Lines, poses: Floats, pull: Pull, disturbance: Disturbance | None = None) -> Floats:
    """Return the changes (n, 3) that bring points to their lines; `disturbance`: of what holds the poses."""
    n = len(poses)
    held, right = pull.equations(poses, disturbance)
    weighed = lines.weight[:, None] * lines.lever
    blocks = np.stack(
        [np.bincount(lines.owner, weighed[:, i] * lines.lever[:, j], n) for i in range(3) for j in range(3)]
    )
    own = csc_matrix(block_diag(list(blocks.T.reshape(n, 3, 3)))) + held
    # Two unknowns a line are eliminated: its offset, and its slope, which the normals of its points give roughly.
    form = np.column_stack([np.ones(len(lines.along)), lines.along])
    column = lines.line[:, None] + [0, lines.n_lines]
    mass = np.bincount(column.ravel(), (lines.weight[:, None] * form**2).ravel()) + np.repeat(
        [0.0, SLOPE], lines.n_lines
    )
    mean = np.bincount(column.ravel(), ((lines.weight * lines.distance)[:, None] * form).ravel()) / mass
    left = lines.distance - (mean[column] * form).sum(axis=1)
    for axis in range(3):
        right[axis::3] -= np.bincount(lines.owner, weighed[:, axis] * left, n)
    at = np.broadcast_to(3 * lines.owner[:, None, None] + np.arange(3)[:, None], (len(left), 3, 2))
    values = weighed[:, :, None] * form[:, None]
    place = (at.ravel(), np.broadcast_to(column[:, None], at.shape).ravel())
    shared = coo_matrix((values.ravel(), place), shape=(3 * n, 2 * lines.n_lines)).tocsr()
    back = csr_matrix(shared.T)
    rough = splu(own)
    matrix = LinearOperator((3 * n, 3 * n), lambda v: own @ v - shared @ ((back @ v) / mass), dtype=np.float64)
    found, _ = cg(
        matrix, right, rtol=EXACT, maxiter=MOST, M=LinearOperator(matrix.shape, rough.solve, dtype=np.float64)
    )
    return np.asarray(found).reshape(n, 3)
