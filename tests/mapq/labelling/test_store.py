from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.io import read_patches, write_patches
from mapq.io.journal import journal_beside
from mapq.labelling import open_store
from mapq.labelling.page import most_uncertain_first
from mapq.labelling.store import relabel
from mapq.labels import FROM_FIELD, FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from prf.shell.errors import InputError, OutputError
from tests.mapq.labelled import draw_patches


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "a.patches"
    write_patches(path, draw_patches(1, labelled=False))
    return path


def test_labels_end_up_in_the_file_and_nothing_else_is_left(saved):
    with open_store(str(saved)) as store:
        store.set(3, SUSPICIOUS)
        store.set(4, UNLABELLED)
        assert store.counts() == {
            "n_patches": 32,
            "n_by_hand": 2,
            "n_plausible": 0,
            "n_suspicious": 1,
            "n_unsure": 1,
            "n_from_field": 0,
        }
        store.merge()
    assert list(saved.parent.iterdir()) == [saved]
    found = read_patches(saved)
    assert (found.label[3], found.label_source[3]) == (SUSPICIOUS, FROM_HAND)
    assert (found.label[4], found.label_source[4]) == (UNLABELLED, FROM_HAND)
    np.testing.assert_array_equal(found.cloud.xyz, draw_patches(1).cloud.xyz)


def test_without_a_label_the_file_is_not_touched(saved):
    before = saved.stat().st_mtime_ns
    with open_store(str(saved)) as store:
        store.merge()
    assert saved.stat().st_mtime_ns == before


def test_an_unmerged_session_is_resumed_and_can_be_undone(saved):
    with open_store(str(saved)) as store:
        store.set(3, SUSPICIOUS)
        store.set(4, PLAUSIBLE)
    with open_store(str(saved)) as store:
        assert store.n_recovered == 2
        assert store.undo() == 4
        assert store.undo() == 3
        assert store.undo() is None
        store.set(5, PLAUSIBLE)
        store.merge()
    assert np.flatnonzero(read_patches(saved).label_source).tolist() == [5]


def test_a_label_taken_back_is_the_one_of_the_field_again(saved):
    write_patches(saved, draw_patches(1))
    with open_store(str(saved)) as store:
        store.set(3, UNLABELLED)
        assert store.counts()["n_from_field"] == 31
        store.undo()
        assert store.source[3] == FROM_FIELD
        assert store.counts()["n_by_hand"] == 0


def test_one_writer_at_a_time(saved):
    with open_store(str(saved)):
        with pytest.raises(OutputError, match="another process"), open_store(str(saved)):
            pass
        with pytest.raises(OutputError, match="another process"):
            relabel(str(saved), lambda patches: (patches, None))


def test_after_the_merge_nothing_is_taken(saved):
    with open_store(str(saved)) as store:
        store.merge()
        with pytest.raises(OutputError, match="has ended"):
            store.set(1, PLAUSIBLE)


def test_a_file_written_meanwhile_keeps_what_it_got(saved):
    with open_store(str(saved)) as store:
        store.set(3, SUSPICIOUS)
        patches = draw_patches(1)
        write_patches(saved, replace(patches, report={"by": "somebody else"}))
        store.merge()
    found = read_patches(saved)
    assert found.report == {"by": "somebody else"}
    assert (found.label[3], found.label_source[3], found.label_source[2]) == (SUSPICIOUS, FROM_HAND, FROM_FIELD)


def test_labels_stay_in_the_journal_where_the_file_now_holds_other_patches(saved):
    with open_store(str(saved)) as store:
        store.set(3, SUSPICIOUS)
        write_patches(saved, draw_patches(2, n_walls=12))
        with pytest.raises(OutputError, match="replaced by other patches"):
            store.merge()
    assert len(read_patches(saved)) == 16
    assert journal_beside(saved).exists()


def test_a_rule_takes_the_labels_of_the_journal_with_it(saved):
    with open_store(str(saved)) as store:
        store.set(3, SUSPICIOUS)
    assert relabel(str(saved), lambda patches: (patches, patches.label[3])) == SUSPICIOUS
    assert not journal_beside(saved).exists()
    assert read_patches(saved).label[3] == SUSPICIOUS


def test_a_missing_file_leaves_nothing_behind(tmp_path):
    with pytest.raises(InputError), open_store(str(tmp_path / "folder" / "a.patches")):
        pass
    assert list(tmp_path.iterdir()) == []


def test_the_most_uncertain_first_of_equals_the_largest_and_labelled_ones_last():
    p = np.array([0.9, 0.55, 0.45, 0.5, 0.1])
    label = np.array([False, False, False, True, False])
    assert most_uncertain_first(np.array([9, 2, 4, 7, 30]), p, label).tolist() == [2, 1, 4, 0, 3]


def test_without_probabilities_the_largest_first():
    assert most_uncertain_first(np.array([3, 9, 5]), None, np.zeros(3, np.bool_)).tolist() == [1, 2, 0]


def test_a_probability_that_does_not_exist_is_as_uncertain_as_can_be():
    assert most_uncertain_first(np.array([3, 9]), np.array([np.nan, 0.4]), np.zeros(2, np.bool_)).tolist() == [0, 1]
