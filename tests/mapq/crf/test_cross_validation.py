"""Training with trees: the field weighs what they say of patches that they did not see."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.configuration import TrainSettings
from mapq.crf import classify
from mapq.crf.cross_validation import assign_folds, split_regions, train, with_trees
from mapq.crf.train import TrainingMap
from mapq.crf.trees import SURELY, columns_of, without_scans
from mapq.features.context import NODE_COLUMNS
from mapq.features.pairs import EDGE_NAMES
from mapq.features.shape import NODE_NAMES
from mapq.features.table import PatchFeatures
from mapq.labels import UNLABELLED
from mapq.model import EVIDENCE
from mapq.results.evaluate import area_under_curve
from tests.reference.mapq_crf import draw_pairs

NAMES = (*NODE_NAMES, *NODE_COLUMNS["moments"])
FOLDS = 3


@pytest.fixture(autouse=True)
def few_trees(monkeypatch):
    monkeypatch.setattr("mapq.crf.trees.N_TREES", 12)


def draw_map(seed: int, signal: float = 0.0, n_patches: int = 150, scans: bool = True) -> TrainingMap:
    """Return a map with labels by chance, and of disagreement that goes with them as far as the signal says."""
    rng = np.random.default_rng(seed)
    pairs = draw_pairs(rng, n_patches, 2 * n_patches)
    label = (rng.random(n_patches) < 0.4).astype(np.uint8)
    node = rng.normal(size=(n_patches, len(NAMES)))
    node[:, len(NODE_NAMES)] += signal * label
    # Bounds so wide that they decide nothing.
    node[:, len(NODE_NAMES) + 1] = 0.0
    node[:, len(NODE_NAMES) + 2] = 9.0
    if not scans:
        node[:, len(NODE_NAMES) :] = np.nan
    edge, x = rng.uniform(size=(len(pairs), len(EDGE_NAMES))), rng.uniform(-1.0, 1.0, len(pairs))
    features = PatchFeatures(node, pairs, edge, x, NAMES, EDGE_NAMES)
    return TrainingMap(features, label, split_regions(rng.uniform(0.0, 100.0, (n_patches, 3)), 20))


def told(maps: list[TrainingMap]):
    """Return the evidence of each source of training, its folds, and the trees."""
    folds = [[np.arange(len(each.label)) % FOLDS == k for each in maps] for k in range(FOLDS)]
    columns = [columns_of(each.features) for each in maps]
    sources, masks, potential = with_trees(maps, columns, folds, TrainSettings())
    assert all(each.features.node_names[-1] == EVIDENCE for each in sources)
    return sources, masks, potential


def area(sources: list[TrainingMap], evidence: list[np.ndarray]) -> float:
    return area_under_curve(np.concatenate(evidence), np.concatenate([each.label for each in sources]) == 1)


@pytest.mark.slow
def test_evidence_of_chance_is_chance(monkeypatch):
    """Trees know the labels of their own training patches by heart: it would be all but sure in-sample."""
    monkeypatch.setattr("mapq.crf.trees.N_TREES", 60)
    maps = [draw_map(seed) for seed in range(4)]
    sources, _, potential = told(maps)
    assert area(sources, [each.features.node[:, -1] for each in sources]) == pytest.approx(0.5, abs=0.06)
    in_sample = [potential.log_odds(columns_of(each.features)) for each in maps]
    assert area(maps, in_sample) > 0.7


def test_a_patch_is_judged_by_trees_that_saw_none_of_its_fold():
    """Its label does not matter to its own evidence, nor the labels of its fold, whatever they are."""
    maps = [draw_map(seed, 1.0) for seed in (1, 2)]
    fold = np.arange(len(maps[0].label)) % FOLDS == 1
    other = maps[0]._replace(label=np.where(fold, 1 - maps[0].label, maps[0].label).astype(np.uint8))
    # As many of each label as before: the weights of both labels are those of all maps.
    other.label[fold] = np.random.default_rng(0).permutation(maps[0].label[fold])
    one, two = (told([first, maps[1]])[0][0].features.node[:, -1] for first in (maps[0], other))
    np.testing.assert_array_equal(one[fold], two[fold])
    assert np.abs(one - two)[~fold].max() > 0.01


def test_maps_with_scans_count_twice_the_second_time_without():
    maps = [draw_map(1, 2.0), draw_map(2, 2.0, scans=False)]
    sources, masks, potential = told(maps)
    assert [len(each.label) for each in sources] == [150] * 3
    assert [len(mask) for mask in masks] == [3] * FOLDS
    assert sources[2].label is maps[0].label
    close = maps[0]._replace(between=np.arange(150) < 30)
    (_, _, alone), parted, _ = told([close, maps[1]])
    assert (alone.label[:30] == UNLABELLED).all()
    np.testing.assert_array_equal(alone.label[30:], maps[0].label[30:])
    assert not any(mask[2][:30].any() for mask in parted)
    # Trees learn from them all the same.
    np.testing.assert_array_equal(alone.features.node[:, -1], sources[2].features.node[:, -1])
    # The patches that no fold left out are judged by the trees of all.
    bare = without_scans(columns_of(maps[0].features))
    folds = [[np.zeros(150, bool)] * 2]
    alone = with_trees(maps, [columns_of(each.features) for each in maps], folds, TrainSettings())[0]
    np.testing.assert_array_equal(alone[2].features.node[:, -1], potential.log_odds(bare))
    assert area([sources[0]], [sources[0].features.node[:, -1]]) > 0.8
    assert area([sources[2]], [sources[2].features.node[:, -1]]) < 0.7


def test_what_has_no_label_is_judged_by_the_trees_of_all():
    maps = [draw_map(1, 1.0)]
    label = maps[0].label.copy()
    label[::5] = UNLABELLED
    maps = [maps[0]._replace(label=label)]
    columns = [columns_of(maps[0].features)]
    folds = [[(np.arange(150) % FOLDS == k) & (label != UNLABELLED)] for k in range(FOLDS)]
    sources, _, potential = with_trees(maps, columns, folds, TrainSettings())
    np.testing.assert_array_equal(sources[0].features.node[::5, -1], potential.log_odds(columns[0])[::5])


def test_a_trained_field_finds_what_trees_tell_and_knows_how_well():
    maps = [draw_map(seed, 2.0) for seed in (1, 2)]
    trained = train(maps, TrainSettings(folds=2, regularisation=1.0, coupling_regularisation=300.0))
    other = draw_map(3, 2.0)
    assert area_under_curve(classify(other.features, trained.model).difference, other.label == 1) > 0.85
    assert len(trained.held_out.truth) == 4 * 150, "twice, with scans and without"
    assert 0.65 < area_under_curve(trained.held_out.probability, trained.held_out.truth == 1) < 0.9
    assert trained.model.node.names == (EVIDENCE,)
    assert max(trained.importance, key=trained.importance.get) in ("disagreement_ratio", SURELY)


def test_regions_are_small_enough_alike_and_whole_boxes():
    rng = np.random.default_rng(0)
    centroid = rng.uniform(0, [200.0, 50.0, 10.0], (500, 3))
    region = split_regions(centroid, 40)
    sizes = np.bincount(region)
    assert sizes.max() <= 40
    assert sizes.min() >= sizes.max() // 2
    boxes = [(centroid[region == r, :2].min(axis=0), centroid[region == r, :2].max(axis=0)) for r in range(len(sizes))]
    for index, (low, high) in enumerate(boxes):
        inside = ((centroid[:, :2] > low) & (centroid[:, :2] < high)).all(axis=1)
        assert (region[inside] == index).all()


def test_patches_at_one_place_are_split_too():
    assert np.bincount(split_regions(np.zeros((10, 3)), 3)).max() <= 3


def test_folds_keep_regions_whole_and_share_suspicious_patches():
    rng = np.random.default_rng(1)
    region = np.repeat(np.arange(20), 15)
    suspicious = rng.random(300) < np.repeat(rng.random(20), 15)
    fold = assign_folds(region, suspicious, 5)
    assert set(fold) == set(range(5))
    assert all(len(np.unique(fold[region == r])) == 1 for r in range(20))
    counts = np.bincount(fold[suspicious])
    assert counts.max() - counts.min() <= 15


def test_no_more_folds_than_regions():
    assert set(assign_folds(np.array([0, 0, 1]), np.array([True, False, True]), 5)) == {0, 1}
    assert len(assign_folds(np.empty(0, int), np.empty(0, bool), 5)) == 0


def test_regions_of_one_label_are_dealt_over_folds_too():
    region = np.repeat(np.arange(8), 8)
    suspicious = region % 2 == 0
    fold = assign_folds(region, suspicious, 4)
    for index in range(4):
        assert suspicious[fold == index].mean() == 0.5
