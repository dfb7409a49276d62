"""Maximum likelihood with weak priors: the best parameters of a model, their standard errors, and cross-validation.

Every parameter is fitted on a scale without ends: positive ones by their logarithm, shares by their log odds. On that
scale it has a Gaussian prior round its default, wide enough for enough readings to overrule it. What the readings do
not tell then keeps its default, with an error that says so, instead of running away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

Floats = NDArray[np.float64]

LIMIT = 5.0
"""Widths of its prior by which a parameter may leave its default, so that nothing overflows."""
STEP = 1e-3
"""Of the differences that give the Hessian, on the scale of the fit."""
SMALLER = 1.5
"""By which the logarithm of a standard deviation is lowered for a second start."""
TOLD = 0.5
"""A parameter whose error is more than this share of the width of its prior is the prior's rather than the data's."""


class Family(NamedTuple):
    """The parameters of a model.

    Attributes
    ----------
    names : tuple of str
        Of the parameters as people write them.
    default : (n,) float64
        On the scale of the fit, where the prior is centred.
    width : (n,) float64
        Standard deviations of the prior there.
    natural : callable
        Takes a point on the scale of the fit, returns the parameters as people write them, (n,).
    spread : tuple of int
        Which of them are standard deviations of which the larger one counts: the fit starts from several, since either
        may be the one that matters.
    """

    names: tuple[str, ...]
    default: Floats
    width: Floats
    natural: Callable[[Floats], Floats]
    spread: tuple[int, ...]


class Problem(Protocol):
    """Readings and the model that they are fitted by."""

    @property
    def family(self) -> Family:
        """Return the parameters."""

    @property
    def n(self) -> int:
        """Return how many readings there are."""

    def loss(self, theta: Floats, is_sharp: bool = False) -> tuple[float, Floats]:
        """Return -log likelihood, nats, and its gradient at a point on the scale of the fit.

        It is that of the sensor's model if `is_sharp`, else of one whose kinks are rounded off, for searches.
        """

    def select(self, rows: NDArray[np.bool_]) -> Problem:
        """Return the problem with the readings that a mask picks."""


class Fit(NamedTuple):
    """The parameters that explain readings best.

    Attributes
    ----------
    theta : (n,) float64
        On the scale of the fit.
    value, error : (n,) float64
        As people write them, and standard errors (of the delta method; nan where the Hessian is no maximum's).
    told : (n,) bool
        Whether the readings say more of a parameter than its prior.
    loss_before, loss : float
        -log likelihood at the defaults and at the fit, nats, without the prior.
    converged : bool
    """

    theta: Floats
    value: Floats
    error: Floats
    told: NDArray[np.bool_]
    loss_before: float
    loss: float
    converged: bool


def fit(problem: Problem) -> Fit:
    """Return the parameters with the highest likelihood times prior, and how well they are known."""
    family = problem.family
    best = _polished(problem, _search(problem, _starts(family)))
    theta = np.asarray(best.x, dtype=np.float64)
    covariance = _covariance(problem, theta)
    with np.errstate(invalid="ignore"):
        on_scale = np.sqrt(np.diag(covariance))
        jacobian = _jacobian(family.natural, theta)
        error = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian))
    return Fit(
        theta=theta,
        value=family.natural(theta),
        error=error,
        told=on_scale < TOLD * family.width,
        loss_before=problem.loss(family.default, is_sharp=True)[0],
        loss=problem.loss(theta, is_sharp=True)[0],
        converged=bool(best.success),
    )


def _starts(family: Family) -> list[Floats]:
    """Return the defaults, and the same with each standard deviation much smaller."""
    starts = [family.default]
    for index in family.spread:
        starts.append(family.default.copy())
        starts[-1][index] -= SMALLER
    return starts


def _search(problem: Problem, starts: Iterable[Floats]) -> optimize.OptimizeResult:
    """Return the best end of searches from these starts."""
    family = problem.family
    room = LIMIT * family.width
    bounds = optimize.Bounds(family.default - room, family.default + room)
    # TNC has its own small algebra: L-BFGS-B of scipy wakes the threads of BLAS for eleven numbers. ftol is in nats.
    ends = [
        optimize.minimize(
            lambda theta: penalised(problem, theta),
            start,
            jac=True,
            method="TNC",
            bounds=bounds,
            options={"maxfun": 2000, "ftol": 1e-6, "gtol": 1e-3},
        )
        for start in starts
    ]
    return min(ends, key=lambda end: float(end.fun))


def _polished(problem: Problem, found: optimize.OptimizeResult) -> optimize.OptimizeResult:
    """Return the end of Newton's steps from there: where the readings tell little, the search stops on a saddle."""
    better = optimize.minimize(
        lambda theta: penalised(problem, theta),
        found.x,
        jac=True,
        hess=lambda theta: _hessian(problem, theta),
        method="trust-exact",
        options={"gtol": 1e-3, "maxiter": 60},
    )
    family = problem.family
    is_near = bool(np.all(np.abs(better.x - family.default) <= LIMIT * family.width))
    return better if is_near and float(better.fun) <= float(found.fun) else found


def penalised(problem: Problem, theta: Floats) -> tuple[float, Floats]:
    """Return -log (likelihood times prior), nats, and its gradient."""
    family = problem.family
    loss, gradient = problem.loss(theta)
    off = (theta - family.default) / family.width
    return loss + 0.5 * float(off @ off), gradient + off / family.width


def _hessian(problem: Problem, theta: Floats) -> Floats:
    """Return the Hessian of what is minimised, by central differences of its gradient."""
    steps = STEP * np.eye(len(theta))
    rows = [
        (penalised(problem, theta + step)[1] - penalised(problem, theta - step)[1]) / (2.0 * STEP) for step in steps
    ]
    hessian = np.stack(rows)
    return 0.5 * (hessian + hessian.T)


def _covariance(problem: Problem, theta: Floats) -> Floats:
    """Return the inverse Hessian; nan if this is no minimum."""
    hessian = _hessian(problem, theta)
    if not np.isfinite(hessian).all() or np.linalg.eigvalsh(hessian).min() <= 0.0:
        return np.full_like(hessian, np.nan)
    return np.asarray(np.linalg.inv(hessian), dtype=np.float64)


def _jacobian(function: Callable[[Floats], Floats], theta: Floats) -> Floats:
    """Return the derivatives of each value (rows) by each parameter (columns)."""
    step = 1e-6
    columns = [(function(theta + row) - function(theta - row)) / (2.0 * step) for row in step * np.eye(len(theta))]
    return np.stack(columns, axis=1)


def held_out_loss(
    problem: Problem, start: Floats, group: NDArray[np.integer], n_folds: int, rng: np.random.Generator
) -> Floats:
    """Return mean -log likelihood of readings that the fit had not seen, (2,): with the defaults, with the fits.

    Parameters
    ----------
    problem : Problem
    start : (n_parameters,) array
        Where the searches begin; the fit to all readings is near all of their ends.
    group : (n,) array of int
        Readings of one group (a scan) stay together.
    n_folds : int
        At most the number of groups.
    rng : numpy.random.Generator
        Deals the groups to the folds.
    """
    groups, member = np.unique(group, return_inverse=True)
    fold = rng.permutation(len(groups))[member.reshape(-1)] % n_folds
    total = np.zeros(2)
    for k in range(n_folds):
        unseen = problem.select(fold == k)
        theta = _search(problem.select(fold != k), [start]).x
        total += [unseen.loss(at, is_sharp=True)[0] for at in (problem.family.default, theta)]
    return total / problem.n
