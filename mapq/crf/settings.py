"""`TrainSettings`: how a random field is trained."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mapq.model import EDGE_MODELS, SYMMETRIC
from prf.shell.errors import ConfigError

PL, MAX_MARGIN = "pl", "max-margin"
OBJECTIVES = (PL, MAX_MARGIN)
"""Maximum pseudo-likelihood, as in the paper; structured maximum margin."""

TREES, LINEAR = "trees", "linear"
POTENTIALS = (TREES, LINEAR)
"""Boosted trees on all that is measured on a patch and its pairs; a sum over node features, as in the paper."""


@dataclass(frozen=True)
class TrainSettings:
    """How to train.

    Attributes
    ----------
    potential : str
        One of `POTENTIALS`.
    edge_model : str
        One of `mapq.model.EDGE_MODELS`.
    regularisation : float or None
        Precision of the Gaussian prior of each standardised weight but the bias of nodes; None: by cross-validation.
    coupling_regularisation : float or None
        The same of the coupling's weights.
    balanced : bool
        Weigh both labels alike instead of each patch.
    n_folds : int
        Of the cross-validation.
    objective : str
        One of `OBJECTIVES`.
    """

    potential: str = TREES
    edge_model: str = SYMMETRIC
    regularisation: float | None = None
    coupling_regularisation: float | None = None
    balanced: bool = True
    n_folds: int = 5
    objective: str = PL

    def __post_init__(self) -> None:
        """Refuse values that nothing, or something else than was given, would be trained with.

        Raises ConfigError.
        """
        for name, value, known in (
            ("objective", self.objective, OBJECTIVES),
            ("potential", self.potential, POTENTIALS),
            ("edge_model", self.edge_model, EDGE_MODELS),
        ):
            if value not in known:
                raise ConfigError(f"crf: {name} '{value}' is unknown. Give one of {', '.join(known)}.")
        for name in ("regularisation", "coupling_regularisation"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ConfigError(f"crf: {name} {value}. Give one above 0, or separable labels would have no optimum.")
        if self.n_folds < 2:
            raise ConfigError(f"crf: {self.n_folds} folds: must be at least 2.")
