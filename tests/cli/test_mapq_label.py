from __future__ import annotations

import numpy as np
import pytest

from mapq.io import read_patches, write_patches
from tests.cli.mapq_samples import call, call_json, save_patches
from tests.mapq.labelled import draw_patches


def test_labels_are_stored_in_the_file_itself_without_force(capsys, tmp_path):
    path = save_patches(tmp_path, labelled=False)
    code, out, err = call(capsys, "label", path, "--from-field", "truth")
    assert (code, err) == (0, "")
    assert ["suspicious", "16"] in [line.split() for line in out.splitlines()]
    found = read_patches(path)
    np.testing.assert_array_equal(found.label, draw_patches(1).label)
    np.testing.assert_array_equal(found.cloud.fields["intensity"], draw_patches(1).cloud.fields["intensity"])
    assert list(tmp_path.iterdir()) == [path]


def test_labels_by_hand_are_kept_unless_forced(capsys, tmp_path):
    path = tmp_path / "a.patches"
    patches = draw_patches(1)
    patches.label[0], patches.label_source[0] = 1, 2
    write_patches(path, patches)
    result = call_json(capsys, "label", path, "--from-field", "truth")
    assert (result["schema"], result["n_kept"], result["n_suspicious"]) == ("mapq.label/1", 1, 17)
    assert "set by hand     1, kept" in call(capsys, "label", path, "--from-field", "truth")[1]
    assert call_json(capsys, "label", path, "--from-field", "truth", "-f")["n_suspicious"] == 16


def test_without_a_field_it_asks_for_one(capsys, tmp_path):
    code, out, err = call(capsys, "label", save_patches(tmp_path))
    assert (code, out) == (2, "")
    assert "--from-field" in err


@pytest.mark.parametrize(("field", "message"), [("wrong", "no point field wrong"), ("intensity", "neither 0 nor 1")])
def test_a_field_that_is_no_label_changes_nothing(capsys, tmp_path, field, message):
    path = save_patches(tmp_path)
    before = path.read_bytes()
    code, out, err = call(capsys, "label", path, "--from-field", field)
    assert (code, out, err.count("\n")) == (3, "", 1)
    assert message in err
    assert str(path) in err
    assert path.read_bytes() == before


def test_standard_input_has_no_place_for_labels(capsys):
    code, _, err = call(capsys, "label", "-", "--from-field", "truth")
    assert (code, err.count("\n")) == (2, 1)
