"""`Model`: the parameters of the random field, and what is needed to use them on another map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.boosted_trees import Trees, contributions
from mapq.labels import LABEL_TOLERANCE
from prf.shell.errors import InputError

SYMMETRIC, NONE = "symmetric", "none"
EDGE_MODELS = (SYMMETRIC, NONE)
"""Only same or different, as in the paper; without edges: logistic regression."""

PLAUSIBILITY = "plausibility"
"""Name of x_ij of equation 13."""

TEMPERATURE, PLATT, ISOTONIC = "temperature", "platt", "isotonic"
CALIBRATIONS = (TEMPERATURE, PLATT, ISOTONIC)
"""A factor; a factor and a shift (Platt 1999); any rising curve (Zadrozny and Elkan 2002). Simplest first."""

LEAST_SLOPE = 1e-3
"""Log-odds a nat by which an isotonic calibration rises at least, so that unequal patches stay unequal."""

NOBODY = -1
"""In the place of another patch, where a value is of no pair."""

EVIDENCE = "evidence"
"""Name of the trees' log-odds among the node features."""

CLIP = 5.0
"""Standardised values are cut here: a patch that is stranger than all others must not outvote its neighbours."""


class Columns(NamedTuple):
    """What trees see of patches."""

    names: tuple[str, ...]
    values: NDArray[np.float64]  # (m, c) nan where unknown
    other: NDArray[np.int64]  # (m, c) the patch of the pair that a value is of, or `NOBODY`

    def take(self, names: tuple[str, ...]) -> Columns:
        """Return some of the columns.

        Raises
        ------
        InputError
            If there is none of a name.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise InputError(
                f"the model asks for {missing[0]}, which these features do not have. Train the model anew."
            )
        places = [self.names.index(name) for name in names]
        return Columns(names, np.ascontiguousarray(self.values[:, places]), self.other[:, places])


class Potential(NamedTuple):
    """Trees and the columns they test."""

    names: tuple[str, ...]
    trees: Trees
    base: float  # log-odds in nats to which the trees are added

    def log_odds(self, columns: Columns) -> NDArray[np.float64]:
        """Return the log-odds (m,) of being suspicious, in nats."""
        return np.asarray(self.base + contributions(self.trees, columns.take(self.names).values).sum(axis=1))

    def importance(self, columns: Sequence[Columns]) -> dict[str, float]:
        """Return how far each column moves log-odds in the mean over the patches of maps, in nats."""
        moved = np.vstack([contributions(self.trees, each.take(self.names).values) for each in columns])
        return dict(zip(self.names, np.abs(moved[:, :-1]).mean(axis=0).tolist(), strict=True))


@dataclass(frozen=True)
class Scaling:
    """Robust standardisation of named columns: ``clip((value - median) / scale)``."""

    names: tuple[str, ...]
    median: NDArray[np.float64]  # (k,) in the unit of the column; scales are positive
    scale: NDArray[np.float64]  # (k,)
    clip: float = CLIP  # bound of standardised values

    def apply(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return standardised columns (n, k); what is not known (nan) lies in the middle."""
        return np.nan_to_num(np.clip((values - self.median) / self.scale, -self.clip, self.clip), nan=0.0)


@dataclass(frozen=True)
class Calibration:
    """From differences of min-marginals to probabilities, fitted on regions kept out of training."""

    kind: str = TEMPERATURE  # one of `CALIBRATIONS`
    # log-odds = slope times difference + intercept; the slope is positive. A temperature has no intercept.
    slope: float = 1.0
    intercept: float = 0.0
    # (k, 2) of an isotonic one, which has no slope: difference and log-odds, both ascending; linear between, and beyond
    # them rising by `LEAST_SLOPE`
    knots: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))

    def log_odds(self, difference: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the log-odds (n,) of being suspicious, ascending with the difference (n,)."""
        if self.kind != ISOTONIC:
            return self.slope * difference + self.intercept
        at, value = self.knots.T
        beyond = np.minimum(difference - at[0], 0.0) + np.maximum(difference - at[-1], 0.0)
        return np.asarray(np.interp(difference, at, value) + LEAST_SLOPE * beyond)


@dataclass(frozen=True)
class Model:
    """A trained random field; docs/crf.md derives it.

    Attributes
    ----------
    edge_model : str
        One of `EDGE_MODELS`.
    features : mapping
        The settings with which features were measured.
    node : Scaling
        Of the node features f.
    x_range : (float, float)
        x_ij is cut to this range before anything else, so that the coupling is non-negative on any map.
    weights : (n_parameters,) float64
        In the order of `parameter_names`.
    calibration : Calibration
        From differences of min-marginals to probabilities.
    threshold : float
        Difference of min-marginals, in nats, from which a patch is called suspicious. 0: the best labelling.
    operating : (k, 3) float64
        Operating points: share of plausible patches kept out of training that are called suspicious, ascending; the
        least threshold that keeps to it; and the share of suspicious patches found. Empty where none were kept out.
    training : mapping
        What the model was trained on, and its held-out scores.
    tolerances : tuple of float
        Metres, ascending, at which it learnt what is wrong; it serves those between the least and the largest.
    potential : Potential or None
        Trees that make the evidence of each patch, its one node feature; couplings are then shared out among the
        neighbours of a patch. None: the field is linear in all node features.
    """

    edge_model: str
    features: Mapping[str, Any]
    node: Scaling
    x_range: tuple[float, float]
    weights: NDArray[np.float64]
    calibration: Calibration = field(default_factory=Calibration)
    threshold: float = 0.0
    operating: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    training: Mapping[str, Any] = field(default_factory=dict)
    tolerances: tuple[float, ...] = (LABEL_TOLERANCE,)
    potential: Potential | None = None

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the weights, ``group.name``."""
        return parameter_names(self.edge_model, self.node.names)


def parameter_names(edge_model: str, node_names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of all weights, ``group.name``, in their order.

    ``node``: w0 and w. ``coupling``: v0 + v1 x at both ends of the range of x, which must not be negative; linear
    between them, so that two bounds suffice.
    """
    names = ["node.bias", *(f"node.{name}" for name in node_names)]
    if edge_model == SYMMETRIC:
        names += ["coupling.at_x_min", "coupling.at_x_max"]
    return tuple(names)
