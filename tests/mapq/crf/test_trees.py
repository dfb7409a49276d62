"""What trees see of patches: their own features, and those of the pair that is in the worst conflict."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.crf.trees import (
    DECISIVE,
    IN_TOLERANCES,
    KNOWS_SCANS,
    LEFT_OUT,
    LOW_RATIO,
    MOST_SURE,
    OF_SCANS,
    OFFSET_RATIO,
    SHARES,
    SURELY,
    TOLERANCE,
    columns_of,
    evidence_of,
    grow,
    with_evidence,
    without_scans,
)
from mapq.features.context import EDGE_COLUMNS, NODE_COLUMNS
from mapq.features.pairs import EDGE_NAMES
from mapq.features.shape import NODE_NAMES
from mapq.features.table import PatchFeatures
from mapq.kernels.boosted_trees import contributions
from mapq.model import EVIDENCE, NOBODY, Columns
from prf.shell.errors import InputError
from tests.reference.mapq_crf import draw_pairs
from tests.reference.mapq_trees import draw_potential, slow_log_odds

NODE = (*NODE_NAMES, *NODE_COLUMNS["moments"], *NODE_COLUMNS["copies"])
T = 0.2
"""Metres: the tolerance of these tests."""
CONTEXT = (*EDGE_COLUMNS["outlines"], *EDGE_COLUMNS["rays"])


def draw(seed: int, n_patches: int = 12, n_pairs: int = 25) -> PatchFeatures:
    """Return features of which some pairs are in no conflict, and some conflicts equal."""
    rng = np.random.default_rng(seed)
    pairs = draw_pairs(rng, n_patches, n_pairs)
    edge = rng.uniform(0.1, 1.0, (len(pairs), len(EDGE_NAMES)))
    edge[:, 2:4] = rng.choice([0.0, 0.25, 0.5, 1.0], (len(pairs), 2))
    edge[:, 1] = rng.choice([0.5, 1.0], len(pairs))
    context = rng.uniform(-1.0, 1.0, (len(pairs), len(CONTEXT))) * (edge[:, 1] * edge[:, 2])[:, None]
    node = rng.normal(size=(n_patches, len(NODE)))
    low, metres = NODE.index("disagreement_low"), NODE.index("disagreement")
    node[:, low] = rng.uniform(0.0, 0.4, n_patches)
    node[:, metres] = node[:, low] + rng.uniform(0.0, 0.1, n_patches)
    node[:, NODE.index("disagreement_high")] = node[:, metres] + rng.uniform(0.0, 0.1, n_patches)
    node[:, NODE.index("shift_along")] = rng.uniform(0.0, 1.5, n_patches)
    x, names = rng.uniform(-1.0, 1.0, len(pairs)), (*EDGE_NAMES, *CONTEXT)
    return PatchFeatures(node, pairs, np.hstack([edge, context]), x, NODE, names, context_names=CONTEXT)


def slow_columns(features: PatchFeatures, patch: int) -> dict[str, tuple[float, int]]:
    """Return the columns of a patch by their definition: value and other patch."""
    rows = [dict(zip(features.edge_names, row, strict=True)) for row in features.edge.tolist()]
    values = dict(zip(NODE, features.node[patch].tolist(), strict=True))
    found = {name: (value, NOBODY) for name, value in values.items() if name not in LEFT_OUT}
    found |= {name: (values[metres] / T, NOBODY) for name, metres in IN_TOLERANCES.items()} | {TOLERANCE: (T, NOBODY)}
    found[KNOWS_SCANS] = 1.0, NOBODY
    error = max((values["disagreement_high"] - values["disagreement_low"]) / 3.92, 1e-6)
    beyond = (values["disagreement"] - T) / error
    found[SURELY] = (min(max(beyond, -MOST_SURE), MOST_SURE), NOBODY)
    mine = [
        (rows[k], i + j - patch) for k, (i, j) in enumerate(features.pairs.tolist()) if patch in (i, j)
    ]  # the other patch of (i, j)
    for name, part in (("worst_overlap", "overlap"), ("worst_crossing", "crossing")):
        worst = max(mine, key=lambda pair: (pair[0]["weight"] * pair[0][part], -pair[1]), default=None)
        if worst is None or worst[0][part] == 0.0:
            found[name], row, other = (0.0, NOBODY), None, NOBODY
        else:
            row, other = worst
            found[name] = row["weight"] * row[part], other
        if part == "crossing":
            continue
        found[OFFSET_RATIO] = (np.nan if row is None else row["offset"] / T, other)
        for each in SHARES:
            share = np.nan if row is None else row[each] / found[name][0]
            found[f"over_{each}"] = (share, other)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_columns_are_those_of_the_pair_in_the_worst_conflict(seed):
    features = draw(seed)
    columns = columns_of(features, T)
    assert len(set(columns.names)) == len(columns.names)
    for patch in range(len(features.node)):
        expected = slow_columns(features, patch)
        assert set(columns.names) == set(expected)
        for place, name in enumerate(columns.names):
            value, other = expected[name]
            assert columns.values[patch, place] == pytest.approx(value, abs=1e-12, nan_ok=True), name
            assert columns.other[patch, place] == other, name


def test_a_pair_without_sensor_positions_is_described_so():
    """What a map does not record is 0 in the features, and nan for trees, other than evidence that balances."""
    features = draw(1)
    features.edge[:, features.edge_names.index("facing_away")] = 0.0
    columns = columns_of(features)
    assert np.isnan(columns.values[:, columns.names.index("over_facing_away")]).all()


@pytest.mark.parametrize("change", ["order of pairs", "both ways round", "numbers of patches"])
def test_neither_numbers_nor_order_matter(change):
    features, rng = draw(2), np.random.default_rng(0)
    # Of pairs in equal conflict it is the smaller number that decides: there are none here.
    features.edge[:, 1] = rng.uniform(0.5, 1.0, len(features.pairs))
    order, number = np.arange(len(features.pairs)), np.arange(len(features.node))
    pairs = features.pairs
    if change == "order of pairs":
        order = rng.permutation(order)
    elif change == "both ways round":
        pairs = pairs[:, ::-1]
    else:
        number = rng.permutation(number)
    place = np.argsort(number)
    turned = features._replace(node=features.node[number], pairs=place[pairs][order], edge=features.edge[order])
    one, other = columns_of(features), columns_of(turned)
    np.testing.assert_allclose(other.values, one.values[number], rtol=1e-14)
    np.testing.assert_array_equal(other.other, np.where(one.other < 0, NOBODY, place[one.other])[number])


@pytest.mark.parametrize(("n_patches", "n_pairs"), [(0, 0), (1, 0), (4, 0)])
def test_maps_without_pairs(n_patches, n_pairs):
    columns = columns_of(draw(1, n_patches, n_pairs))
    assert columns.values.shape == columns.other.shape == (n_patches, len(columns.names))
    assert (columns.other == NOBODY).all()


def test_without_scans_columns_are_as_a_map_of_points_alone_has_them():
    features = draw(3)
    columns = without_scans(columns_of(features))
    in_tolerances = {KNOWS_SCANS, SURELY, "disagreement_ratio", "low_ratio", "high_ratio"}
    rays = {f"over_{name}" for name in EDGE_COLUMNS["rays"]}
    assert set(OF_SCANS) == {*NODE_COLUMNS["moments"], *rays, *in_tolerances}
    plain = features._replace(node=features.node.copy(), edge=features.edge.copy())
    plain.node[:, [NODE.index(name) for name in NODE_COLUMNS["moments"]]] = np.nan
    plain.edge[:, features.edge_names.index("facing_away")] = 0.0
    expected = columns_of(plain)
    for place, name in enumerate(columns.names):
        np.testing.assert_array_equal(columns.values[:, place], expected.values[:, place], err_msg=name)


def test_maps_of_points_alone_have_trees_of_their_own():
    """Those of either kind add what they do by themselves, and a test adds nothing to what a column is a reason for."""
    seen = [columns_of(draw(seed, 60, 120)) for seed in range(4)]
    bare = [without_scans(each) for each in seen]
    labels = [np.random.default_rng(seed).choice([-1.0, 0.0, 1.0], 60) for seed in range(8)]
    weights = [np.ones(60)] * 8
    both = grow([*seen, *bare], labels, weights)
    names = tuple(name for name in seen[0].names if name not in OF_SCANS)
    alone = grow([each.take(names) for each in bare], labels[4:], weights[4:])
    known = grow(seen, labels[:4], weights[:4])
    for one, other in zip(seen, bare, strict=True):
        np.testing.assert_allclose(both.log_odds(one), known.log_odds(one), atol=1e-9)
        np.testing.assert_allclose(both.log_odds(other), alone.log_odds(other.take(names)), atol=1e-9)
        added = contributions(both.trees, one.take(both.names).values)
        apart = contributions(known.trees, one.values)
        for name in set(known.names) - {KNOWS_SCANS}:
            np.testing.assert_allclose(
                added[:, both.names.index(name)], apart[:, known.names.index(name)], atol=1e-9, err_msg=name
            )


def test_evidence_is_one_more_node_feature():
    features = draw(4)
    columns = columns_of(features)
    assert with_evidence(features, None) is features
    names = tuple(name for name in columns.names[::-2] if name != LOW_RATIO)
    potential = draw_potential(np.random.default_rng(1), names)
    found = with_evidence(features, potential)
    assert found.node_names == (*NODE, EVIDENCE)
    np.testing.assert_array_equal(found.node[:, :-1], features.node)
    np.testing.assert_allclose(found.node[:, -1], slow_log_odds(potential, columns), atol=1e-12)


def grown(seed: int = 0):
    """Return trees of maps in which the measured disagreement tells, and copies do, at several tolerances."""
    maps = [(draw(10 * seed + number, 60, 90), tolerance) for number in range(8) for tolerance in (0.1, 0.2, 0.3)]
    labels = [np.where(each.disagreement[:, 1] > tolerance, 1.0, -1.0) for each, tolerance in maps]
    return grow([columns_of(*each) for each in maps], labels, [np.ones(60)] * len(maps))


def test_evidence_falls_as_the_tolerance_rises_and_never_with_what_scans_disagree_by():
    features, potential = draw(100, 80, 120), grown()
    falling = np.array([evidence_of(columns_of(features, t), potential) for t in np.geomspace(0.05, 0.8, 25)])
    assert (np.diff(falling, axis=0) <= 1e-12).all()
    assert (falling[0] - falling[-1]).max() > 3.0
    metres = [NODE.index(name) for name in ("disagreement_low", "disagreement", "disagreement_high")]
    before = evidence_of(columns_of(features, T), potential)
    for more in (0.02, 0.1, 0.3):
        apart = features._replace(node=features.node.copy())
        apart.node[:, metres] += more
        after = evidence_of(columns_of(apart, T), potential)
        assert (after >= before - 1e-12).all()
        before = after


def test_a_lower_bound_above_the_tolerance_decides():
    features = draw(5)
    columns = columns_of(features, T)
    potential = draw_potential(np.random.default_rng(1), columns.names)
    evidence, plain = evidence_of(columns, potential), potential.log_odds(columns)
    decided = features.disagreement[:, 0] > T
    assert 0 < decided.sum() < len(decided)
    np.testing.assert_array_equal(evidence[~decided], plain[~decided])
    np.testing.assert_array_equal(evidence[decided], np.maximum(plain[decided], DECISIVE))
    alone = without_scans(columns)
    np.testing.assert_array_equal(evidence_of(alone, potential), potential.log_odds(alone))


def test_importance_is_the_mean_that_a_column_moves():
    columns = [columns_of(draw(seed)) for seed in (1, 2)]
    potential = draw_potential(np.random.default_rng(1), columns[0].names)
    found = potential.importance(columns)
    assert tuple(found) == columns[0].names
    asked = {columns[0].names[place] for place in potential.trees.column if place >= 0}
    assert {name for name, moved in found.items() if moved > 0.0} <= asked
    both = Columns(columns[0].names, *(np.vstack([getattr(c, name) for c in columns]) for name in ("values", "other")))
    assert potential.importance([both]) == pytest.approx(found)


def test_a_column_that_features_lack_is_named():
    with pytest.raises(InputError, match="asks for colour"):
        columns_of(draw(1)).take(("fit", "colour"))
