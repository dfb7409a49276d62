from __future__ import annotations

import json

import numpy as np
import pytest

from mapq.io import read_patches, write_patches
from mapq.io.journal import Event, Journal, fingerprint, journal_beside, replay
from mapq.labels import FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from prf.shell.errors import InputError, OutputError
from tests.mapq.labelled import draw_patches


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "a.patches"
    write_patches(path, draw_patches(1, labelled=False))
    return path


def add(path, *events):
    journal = Journal(path, draw_patches(1, labelled=False))
    for event in events:
        journal.add(event)
    return journal


def test_labels_of_the_journal_are_read_with_the_patches(saved):
    add(saved, Event(3, SUSPICIOUS), Event(5, PLAUSIBLE), Event(7, UNLABELLED))
    found = read_patches(saved)
    assert found.label[[3, 5, 7]].tolist() == [SUSPICIOUS, PLAUSIBLE, UNLABELLED]
    assert found.label_source[[3, 5, 7]].tolist() == [FROM_HAND] * 3
    assert np.count_nonzero(found.label_source) == 3


def test_taking_back_gives_what_was_before(saved):
    patches = draw_patches(1)
    found = replay(
        patches, [Event(3, SUSPICIOUS), Event(3, PLAUSIBLE), Event(4, UNLABELLED), Event(4, None), Event(3, None)]
    )
    assert found.label[3] == SUSPICIOUS
    assert found.source[3] == FROM_HAND
    assert (found.label[4], found.source[4]) == (patches.label[4], patches.label_source[4])
    assert [patch for patch, _, _ in found.undoable] == [3]
    found.apply(Event(3, None))
    found.apply(Event(3, None))
    np.testing.assert_array_equal(found.label, patches.label)


def test_a_journal_merged_twice_changes_nothing(saved):
    """A program that is killed between writing PATCHES and removing the journal leaves both."""
    events = [Event(3, SUSPICIOUS), Event(4, PLAUSIBLE), Event(4, None), Event(5, PLAUSIBLE), Event(3, PLAUSIBLE)]
    once = replay(draw_patches(1), events)
    patches = draw_patches(1)
    patches.label[:], patches.label_source[:] = once.label, once.source
    twice = replay(patches, events)
    np.testing.assert_array_equal(twice.label, once.label)
    np.testing.assert_array_equal(twice.source, once.source)


@pytest.mark.parametrize("n_bytes", [1, 20, 60])
def test_a_last_line_that_is_cut_off_does_not_count(saved, n_bytes):
    journal = add(saved, Event(3, SUSPICIOUS), Event(5, PLAUSIBLE))
    content = journal.file.read_bytes()
    journal.file.write_bytes(content[:-n_bytes])
    assert read_patches(saved).label[[3, 5]].tolist() == [SUSPICIOUS, UNLABELLED]
    again = add(saved, Event(6, PLAUSIBLE))
    assert [event.patch for event in again.events] == [3, 6]
    assert read_patches(saved).label[[3, 5, 6]].tolist() == [SUSPICIOUS, UNLABELLED, PLAUSIBLE]


def test_an_empty_journal_changes_nothing(saved):
    journal_beside(saved).write_text('{"schema": "mapq.la')
    assert (read_patches(saved).label == UNLABELLED).all()
    add(saved, Event(6, PLAUSIBLE))
    assert read_patches(saved).label[6] == PLAUSIBLE


def test_labels_of_other_patches_are_left_alone_with_a_warning(saved, caplog):
    add(saved, Event(3, SUSPICIOUS))
    write_patches(saved, draw_patches(2, n_walls=12, labelled=False))
    assert (read_patches(saved).label == UNLABELLED).all()
    assert "belongs to other patches" in caplog.text
    with pytest.raises(InputError, match="Move it out of the way"):
        Journal(saved, draw_patches(2, n_walls=12))
    assert journal_beside(saved).exists()


@pytest.mark.parametrize(
    "line",
    [
        '{"patch": -1, "label": "plausible"}',
        *("{", "[]", "{}", '{"patch": 1, "label": "odd"}', '{"patch": 99, "label": "plausible"}'),
    ],
)
def test_a_damaged_journal_is_refused(saved, line):
    journal = add(saved, Event(3, SUSPICIOUS))
    with journal.file.open("a") as stream:
        stream.write(line + "\n")
    with pytest.raises(InputError, match=r"labels\.jsonl(:\d+)?: damaged"):
        read_patches(saved)


def test_another_version_is_refused(saved):
    journal_beside(saved).write_text('{"schema": "mapq.labels/9"}\n')
    with pytest.raises(InputError, match="version 9"):
        read_patches(saved)


def test_what_cannot_be_written_does_not_count(saved, monkeypatch):
    journal = add(saved, Event(3, SUSPICIOUS))
    before = journal.file.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="no space left"):
        journal.add(Event(4, SUSPICIOUS))
    assert journal.file.read_bytes() == before
    assert len(journal.events) == 1


def test_the_fingerprint_is_of_the_patches_alone():
    assert fingerprint(draw_patches(1)) != fingerprint(draw_patches(2)), "as many points in each, elsewhere"
    patches = draw_patches(1)
    mark = fingerprint(patches)
    patches.label[:] = UNLABELLED
    assert fingerprint(patches) == mark
    patches.patch[0] = 5
    assert fingerprint(patches) != mark


def test_lines_are_json_with_their_time(saved):
    lines = add(saved, Event(3, SUSPICIOUS), Event(3, None)).file.read_text().splitlines()
    head, first, second = map(json.loads, lines)
    assert (head["schema"], head["patches"], head["n_patches"]) == ("mapq.labels/1", "a.patches", 32)
    assert (first["patch"], first["label"], second["undo"]) == (3, "suspicious", True)
    assert first["time"].endswith("+00:00")
