from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mapq.io import read_cloud, write_patches
from tests.cli.mapq_samples import call, call_json, save_cloud, save_model, save_patches
from tests.mapq.factories import make_patches
from tests.mapq.labelled import draw_patches


def test_the_result_has_both_files_and_the_contract_s_fields(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, model = save_patches(tmp_path), save_model(tmp_path)
    code, out, err = call(capsys, "classify", path, "--model", model)
    assert (code, err) == (0, "")
    assert "is suspicious at 0.30 m (" in out
    assert "16 of 32 patches; coordinates taken as metres)" in out
    assert "parallel to patch" in out
    assert "of connected suspicious patches, the worst 3:" in out
    cloud = read_cloud("walls1.classified.ply")
    label, p, patch = (cloud.fields[name] for name in ("suspicious", "p_suspicious", "patch"))
    assert (patch.dtype, label.dtype, p.dtype) == (np.int32, np.uint8, np.float32)
    np.testing.assert_array_equal(p > 0.5, label == 1)
    assert {"red", "green", "blue", "truth", "intensity"} <= set(cloud.fields)
    content = json.loads(Path("walls1.classified.json").read_text())
    assert content["schema"] == "mapq.result/1"
    assert content["unit"] == "m"
    assert content["counts"]["n_suspicious"] == 16
    for row in content["patches"]:
        points = patch == row["patch"]
        assert row["n_points"] == points.sum()
        assert (label[points] == (row["label"] == "suspicious")).all()
        assert p[points][0] == pytest.approx(row["p_suspicious"], abs=1e-7)
        np.testing.assert_allclose(row["centroid"], cloud.world()[points].mean(axis=0), atol=1e-4)
        assert sum(term["contribution"] for term in row["terms"]) == pytest.approx(row["log_odds"], abs=1e-6)


def test_a_cloud_is_segmented_first(capsys, tmp_path):
    path, target = save_cloud(tmp_path), tmp_path / "r.ply"
    result = call_json(
        capsys, "classify", path, "--model", save_model(tmp_path), "-o", target, "--surfaces", "upright,tilted"
    )
    assert result["counts"]["n_points"] == len(draw_patches(1).cloud)
    assert result["segmentation"]["parameters"]["surfaces"] == ["upright", "tilted"]


def test_a_result_can_be_classified_anew(capsys, tmp_path):
    model, first, second = save_model(tmp_path), tmp_path / "a.ply", tmp_path / "b.ply"
    assert call(capsys, "classify", save_patches(tmp_path), "--model", model, "-o", first)[0] == 0
    assert call(capsys, "classify", first, "--model", model, "-o", second)[0] == 0
    assert set(read_cloud(str(first)).fields) == set(read_cloud(str(second)).fields)


@pytest.mark.parametrize(("share", "code"), [(0.4, 1), (0.6, 0), ("40%", 1), ("60 %", 0)])
def test_fail_over_fails_after_the_result_is_written(capsys, tmp_path, share, code):
    target = tmp_path / "r.ply"
    args = ["classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", target, "--fail-over", share]
    found, out, err = call(capsys, *args)
    assert found == code
    assert out
    assert ("of the area of patches is suspicious" in err) == (code == 1)
    assert target.exists()
    assert json.loads(target.with_suffix(".json").read_text())["verdict"]["passed"] is (code == 0)


def test_fail_apart_fails_where_scans_are_not_known(capsys, tmp_path):
    target = tmp_path / "r.ply"
    args = ["classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", target, "--fail-apart", 0.1]
    code, _, err = call(capsys, *args)
    assert code == 1
    assert "scans are not known, so nor is how far they disagree" in err
    assert json.loads(target.with_suffix(".json").read_text())["verdict"]["fail_apart"] == 0.1


def test_a_tolerance_that_the_model_did_not_learn_is_an_error_in_one_line(capsys, tmp_path):
    args = ["classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", tmp_path / "r.ply"]
    code, _, err = call(capsys, *args, "--tolerance", 0.1)
    assert code == 2
    assert err.strip().endswith("tolerance 0.1: the model learnt 0.3 m alone. Ask for that, or train on metres apart.")
    assert not (tmp_path / "r.ply").exists()


@pytest.mark.parametrize(("options", "code"), [([], 1), (["--min-coverage", "5%"], 0), (["--min-coverage", "1"], 1)])
def test_a_map_of_which_little_was_judged_fails_in_one_line(capsys, tmp_path, options, code):
    patches = draw_patches(1)
    judged = int(patches.counts.sum())
    report = {"not_judged": {"level": {"patches": 1, "points": 9 * judged, "area": 1.0}}}
    path, target = tmp_path / "flat.patches", tmp_path / "r.ply"
    write_patches(path, replace(patches, report=report))
    args = ["classify", path, "--model", save_model(tmp_path), "-o", target, "--fail-over", "100%", *options]
    found, out, err = call(capsys, *args)
    assert found == code
    assert " of all points lie in patches large enough, 10.0% of these in judged ones" in out
    assert err.count("\n") == code
    assert ("10.0% of the points on planes could be judged, less than" in err) == (code == 1)
    stored = json.loads(target.with_suffix(".json").read_text())
    assert (stored["counts"]["coverage"], stored["verdict"]["passed"]) == (0.1, code == 0)
    assert call(capsys, *args[:-2], "-q", "--force")[1] == ""


def test_no_patches_are_a_result_with_a_warning(capsys, tmp_path):
    path, target = tmp_path / "none.patches", tmp_path / "r.ply"
    write_patches(path, make_patches([], np.empty((0, 3)), loose=5))
    code, out, err = call(capsys, "classify", path, "--model", save_model(tmp_path), "-o", target)
    assert code == 0
    assert "no plane patch was found" in err
    assert "nothing was judged, 0 of 0 patches" in out
    assert json.loads((tmp_path / "r.json").read_text())["counts"]["share_of_area"] is None
    assert read_cloud(str(target)).fields["suspicious"].tolist() == [255] * 5


def test_the_default_output_is_beside_the_input_without_gz(capsys, tmp_path):
    model, path = save_model(tmp_path), save_cloud(tmp_path)
    packed = tmp_path / "räume 1.ply.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert call(capsys, "classify", packed, "--model", model)[0] == 0
    assert (tmp_path / "räume 1.classified.ply").exists()
    assert (tmp_path / "räume 1.classified.json").exists()


def test_a_map_without_a_patch_passes_no_gate(capsys, tmp_path):
    path = tmp_path / "none.patches"
    write_patches(path, make_patches([], np.empty((0, 3)), loose=5))
    args = ["classify", path, "--model", save_model(tmp_path), "-o", "/dev/null", "--fail-over", 1]
    code, _, err = call(capsys, *args)
    assert code == 1
    assert "does not pass" in err
    assert not Path("/dev/null.json").exists()


def test_the_table_is_short_and_complete_under_v(capsys, tmp_path):
    args = ["classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", tmp_path / "r.ply", "-f"]
    short, full = (call(capsys, *args, *more)[1].splitlines() for more in ([], ["-v"]))
    assert len(short) <= 15 < len(full)
    assert [line.split()[0] for line in short[-4:]] == ["judged", "tolerance", "verdict", "result"], (
        "the answer is last"
    )


def test_causes_are_named_where_the_map_has_times(capsys, tmp_path):
    patches = draw_patches(1)
    scan = np.where(patches.patch < 0, 0, patches.patch % 2)
    path = tmp_path / "walls.patches"
    write_patches(path, replace(patches, cloud=patches.cloud.with_fields(scan=scan)))
    target = tmp_path / "result.ply"
    code, out, _ = call(capsys, "classify", path, "--model", save_model(tmp_path), "-o", target, "-v")
    assert code == 0
    assert "causes          " in out
    assert "of the suspicious area" in out
    assert "      cause  local mapping error: scans of one visit put it " in out
    content = json.loads(target.with_suffix(".json").read_text())
    assert content["verdict"]["cause"] in ("local mapping error", "unknown")
    fields = read_cloud(str(target)).fields
    kinds = {None: 255, "unknown": 0, "missed loop closure": 1, "local mapping error": 2}
    for row in content["patches"]:
        expected = kinds[row["cause"] and row["cause"]["kind"]]
        assert set(fields["cause"][fields["patch"] == row["patch"]].tolist()) == {expected}
        assert (row["cause"] is None) == (row["label"] == "plausible")


def test_a_missing_default_model_is_reported_with_advice(capsys, tmp_path, monkeypatch):
    from mapq.io import models

    monkeypatch.setattr(models, "DEFAULT", ("models", "absent.json"))
    code, _, err = call(capsys, "classify", save_patches(tmp_path), "-o", tmp_path / "r.ply")
    assert (code, err.count("\n")) == (3, 1)
    assert "mapq train" in err


def test_a_file_of_settings_may_be_for_clouds_too(capsys, tmp_path):
    settings = tmp_path / "site.toml"
    settings.write_text("[cloud]\ntopic = 'points'\n")
    args = ("classify", save_patches(tmp_path), "--model", save_model(tmp_path), "--config", settings)
    assert call(capsys, *args, "-o", tmp_path / "a.ply")[0] == 0


def test_a_file_of_all_defaults_changes_nothing(capsys, tmp_path):
    model, settings = save_model(tmp_path), tmp_path / "all.toml"
    settings.write_text(call(capsys, "config", "show")[1])
    for number, path in enumerate((save_patches(tmp_path), save_cloud(tmp_path))):
        one, other = (tmp_path / f"{number}{name}.ply" for name in ("plain", "asked"))
        assert call(capsys, "classify", path, "--model", model, "-o", one)[0] == 0
        assert call(capsys, "classify", path, "--model", model, "-o", other, "--config", settings)[0] == 0
        assert one.read_bytes() == other.read_bytes()
        report = json.loads(other.with_suffix(".json").read_text())["segmentation"]["report"]
        assert "tiles" not in report


def test_patches_may_come_by_standard_input(capsys, tmp_path, monkeypatch):
    path = save_patches(tmp_path)
    with open(path, "rb") as stream:
        monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=stream))
        code, _, err = call(capsys, "classify", "-", "--model", save_model(tmp_path), "-o", tmp_path / "r.ply")
    assert (code, err) == (0, "")


def test_a_warning_of_the_segmentation_is_given_once(capsys, tmp_path):
    rng, path = np.random.default_rng(1), tmp_path / "far.xyz"
    wall = np.column_stack([rng.uniform(0.0, 6.0, 3000), rng.normal(0.0, 0.01, 3000), rng.uniform(0.0, 3.0, 3000)])
    np.savetxt(path, np.vstack([wall, [[9e6, 0.0, 0.0], [9e6, 1.0, 0.0]]]), fmt="%.3f")
    err = call(capsys, "classify", path, "--model", save_model(tmp_path), "-o", tmp_path / "r.ply")[2]
    assert err.count("very far") == 1


def test_the_verdict_says_little_of_a_map_of_which_little_is_flat(capsys, tmp_path):
    rng = np.random.default_rng(1)
    wall = rng.uniform((0, 0, 0), (6, 0.01, 3), (1500, 3))
    path = tmp_path / "bushes.xyz"
    np.savetxt(path, np.concatenate([wall, rng.uniform((0, 4, 0), (6, 8, 3), (6000, 3))]))
    _, out, err = call(capsys, "classify", path, "--model", save_model(tmp_path), "-o", tmp_path / "r.ply")
    (verdict,) = (line for line in out.splitlines() if line.startswith("verdict"))
    assert "it says little, as only" in verdict
    assert "of the neighbourhoods show a plane at the best scale" in err
