from __future__ import annotations

import io
import sys

import numpy as np
import pytest

from mapq.io import read_cloud, write_ply
from mapq.render.colours import label_colours, patch_colours
from mapq.render.source import Picture, read_picture
from mapq.render.terminal import picture_lines
from prf.shell.terminal import Screen
from tests.cli.mapq_samples import call, save_cloud, save_model, save_patches


@pytest.fixture
def result(capsys, tmp_path):
    target = tmp_path / "r.ply"
    assert call(capsys, "classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", target)[0] == 0
    return target


def test_a_result_in_its_words(capsys, result, tmp_path):
    code, out, _ = call(capsys, "render", result, "-o", tmp_path / "r.png", "--view", "plan")
    assert (code, out) == (0, "")
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    assert read_picture(str(result)).subtitle.endswith("32 patches  ·  16 suspicious")


def test_a_part_of_a_result_counts_the_patches_in_it(result):
    cloud = read_cloud(str(result))
    write_ply(result, cloud.take(np.flatnonzero(cloud.fields["patch"] == 31)))
    assert "1 patches" in read_picture(str(result)).subtitle


@pytest.mark.parametrize("value", [np.nan, np.inf, -7.0, 1e30])
def test_fields_that_are_no_patches_or_labels_are_none(result, value):
    cloud = read_cloud(str(result))
    strange = np.full(len(cloud), value)
    write_ply(result, cloud.with_fields(patch=strange, suspicious=strange))
    assert "0 patches" in read_picture(str(result)).subtitle


def test_patches_come_through_a_pipe(monkeypatch, tmp_path):
    data = save_patches(tmp_path).read_bytes()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    assert "32 patches" in read_picture("-").subtitle


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--azimuth", "nan"], 2, "--azimuth"),
        (["--colour", "field"], 2, "--field"),
        (["--colour", "field", "--field", "nope"], 3, "no point field 'nope'"),
        (["--colour", "probability"], 3, "p_suspicious"),
        (["-o", "x.bmp"], 2, "no picture format"),
    ],
)
def test_mistakes_are_one_line(capsys, tmp_path, monkeypatch, options, code, message):
    monkeypatch.chdir(tmp_path)
    found, out, err = call(capsys, "render", save_cloud(tmp_path), *options)
    assert (found, out, err.count("\n")) == (code, "", 1)
    assert message in err


def test_in_a_pipe_the_plan_view_is_plain_characters(capsys, result):
    code, out, err = call(capsys, "render", result, "--terminal", "--width", 60)
    assert (code, err) == (0, "")
    assert out.isascii()
    lines = out.splitlines()
    assert lines[0] == "Plausible and suspicious patches"
    assert lines[-1].endswith("o plausible   # suspicious   . no patch")
    assert max(map(len, lines)) <= 60
    drawn = "".join(lines[2:-1])
    assert drawn.count("o") > 10
    assert drawn.count("#") > 10
    code, out, _ = call(capsys, "render", result, "--terminal", "--view", "3d", "--title", "Here")
    assert (code, out.splitlines()[0]) == (0, "Here")


@pytest.mark.parametrize("options", [["--terminal", "-o", "x.png"], ["--terminal", "-f"], ["--width", "50"]])
def test_terminal_and_file_do_not_go_together(capsys, result, options):
    code, out, err = call(capsys, "render", result, *options)
    assert (code, out, err.count("\n")) == (2, "", 1)


def test_a_suspicious_point_is_seen_over_plausible_ones():
    """And a point that has no finite place is none."""
    xyz = np.array([[0.0, 0.0, 0.0], [10.0, 4.0, 0.0], [10.0, 4.0, 1.0], [10.0, 4.0, 2.0], [5.0, 2.0, np.nan]])
    label, patch = np.array([0, 1, 0, 255, 1], np.uint8), np.array([0, 1, 2, -1, 3], np.int32)
    picture = Picture(xyz, label_colours(label, patch), "T", "S")
    screen = Screen(11, None, None, blocks=False, braille=False)
    lines = [line.plain for line in picture_lines(picture, screen)][2:5]
    assert "".join(lines).replace(" ", "") in ("#o", "o#")
    assert lines[0].rstrip().endswith("#")
    coloured = picture_lines(picture, screen._replace(colours="truecolor", blocks=True))
    colours = {colour.triplet.hex for line in coloured for span in line.spans if hasattr(span.style, "color")
               for colour in (span.style.color, span.style.bgcolor) if colour is not None}  # fmt: skip
    assert colours == {"#ffffff", "#1a5cb8", "#d61a1c"}


def test_each_patch_has_a_letter_where_there_are_no_colours():
    xyz = np.column_stack((np.arange(12.0), np.zeros(12), np.zeros(12)))
    patch = np.repeat(np.array([-1, 0, 1, 2], np.int32), 3)
    picture = Picture(xyz, patch_colours(patch), "T", "S")
    lines = [line.plain for line in picture_lines(picture, Screen(12, None, None, False, False))]
    drawn = "".join(lines[2:-2]).replace(" ", "")
    assert drawn.count(".") == 3
    assert len(set(drawn)) == 4
    assert lines[-1] == ". no patch"


def test_a_cloud_without_a_finite_point_is_an_empty_picture():
    picture = Picture(np.full((2, 3), np.nan), patch_colours(np.zeros(2, np.int32)), "T", "S")
    lines = [line.plain for line in picture_lines(picture, Screen(12, None, None, False, False))]
    assert not "".join(lines[2:8]).strip()
