from __future__ import annotations

import pytest

from tests.cli.mapq_samples import call, save_model, save_patches


@pytest.fixture
def result(capsys, tmp_path):
    target = tmp_path / "r.ply"
    assert call(capsys, "classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", target)[0] == 0
    return target


def test_a_page_of_its_own(capsys, result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = call(capsys, "report", result, "--title", "Ours & <yours>")
    assert (code, out) == (0, "")
    page = result.with_suffix(".html").read_text()
    assert f"wrote {result.with_suffix('.html')}" in err
    assert "<h1>Ours &amp; &lt;yours&gt;</h1>" in page
    assert call(capsys, "report", result)[0] == 4
    assert call(capsys, "report", result, "-f")[0] == 0


def test_fewer_points_are_reported(capsys, result, tmp_path):
    _, _, err = call(capsys, "report", result, "--max-points", 1000, "-o", tmp_path / "x.html")
    shown = int(err.partition("views show ")[2].partition(" of ")[0].replace(",", ""))
    assert shown <= 1000
    assert f"{shown:,} of 7,680 points shown" in (tmp_path / "x.html").read_text()


def test_the_json_of_another_result_is_refused(capsys, result, tmp_path):
    """Of the same patches with other labels, as a process leaves it that is killed between the two files."""
    beside = result.with_suffix(".json")
    text = beside.read_text()
    assert '"label": "plausible"' in text
    beside.write_text(text.replace('"label": "plausible"', '"label": "suspicious"', 1))
    code, out, err = call(capsys, "report", result, "-o", tmp_path / "x.html")
    assert (code, out, err.count("\n")) == (3, "", 1)
    assert "which has other labels" in err
