from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io import is_patches, read_cloud, read_patches, write_cloud, write_patches
from mapq.io.journal import Event, Journal, fingerprint, journal_beside, replay
from mapq.io.results import SCHEMA, read_result_json, result_lines, stated_unit
from mapq.labels import FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.patches import Patches
from prf.shell.errors import InputError, OutputError
from tests.mapq.io.samples import patches, refusal, save
from tests.mapq.labelled import draw_patches

ARRAYS = ("patch", "normal", "centroid", "label", "label_source")


def check_equal(one: Patches, other: Patches) -> None:
    for name in ARRAYS:
        a, b = getattr(one, name), getattr(other, name)
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
        assert b.flags.writeable
        assert b.flags.c_contiguous
    assert (one.parameters, one.report) == (other.parameters, other.report)
    assert (one.cloud.source, one.cloud.coordinate_type) == (other.cloud.source, other.cloud.coordinate_type)
    assert one.cloud.xyz.tobytes() == other.cloud.xyz.tobytes()
    assert one.cloud.shift.tobytes() == other.cloud.shift.tobytes()
    assert list(one.cloud.fields) == list(other.cloud.fields)
    for name, values in one.cloud.fields.items():
        again = other.cloud.fields[name]
        assert (values.dtype, values.shape, values.tobytes()) == (again.dtype, again.shape, again.tobytes())


@pytest.mark.parametrize("n_patches", [0, 1, 3])
def test_round_trip_is_exact(tmp_path, n_patches):
    before = patches(n_patches=n_patches)
    write_patches(tmp_path / "a.patches", before)
    after = read_patches(tmp_path / "a.patches")
    check_equal(before, after)
    assert is_patches(tmp_path / "a.patches")
    write_patches(tmp_path / "b.patches", after)
    check_equal(before, read_patches(str(tmp_path / "b.patches")))


def test_numbers_that_json_lacks_become_null(tmp_path):
    before = replace(patches(), parameters={"a": np.float64(np.inf), "b": (1, np.int32(2)), "c": np.array([0.1])})
    write_patches(tmp_path / "a", before)
    assert read_patches(tmp_path / "a").parameters == {"a": None, "b": [1, 2], "c": [0.1]}


def test_a_plain_reader_needs_nothing_of_ours(tmp_path):
    before = patches()
    write_patches(tmp_path / "a.patches", before)
    with np.load(tmp_path / "a.patches", allow_pickle=False) as stored:
        assert str(stored["schema"]) == "mapq.patches/1"
        assert np.array_equal(stored["xyz"] + stored["shift"], before.cloud.world(), equal_nan=True)


def change(path, **replaced) -> str:
    """Write the file anew with arrays replaced, or left out (None)."""
    with np.load(path, allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files} | replaced
    np.savez(path.with_suffix(".npz"), **{name: values for name, values in arrays.items() if values is not None})
    return str(path.with_suffix(".npz"))


@pytest.mark.parametrize(
    ("replaced", "line"),
    [
        ({"schema": "mapq.patches/2"}, "version 2 of mapq.patches is not known"),
        ({"schema": "mapq.model/1"}, "schema mapq.model/1, expected mapq.patches/1"),
        ({"schema": None}, "no schema"),
        ({"xyz": None}, "array xyz is missing"),
        ({"xyz": np.zeros((60, 2))}, "array xyz has shape (60, 2)"),
        ({"patch": np.full(60, 3, np.int32)}, "patch numbers are not within -1 and 2"),
        ({"normal": np.zeros((2, 3))}, "array centroid has shape (3, 3), not (2, 3)"),
    ],
)
def test_what_contradicts_itself_is_refused(tmp_path, replaced, line):
    path = tmp_path / "a.patches"
    write_patches(path, patches())
    assert line in refusal(read_patches, change(path, **replaced))


def test_other_files_are_no_patches(tmp_path):
    for data in (b"", b"1 2 3\n", b"PK\x03\x04 and so on"):
        path = save(tmp_path, "a", data)
        assert not is_patches(path)
        refusal(read_patches, path)
    np.savez(tmp_path / "b.npz", xyz=np.zeros((3, 3)))
    assert not is_patches(tmp_path / "b.npz")
    np.savez(tmp_path / "b.npz", schema=np.array(["x"], dtype=object))
    assert not is_patches(tmp_path / "b.npz")
    assert not is_patches(tmp_path / "none")
    assert not is_patches(tmp_path)
    assert "no such file" in refusal(read_patches, tmp_path / "none")


def test_any_version_is_recognised(tmp_path):
    write_patches(tmp_path / "a.patches", patches())
    assert is_patches(change(tmp_path / "a.patches", schema="mapq.patches/77"))


def test_writing_is_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.patches"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_patches(path, replace(patches(), parameters={"a": object()}))
    assert path.read_text() == "old"
    with pytest.raises(OutputError):
        write_patches(tmp_path / "no" / "a.patches", patches())


def test_a_cloud_without_fields(tmp_path):
    cloud = PointCloud.from_world(np.zeros((4, 3), np.float32))
    none = np.empty((0, 3))
    before = Patches.unlabelled(cloud, np.full(4, -1, np.int32), none, none, {}, {})
    write_patches(tmp_path / "a", before)
    check_equal(before, read_patches(tmp_path / "a"))


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


HEAD = {"unit": "m", "regions": [{"patches": [0, 2]}], "note": 'a "patches": [ in a text'}
ROWS = [{"patch": number, "label": "plausible", "text": 'ends with "]}\n'} for number in range(3)]


def save_results(path, rows=ROWS):
    path.write_text("".join(result_lines(HEAD, rows)), encoding="utf-8")
    return path


@pytest.mark.parametrize("rows", [ROWS, ROWS[:1], []])
def test_what_was_written_is_read(tmp_path, rows):
    head, found = read_result_json(save_results(tmp_path / "r.json", rows))
    assert head == {"schema": SCHEMA, **HEAD}
    assert list(found) == rows


@pytest.mark.parametrize("name", ["r.ply", "r.las"])
def test_a_result_is_read_in_the_unit_in_which_it_was_classified(tmp_path, name):
    """Neither format of another cloud than LAS can say it."""
    world = np.array([[500_000.5, 2000.0, 30.0], [500_400.0, 2500.0, 90.0]])
    fields = {"patch": np.zeros(2, np.int32), "suspicious": np.zeros(2, np.uint8)}
    path = str(tmp_path / name)
    result = PointCloud.from_world(world, {**fields, "p_suspicious": np.zeros(2, np.float32)}, unit=0.01)
    write_cloud(path, result)
    assert read_cloud(path).unit.tolist() == [1, 1, 1]
    (tmp_path / "r.json").write_text("".join(result_lines({**HEAD, "cloud_unit": [0.01] * 3}, ROWS)))
    again = read_cloud(path)
    assert again.unit.tolist() == [0.01] * 3
    np.testing.assert_allclose(again.xyz, result.xyz, atol=1e-5)
    np.testing.assert_allclose(again.world(), world, atol=1e-3)
    assert read_cloud(path, ReadOptions(unit=0.5)).unit.tolist() == [0.5] * 3
    write_cloud(path, PointCloud.from_world(world, fields))  # no result
    assert read_cloud(path).unit.tolist() == [1, 1, 1]


def test_json_without_unit_or_unreadable_is_ignored(tmp_path):
    path = tmp_path / "r.json"
    path.write_text("".join(result_lines(HEAD, ROWS)))
    assert stated_unit(path) is None
    path.write_text("{damaged")
    assert stated_unit(path) is None
    assert stated_unit(tmp_path / "none.json") is None
    assert stated_unit(tmp_path / f"{251 * 'a'}.json") is None


@pytest.mark.parametrize("indent", [None, 1])
def test_json_that_was_laid_out_anew_is_read_too(tmp_path, indent):
    path = save_results(tmp_path / "r.json")
    path.write_text(json.dumps(json.loads(path.read_text()), indent=indent))
    head, found = read_result_json(path)
    assert head == {"schema": SCHEMA, **HEAD}
    assert list(found) == ROWS


def test_patches_are_read_one_by_one(tmp_path):
    path = save_results(tmp_path / "r.json")
    path.write_text(path.read_text().replace('"patch": 2', '"patch": '))
    _, found = read_result_json(path)
    assert next(found) == ROWS[0]
    assert next(found) == ROWS[1]
    with pytest.raises(InputError, match=r"r\.json:4: damaged"):
        next(found)


@pytest.mark.parametrize("cut", [3, 4, 30, 200])
def test_a_file_that_was_cut_off_is_refused(tmp_path, cut):
    path = save_results(tmp_path / "r.json")
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(InputError, match=r"r\.json(:\d+)?: damaged"):
        list(read_result_json(path)[1])


def test_what_is_no_result_is_refused(tmp_path):
    path = save_results(tmp_path / "r.json")
    path.write_text(path.read_text().replace(SCHEMA, "mapq.result/7"))
    with pytest.raises(InputError, match=r"version 7 of .* is not known"):
        read_result_json(path)
    path.write_text(json.dumps({"schema": SCHEMA}))
    with pytest.raises(InputError, match="'patches' is missing"):
        read_result_json(path)
    with pytest.raises(InputError, match="no such file"):
        read_result_json(tmp_path / "none.json")
