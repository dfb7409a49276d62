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
from mapq.patches import PLAUSIBLE, SUSPICIOUS


class Labelling(NamedTuple):
    """The best labelling of a map, and how sure it is."""

    # (m,) `SUSPICIOUS` or `PLAUSIBLE`; of several best labellings the one with most suspicious patches. With a
    # threshold other than 0: `SUSPICIOUS` where the difference reaches it.
    label: NDArray[np.uint8]
    # (m,) calibrated probability of being suspicious; above that of the threshold, one half unless the model has
    # another, exactly where the label is `SUSPICIOUS`
    probability: NDArray[np.float32]
    difference: NDArray[np.float64]  # (m,) difference of min-marginals, in nats


def classify(features: PatchFeatures, model: Model) -> Labelling:
    """Return the labelling of highest score (equation 5), exactly, by a graph cut.

    Raises InputError if the features lack one of the model's, or one is not finite.
    """
    cut = solve(make_field(model_inputs(features, model), model.edge_model, model.weights))
    label = cut.label
    if model.threshold != 0.0:
        label = np.where(cut.difference >= model.threshold, SUSPICIOUS, PLAUSIBLE).astype(np.uint8)
    return Labelling(label, probabilities(cut.difference, label, model), cut.difference)
