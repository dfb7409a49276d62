"""The pseudo-likelihood of labels: a logistic regression of each label on its patch and its neighbours' labels.

The score is linear in the weights, so log P(y_i | all other labels) = -log(1 + exp(-2 y_i s_i)) with s_i linear in them
too. One matrix holds a labelled patch a row, whatever map it is from; its few columns make Newton's method cheap.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from prf.shell.errors import InputError

MAX_NEWTON_STEPS = 200
MAX_HALVINGS = 60
CONVERGED = 1e-14
"""Newton's method ends when it would gain less than this share of the objective."""


class Problem(NamedTuple):
    """What the weights are fitted to."""

    # (n, p) row i times the weights is s_i, half the log-odds of patch i given its neighbours' labels
    design: NDArray[np.float64]
    y: NDArray[np.float64]  # (n,) labels, +1 suspicious and -1 plausible
    importance: NDArray[np.float64]  # (n,) weight of each patch
    precision: NDArray[np.float64]  # (p,) of the Gaussian prior of each weight (L2 regularisation); 0 = none
    bounded: tuple[int, ...]  # weights that must not be negative


def objective(problem: Problem, weights: NDArray[np.float64]) -> float:
    """Return the regularised negative log-pseudo-likelihood, in nats; convex."""
    margins = 2.0 * problem.y * (problem.design @ weights)
    losses = np.logaddexp(0.0, -margins)
    return float(problem.importance @ losses + 0.5 * problem.precision @ weights**2)


def gradient(problem: Problem, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the gradient (p,) of :func:`objective`."""
    wrong = expit(-2.0 * problem.y * (problem.design @ weights))
    slopes = -2.0 * problem.importance * problem.y * wrong
    return np.asarray(problem.design.T @ slopes + problem.precision * weights)


def hessian(problem: Problem, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the second derivatives (p, p) of :func:`objective`."""
    scores = problem.design @ weights
    curvature = 4.0 * problem.importance * expit(2.0 * scores) * expit(-2.0 * scores)
    return np.asarray((problem.design.T * curvature) @ problem.design + np.diag(problem.precision))


def fit(problem: Problem) -> NDArray[np.float64]:
    """Return the weights (p,) of least :func:`objective` under the bounds.

    The objective is convex, so its least value over the box is its least value on one of the box's faces, reached
    inside that face. There are two bounds, hence four faces: each is solved by Newton's method, and of those whose
    solution keeps the bounds the best is taken.

    Raises InputError if only one label occurs: the bias would be infinite.
    """
    if len(np.unique(problem.y)) < 2:
        raise InputError("patches of one label only cannot be separated from others. Label patches of both kinds.")
    best, best_value = np.zeros(problem.design.shape[1]), np.inf
    for n_zero in range(len(problem.bounded) + 1):
        for zero in combinations(problem.bounded, n_zero):
            weights = _minimise_on_face(problem, zero)
            if (weights[list(problem.bounded)] < 0.0).any():
                continue
            value = objective(problem, weights)
            if value < best_value:
                best, best_value = weights, value
    return best


def _minimise_on_face(problem: Problem, zero: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the least objective's weights with those of `zero` at 0 and the others unbounded."""
    free = np.setdiff1d(np.arange(problem.design.shape[1]), zero)
    weights = np.zeros(problem.design.shape[1])
    value = objective(problem, weights)
    for _ in range(MAX_NEWTON_STEPS):
        slope = gradient(problem, weights)[free]
        step = np.zeros_like(weights)
        step[free] = -np.linalg.solve(hessian(problem, weights)[np.ix_(free, free)], slope)
        gain = -float(slope @ step[free])
        if gain <= CONVERGED * max(value, CONVERGED):
            break
        weights, new_value = _line_search(problem, weights, step, value, gain)
        if new_value >= value:
            break
        value = new_value
    return weights


def _line_search(
    problem: Problem, weights: NDArray[np.float64], step: NDArray[np.float64], value: float, gain: float
) -> tuple[NDArray[np.float64], float]:
    """Return the weights after the longest step 1, 1/2, 1/4 ... that earns a quarter of what its slope promises."""
    length = 1.0
    for _ in range(MAX_HALVINGS):
        tried = weights + length * step
        new_value = objective(problem, tried)
        if new_value <= value - 0.25 * length * gain:
            return tried, new_value
        length /= 2.0
    return weights, value
