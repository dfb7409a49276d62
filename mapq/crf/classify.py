"""The labels that a model gives to the patches of a map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.crf.energy import make_field, model_inputs
from mapq.crf.infer import solve
from mapq.crf.marginals import probabilities
from mapq.graph import PatchFeatures
from mapq.model import Model


class Labelling(NamedTuple):
    """The best labelling of a map, and how sure it is.

    Attributes
    ----------
    label : (m,) uint8
        `SUSPICIOUS` or `PLAUSIBLE`; of several best labellings the one with most suspicious patches.
    probability : (m,) float32
        Calibrated probability of being suspicious; above one half exactly where the label is `SUSPICIOUS`.
    difference : (m,) float64
        Difference of min-marginals, in nats.
    """

    label: NDArray[np.uint8]
    probability: NDArray[np.float32]
    difference: NDArray[np.float64]


def classify(features: PatchFeatures, model: Model) -> Labelling:
    """Return the labelling of highest score (equation 5), exactly, by a graph cut.

    Raises
    ------
    InputError
        If the features lack one of the model's, or one is not finite.
    """
    cut = solve(make_field(model_inputs(features, model), model.edge_model, model.weights))
    return Labelling(cut.label, probabilities(cut.difference, cut.label, model.temperature), cut.difference)
