from __future__ import annotations

import csv
import io
import json

import pytest

from mapq.features import FeatureSettings, patch_features
from mapq.io import write_patches
from tests.cli.mapq_samples import call
from tests.mapq.factories import make_patches, sample_patches, wall

CORNER = [wall((-5, 0), (5, 0)), wall((-5, 0.3), (5, 0.3)), wall((5, 0), (5, 8))]


@pytest.fixture
def path(tmp_path) -> str:
    write_patches(tmp_path / "map.patches", sample_patches(CORNER, density=10))
    return str(tmp_path / "map.patches")


def run(capsys, *args: str) -> tuple[int, str, str]:
    return call(capsys, "features", *args)


def test_json_holds_every_patch_and_pair(capsys, path):
    code, out, err = run(capsys, path, "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    expected = patch_features(sample_patches(CORNER, density=10))
    assert result["schema"] == "mapq.features/1"
    assert (result["n_patches"], result["n_pairs"], result["n_clipped"]) == (3, 3, 0)
    assert [row["fit"] for row in result["nodes"]] == expected.node[:, 0].tolist()
    assert [row["plausibility"] for row in result["edges"]] == expected.plausibility.tolist()
    assert [[row["i"], row["j"]] for row in result["edges"]] == expected.pairs.tolist()
    for part in ("nodes", "edges"):
        assert list(result["units"][part]) == list(result[part][0])
    assert result["parameters"]["radius"] == 3.0


def test_csv_has_a_block_for_each(capsys, path):
    code, out, err = run(capsys, path, "--csv")
    assert (code, err) == (0, "")
    nodes, edges = (list(csv.DictReader(io.StringIO(block))) for block in out.split("\n\n"))
    assert [row["patch"] for row in nodes] == ["0", "1", "2"]
    assert [(row["i"], row["j"]) for row in edges] == [("0", "1"), ("0", "2"), ("1", "2")]
    expected = patch_features(sample_patches(CORNER, density=10))
    assert [float(row["plausibility"]) for row in edges] == expected.plausibility.tolist()
    assert [int(row["n_points"]) for row in nodes] == expected.shape[:, 0].tolist()


def test_table_for_a_person(capsys, path):
    code, out, err = run(capsys, path)
    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert len(rows) <= 16
    assert ["patches", "3"] in rows
    assert any(row[:1] == ["thickness_m"] and row[-1] == "m" for row in rows)
    assert len(run(capsys, path, "-v")[1].splitlines()) > 20


def test_flags_reach_the_features(capsys, path):
    values = ("radius=2", "tau=0.5", "neighbours=1", "noise=0.05", "watched=2", "tolerance=0.3")
    args = [word for value in values for word in ("--set", f"features.{value}")]
    used = json.loads(run(capsys, path, "--json", *args)[1])["parameters"]
    assert (used["n_watched"], used["tolerance"]) == (2, 0.3)
    assert (used["radius"], used["tau"], used["n_neighbours"], used["noise"]) == (2.0, 0.5, 1, 0.05)


def test_context_is_chosen_by_group(capsys, path):
    for args, expected in (
        ((), list(FeatureSettings().context)),
        (("--set", "features.context=[]"), []),
        (("--set", "features.context=['outlines', 'rays']"), ["outlines", "rays"]),
    ):
        found = json.loads(run(capsys, path, "--json", *args)[1])
        assert found["parameters"]["context"] == expected
        assert ("partly_covered" in found["edges"][0]) == ("outlines" in expected)
        assert set(found["units"]["edges"]) == set(found["edges"][0])
    code, _, err = run(capsys, path, "--set", "features.context=['colour']")
    assert code == 2
    assert "no context colour" in err


def test_a_map_without_patches(capsys, tmp_path):
    write_patches(tmp_path / "none.patches", make_patches([], [], loose=4))
    path = str(tmp_path / "none.patches")
    assert "patches         0" in run(capsys, path)[1]
    assert json.loads(run(capsys, path, "--json")[1])["edges"] == []
    assert len(run(capsys, path, "--csv")[1].splitlines()) == 3


def test_the_literal_reading_reports_what_it_cut(capsys, path):
    code, out, err = run(capsys, path, "--set", "features.reading=literal", "--json")
    result = json.loads(out)
    assert code == 0
    assert result["n_clipped"] > 0
    assert f"{result['n_clipped']} values" in err
    assert "inverse_mse" in result["nodes"][0]
