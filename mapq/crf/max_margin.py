"""Training by maximum margin: a structured support vector machine whose worst labellings graph cuts find.

The weights shall give the true labelling of each map a higher score than every other one, by as much as that is wrong
(margin rescaling: Tsochantaridis and others 2005, "Large margin methods for structured and interdependent output
variables"; for random fields Szummer, Kohli and Hoiem 2008, "Learning CRFs using graph cuts"). The labelling that
breaks this most is the best one of the same field with shifted unary terms, found exactly as the coupling is kept
from being negative. Each such labelling is a plane below the risk; the planes found so far bound the optimum from
below, so that what is returned is known to be within `GAP` of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mapq.crf.energy import Field, Inputs
from mapq.crf.graph_cut import solve
from mapq.labels import SUSPICIOUS
from mapq.model import NONE

GAP = 1e-3
"""The objective at the weights returned exceeds the least one by no more than this share of it."""
MOST_ROUNDS = 300
BIAS_PRECISION = 1e-3
"""Of the bias of nodes, which has no prior in pseudo-likelihood: some is needed for planes to bound it."""

Floats = NDArray[np.float64]


class MapPart(NamedTuple):
    """The labelled patches of a map."""

    unary: Floats  # (n, p) times the first p weights: theta
    pairs: NDArray[np.int64]  # (e, 2) both of whose patches have a label
    position: Floats  # (e,) where x_ij lies in its range; share of the coupling's weights
    share: Floats  # (e,)
    y: Floats  # (n,) labels, +1 suspicious and -1 plausible
    cost: Floats  # (n,) of calling a patch by the wrong label

    def joint(self, y: Floats, n_coupling: int) -> Floats:
        """Return the features (p + n_coupling,) whose product with the weights is the score of labels y (n,)."""
        alike = y[self.pairs[:, 0]] * y[self.pairs[:, 1]]
        alike = alike * self.share
        ends = [(1.0 - self.position) @ alike, self.position @ alike][:n_coupling]
        return np.concatenate([self.unary.T @ y, ends])

    def worst(self, weights: Floats) -> Floats:
        """Return the labels (n,) of highest score plus cost."""
        n_unary = self.unary.shape[1]
        theta = self.unary @ weights[:n_unary] - 0.5 * self.cost * self.y
        coupling = np.zeros(len(self.pairs))
        if len(weights) > n_unary:
            coupling = self.share * (weights[-2] * (1.0 - self.position) + weights[-1] * self.position)
        label = solve(Field(theta, self.pairs, coupling), np.zeros(len(theta), np.bool_)).label
        return np.where(label == SUSPICIOUS, 1.0, -1.0)


class MarginFit(NamedTuple):
    """Weights of maximum margin."""

    weights: Floats  # (n_parameters,)
    objective: float  # at the weights, and what no weights can go below
    bound: float
    n_rounds: int


class _Planes(NamedTuple):
    """Planes below the risks of the parts: slope . weights + height <= risk of part `owner`."""

    slope: list[Floats]
    height: list[float]
    owner: list[int]


def make_part(inputs: Inputs, unary: Floats, y: Floats, cost: Floats) -> MapPart:
    """Return the labelled patches of a map; y (m,) and cost (m,) are 0 where there is no label.

    As in the pseudo-likelihood, a patch without a label has no term, and as a neighbour it counts as label 0: the
    coupling with it drops out.
    """
    known = y != 0.0
    number = np.cumsum(known) - 1
    inside = known[inputs.pairs].all(axis=1)
    pairs, position, share = number[inputs.pairs[inside]], inputs.position[inside], inputs.share[inside]
    return MapPart(unary[known], pairs, position, share, y[known], cost[known])


def fit_margin(parts: Sequence[MapPart], edge_model: str, precision: Floats) -> MarginFit:
    """Return the weights of least regularised risk, to within `GAP`.

    ``sum_k precision_k w_k² / 2 + sum of parts (max over y of cost(y) + score(y) - score(true y))``, the last two
    weights not negative if the edge model has a coupling.

    `parts`: one at least; wrong labels cost something. `edge_model`: one of `mapq.model.EDGE_MODELS`. `precision`
    (n_parameters,): of the Gaussian prior of each weight; that of the bias is `BIAS_PRECISION`.
    """
    n_coupling = 0 if edge_model == NONE else 2
    precision = np.concatenate([[BIAS_PRECISION], precision[1:]])
    bounded = np.arange(len(precision)) >= len(precision) - n_coupling
    planes = _Planes([], [], [])
    weights, best, least, bound = np.zeros(len(precision)), np.zeros(len(precision)), np.inf, -np.inf
    rounds = 0
    while rounds < MOST_ROUNDS and bound < (1.0 - GAP) * least:
        rounds += 1
        value = 0.5 * float(precision @ weights**2) + _add_planes(planes, parts, weights, n_coupling)
        if value < least:
            best, least = weights, value
        weights, lower = _master(planes, len(parts), precision, bounded)
        bound = max(bound, lower)
    return MarginFit(best, least, bound, rounds)


def _add_planes(planes: _Planes, parts: Sequence[MapPart], weights: Floats, n_coupling: int) -> float:
    """Add the plane of each part's worst labelling; return the sum of the risks."""
    total = 0.0
    for owner, part in enumerate(parts):
        y = part.worst(weights)
        slope = part.joint(y, n_coupling) - part.joint(part.y, n_coupling)
        height = float(part.cost[y != part.y].sum())
        risk = float(slope @ weights) + height
        if risk > 0.0:
            planes.slope.append(slope)
            planes.height.append(height)
            planes.owner.append(owner)
            total += risk
    return total


def _master(planes: _Planes, n_parts: int, precision: Floats, bounded: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Return the weights of least regularised height of the planes, and a bound that no weights go below.

    The bound holds whatever the accuracy of the program: any shares of the planes that sum to 1 for each part give one.
    """
    slope, height, owner = np.array(planes.slope), np.array(planes.height), np.array(planes.owner, np.int64)
    n_weights, scale = len(precision), max(float(np.abs(slope).max()), 1.0)
    lift = np.zeros((len(slope), n_parts))
    lift[np.arange(len(slope)), owner] = -1.0
    floor = np.hstack([np.zeros((n_parts, n_weights)), -np.eye(n_parts)])
    held = np.hstack([-np.eye(n_weights)[bounded], np.zeros((int(bounded.sum()), n_parts))])
    # Risks and the objective in units of the steepest plane: numbers of the program are then of order 1.
    left = np.vstack([np.hstack([slope / scale, lift]), floor, held])
    right = np.concatenate([-height / scale, np.zeros(n_parts + len(held))])
    curvature = np.concatenate([precision / scale, np.zeros(n_parts)])
    z, multiplier = solve_quadratic(curvature, np.repeat([0.0, 1.0], [n_weights, n_parts]), left, right)
    weights = np.where(bounded, np.maximum(z[:n_weights], 0.0), z[:n_weights])
    share = multiplier[: len(slope)]
    total = np.bincount(owner, share, n_parts)
    share = share * np.minimum(1.0, 1.0 / np.maximum(total, 1e-300))[owner]
    pull = share @ slope
    pull = np.where(bounded, np.minimum(pull, 0.0), pull)
    return weights, float(share @ height - 0.5 * (pull**2 / precision).sum())


def solve_quadratic(curvature: Floats, slope: Floats, left: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return z (n,) of least ``z diag(curvature) z / 2 + slope z`` with ``left z <= right``, and multipliers (m,)."""
    import clarabel  # noqa: PLC0415 - for this objective alone

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.NonnegativeConeT(len(right))]
    found = clarabel.DefaultSolver(
        sparse.diags(curvature, format="csc"), slope, sparse.csc_matrix(left), right, cones, settings
    ).solve()
    return np.array(found.x), np.maximum(found.z, 0.0)
