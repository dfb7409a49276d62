"""A result in tiles is read like one cloud with a JSON beside it: report, picture, scores, comparison, summary."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.configuration import Configuration, ReadOptions
from mapq.io import read_cloud, write_cloud
from mapq.io.describe import describe
from mapq.io.tiles import open_result_folder, steps_of, thinned_by_patch
from mapq.report.drawing import read_picture
from mapq.report.findings import read_findings
from mapq.report.page import write_report
from mapq.results.compare import compare
from mapq.results.evaluate import read_labelled, score_labels
from mapq.results.judged import read_judged
from mapq.simulate.city import ORIGIN, PITCH, make_block
from mapq.tiled.run import classify_map
from prf.shell.errors import InputError


@pytest.fixture(scope="module")
def results(tmp_path_factory, model) -> tuple[str, str]:
    """Half a block in two tiles: its result as a folder, and as one cloud."""
    folder = tmp_path_factory.mktemp("block")
    tiles = folder / "tiles"
    tiles.mkdir()
    block = make_block(5, 0, 0, 0)
    north = block.xyz[:, 1] > 0.5 * PITCH[1]
    west = block.xyz[:, 0] < 0.45 * PITCH[0]
    for name, some in (("a", north & west), ("b", north & ~west)):
        part = block.take(some)
        write_cloud(tiles / f"{name}.laz", PointCloud.from_world(part.xyz + ORIGIN, {"truth": part.truth}))
    targets = str(folder / "result"), str(folder / "result.laz")
    for target in targets:
        classify_map(str(tiles), target, model, Configuration(), False)
    return targets


@pytest.mark.slow
def test_scores_are_those_of_one_cloud(results, monkeypatch):
    monkeypatch.setattr("mapq.io.las.PIECE", 10_000)
    mine, theirs = (read_labelled(path, None, None) for path in results)
    np.testing.assert_array_equal(mine.label, theirs.label)
    np.testing.assert_array_equal(mine.truth, theirs.truth)
    assert score_labels(*mine[:3]) == score_labels(*theirs[:3])
    assert mine.truth_from == theirs.truth_from


def test_a_report_tells_of_all_patches_and_shows_some_of_the_points(results, tmp_path, monkeypatch):
    whole = read_findings(results[1])
    monkeypatch.setattr("mapq.report.findings.MAX_READ", 8_000)
    told = read_findings(results[0])
    assert told.rows == whole.rows
    assert told.n_points == whole.n_points == len(whole.cloud)
    assert 5_000 < len(told.cloud) < 10_000
    assert set(told.patch) == set(whole.patch)
    assert write_report(str(tmp_path / "report.html"), told, max_points=4_000)[1] <= 4_000
    page = (tmp_path / "report.html").read_text()
    assert f"of {len(whole.cloud):,} points shown" in page
    share = (whole.patch >= 0).mean()
    assert f"<dt>points</dt><dd>{len(whole.cloud):,}, {100.0 * share:.1f} % of them in judged patches" in page


def test_small_patches_stay_whole_and_large_ones_are_thinned(results):
    folder = open_result_folder(results[0])
    patch = read_cloud(results[1]).fields["patch"]
    counts = np.bincount(patch[patch >= 0])
    found = thinned_by_patch(folder, counts, 6_000).fields["patch"]
    kept = np.bincount(found[found >= 0], minlength=len(counts))
    step = steps_of(counts, 6_000 - 1_500)
    np.testing.assert_array_equal(kept, -(-counts // step))
    assert (step == 1).any()
    assert (step > 1).any()
    assert steps_of(counts, int(counts.sum())).max() == 1


def test_a_picture_has_the_words_of_the_whole(results, monkeypatch):
    whole = read_picture(results[1])
    assert read_picture(results[0]).subtitle.partition("·")[2] == whole.subtitle.partition("·")[2]
    monkeypatch.setattr("mapq.report.drawing.MOST_DRAWN", 5_000)
    some = read_picture(results[0])
    n_points = len(whole.xyz)
    assert len(some.xyz) <= 5_000
    assert f"{len(some.xyz):,} of {n_points:,} points" in some.subtitle
    assert some.subtitle.split("·")[2:] == whole.subtitle.split("·")[2:]


def test_a_comparison_finds_no_difference_to_one_cloud(results):
    folder, cloud = (read_judged(path, None, cell=5.0) for path in results)
    found = compare(folder, cloud, 5.0)
    np.testing.assert_allclose(found.area[0], found.area[1])
    np.testing.assert_allclose(found.expected[0], found.expected[1])
    np.testing.assert_allclose(found.covered, 1.0, atol=0.01)
    assert found.better == "same"
    assert not found.places


def test_its_summary_is_that_of_one_cloud(results, monkeypatch):
    monkeypatch.setattr("mapq.io.las.PIECE", 10_000)
    mine, theirs = (describe(path) for path in results)
    assert (mine["kind"], mine["format"]) == ("result", "2 tiles")
    assert mine["patches"] == theirs["patches"]
    assert mine["cloud"]["n_points"] == theirs["cloud"]["n_points"]
    np.testing.assert_allclose(mine["cloud"]["low"], theirs["cloud"]["low"])
    known = {field["name"]: field for field in theirs["cloud"]["fields"]}
    assert all(field == known[field["name"]] for field in mine["cloud"]["fields"])
    assert np.isnan(mine["cloud"]["spacing"])
    assert mine["content"]["counts"] == theirs["content"]["counts"]


def test_it_is_read_in_the_unit_in_which_it_was_classified(results, tmp_path):
    folder = tmp_path / "feet"
    shutil.copytree(results[0], folder)
    told = (folder / "result.json").read_text()
    assert '"cloud_unit": [1.0, 1.0, 1.0]' in told
    (folder / "result.json").write_text(told.replace("[1.0, 1.0, 1.0]", "[0.3048, 0.3048, 0.3048]", 1))
    found, plain = open_result_folder(str(folder)), open_result_folder(results[0])
    assert [head.unit.tolist() for head in found.heads] == [[0.3048] * 3] * 2
    (_, here), (_, there) = next(found.pieces(())), next(plain.pieces(()))
    np.testing.assert_allclose(here.xyz, 0.3048 * there.xyz)
    assert open_result_folder(str(folder), ReadOptions(unit=1.0)).heads[0].unit.tolist() == [1.0] * 3


class TestBroken:
    def copied(self, results, tmp_path) -> Path:
        return Path(shutil.copytree(results[0], tmp_path / "copy"))

    def test_the_json_of_another(self, results, tmp_path):
        folder = self.copied(results, tmp_path)
        lines = (folder / "result.json").read_text().splitlines()
        head = json.loads(lines[0] + "]}")
        head["counts"]["n_patches"] = head["counts"]["n_suspicious"] = 1
        fewer = json.dumps(head).removesuffix("]}")
        (folder / "result.json").write_text("\n".join([fewer, lines[1].removesuffix(","), "]}", ""]))
        for reader in (read_findings, describe, lambda path: read_judged(path, None)):
            with pytest.raises(InputError, match="not the JSON of"):
                reader(str(folder))
