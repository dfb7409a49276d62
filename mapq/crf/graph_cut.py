"""The best labelling and exact min-marginals by graph cuts, in whole numbers.

Energies are rounded to a power of two below 1e-9 or so and handed to the cut as integers. So the cut is exact: ties are
ties, and results depend neither on the order of sums nor on that of patches.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import maxflow
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from mapq.crf.calibration import probabilities
from mapq.crf.energy import Field, make_field, model_inputs
from mapq.features.table import PatchFeatures
from mapq.labels import LABEL_TOLERANCE, PLAUSIBLE, SUSPICIOUS
from mapq.model import Model
from prf.shell.errors import InputError

FLOW_BITS = 61
"""All flows of a run stay below 2**FLOW_BITS, so that they fit 64 bits."""
FINEST_BITS = 40
"""Energies are not resolved more finely than 2**-FINEST_BITS: features are not known to 1e-12 either."""


class Cut(NamedTuple):
    """The best labelling of a field."""

    # (m,) `SUSPICIOUS` or `PLAUSIBLE`. Of several best labellings the one with most suspicious patches, which is
    # unique.
    label: NDArray[np.uint8]
    # (m,) best score with the patch suspicious minus best score with it plausible (in nats, the difference of
    # min-marginals); >= 0 exactly where the label is `SUSPICIOUS`. nan where it was not wanted.
    difference: NDArray[np.float64]


def solve(field: Field, wanted: NDArray[np.bool_] | None = None) -> Cut:
    """Return the best labelling, and the differences of min-marginals of the patches `wanted` (m,) (default: all).

    A patch without coupling has its own sign and 2 theta; the others go through one cut, and one augmentation of it
    each (Kohli and Torr 2008, "Measuring uncertainty in graph cut solutions").

    Raises InputError if a coupling is negative or a number is not finite: the cut would then be wrong without a sign of
    it.
    """
    _require_solvable(field)
    n_patches = len(field.theta)
    wanted = np.ones(n_patches, np.bool_) if wanted is None else wanted
    unit = _unit(field)
    theta = np.rint(field.theta / unit).astype(np.int64)
    weight = np.rint(field.coupling / unit).astype(np.int64)
    halves = np.where(wanted, theta, 0)
    label = np.where(theta >= 0, SUSPICIOUS, PLAUSIBLE).astype(np.uint8)
    coupled = np.zeros(n_patches, np.bool_)
    coupled[field.pairs[weight > 0].ravel()] = True
    if coupled.any():
        pairs, kept = field.pairs[weight > 0], weight[weight > 0]
        nodes = _in_reach(np.flatnonzero(coupled), pairs)
        number = np.empty(n_patches, np.int64)
        number[nodes] = np.arange(len(nodes))
        pairs = np.sort(number[pairs], axis=1)
        order = np.lexsort((pairs[:, 1], pairs[:, 0]))
        sources, found = _cut(theta[nodes], pairs[order], kept[order], wanted[nodes])
        label[nodes] = np.where(sources, SUSPICIOUS, PLAUSIBLE)
        halves[nodes] = found
    return Cut(label, np.where(wanted, 2.0 * unit * halves, np.nan))


def _require_solvable(field: Field) -> None:
    for name, values in (("theta", field.theta), ("coupling", field.coupling)):
        if not np.isfinite(values).all():
            raise InputError(f"{name} of the random field is not finite. Look at the model's weights.")
    if len(field.coupling) and field.coupling.min() < 0.0:
        worst = int(field.coupling.argmin())
        first, second = field.pairs[worst]
        raise InputError(
            f"the coupling of patches {first} and {second} is {field.coupling[worst]:.4g}, but a graph cut needs one "
            "that is not negative. Use a model whose coupling is not negative at both ends of its range of x."
        )


def _unit(field: Field) -> float:
    """Return the power of two to round energies to."""
    # The flow of the first cut, and what forcing each patch once adds to it.
    total = 2.0 * float(np.abs(field.theta).sum() + field.coupling.sum()) + len(field.theta) + len(field.coupling)
    bits = FLOW_BITS - 2 - int(np.ceil(np.log2(max(total, 1.0))))
    return float(2.0 ** -min(bits, FINEST_BITS))


def _in_reach(nodes: NDArray[np.int64], pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the nodes (c,) in an order in which neighbours are close to each other in memory (Cuthill and McKee 1969).

    It changes no result; a million patches in random order take half the time with it.
    """
    number = np.zeros(int(nodes[-1]) + 1, np.int64)
    number[nodes] = np.arange(len(nodes))
    first, second = number[pairs].T
    shape = (len(nodes), len(nodes))
    links = coo_matrix((np.ones(len(pairs), np.int8), (first, second)), shape=shape).tocsr()
    return np.asarray(nodes[reverse_cuthill_mckee(links + links.T, symmetric_mode=True)])


def _cut(
    theta: NDArray[np.int64], pairs: NDArray[np.int64], weight: NDArray[np.int64], wanted: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Return which nodes are suspicious, and half the differences of the wanted ones (0 elsewhere).

    The source's side is suspicious, and nodes that neither terminal holds count to the source.
    """
    n_nodes = len(theta)
    graph = maxflow.Graph[int](n_nodes, len(pairs))
    nodes = graph.add_grid_nodes(n_nodes)
    graph.add_edges(pairs[:, 0], pairs[:, 1], weight, weight)
    graph.add_grid_tedges(nodes, np.maximum(theta, 0), np.maximum(-theta, 0))
    flow = graph.maxflow()
    sources = ~graph.get_grid_segments(nodes)
    # Flipping the patch alone costs at most this, so a terminal edge of this capacity forces it.
    force = np.abs(theta) + 1
    np.add.at(force, pairs.ravel(), np.repeat(weight, 2))
    return sources, _half_differences(graph, flow, sources, force, wanted)


def _half_differences(
    graph: Any, flow: int, sources: NDArray[np.bool_], force: NDArray[np.int64], wanted: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return half the differences of min-marginals: what forcing a node to the other side adds to the flow.

    A force is taken back by one of the same size from the other terminal, which leaves the same cuts and a flow that is
    larger by a constant. One call of maxflow a node, in place: copies of a graph are not safe to continue with.
    """
    halves = np.zeros(len(sources), np.int64)
    add, mark, augment = graph.add_tedge, graph.mark_node, graph.maxflow
    chosen = np.flatnonzero(wanted)
    found = []
    for node, to_sink, strength in zip(chosen.tolist(), sources[chosen].tolist(), force[chosen].tolist(), strict=True):
        if to_sink:
            add(node, 0, strength)
            mark(node)
            found.append(augment(reuse_trees=True) - flow)
            add(node, strength, 0)
        else:
            add(node, strength, 0)
            mark(node)
            found.append(flow - augment(reuse_trees=True))
            add(node, 0, strength)
        mark(node)
        flow += strength
    halves[chosen] = found
    return halves


class Labelling(NamedTuple):
    """The best labelling of a map, and how sure it is."""

    # (m,) `SUSPICIOUS` or `PLAUSIBLE`; of several best labellings the one with most suspicious patches. With a
    # threshold other than 0: `SUSPICIOUS` where the difference reaches it.
    label: NDArray[np.uint8]
    # (m,) calibrated probability of being suspicious; above that of the threshold, one half unless the model has
    # another, exactly where the label is `SUSPICIOUS`
    probability: NDArray[np.float32]
    difference: NDArray[np.float64]  # (m,) difference of min-marginals, in nats


def classify(features: PatchFeatures, model: Model, tolerance: float = LABEL_TOLERANCE) -> Labelling:
    """Return the labelling of highest score (equation 5), exactly, by a graph cut.

    `tolerance`: metres; suspicious is what is farther apart. Couplings are the same at all tolerances and attract, so
    differences of min-marginals rise with every potential, and fall as the tolerance rises.
    Raises InputError if the features lack one of the model's, or one is not finite.
    """
    cut = solve(make_field(model_inputs(features, model, tolerance), model.edge_model, model.weights))
    label = cut.label
    if model.threshold != 0.0:
        label = np.where(cut.difference >= model.threshold, SUSPICIOUS, PLAUSIBLE).astype(np.uint8)
    return Labelling(label, probabilities(cut.difference, label, model), cut.difference)
