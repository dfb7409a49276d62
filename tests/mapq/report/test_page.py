from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import write_ply
from mapq.report.drawing import read_picture
from mapq.report.findings import read_findings
from mapq.report.page import page_data, write_report
from mapq.results.judged import read_judged
from prf.shell.cli.page.markup import script_sources, script_tags
from prf.shell.errors import InputError, UsageError
from tests.mapq.factories import make_patches
from tests.mapq.labelled import draw_patches
from tests.mapq.report.results import save_result, without_scripts


def report(path, told, **options):
    write_report(str(path), told, **options)
    return path.read_text()


def data_of(page: str) -> dict:
    text = re.search(r'id="data">([^<]*)<', page).group(1)
    return json.loads(gzip.decompress(base64.b64decode(text)))


def test_a_page_shows_the_result(tmp_path):
    told = read_findings(str(save_result(tmp_path / "r.ply")))
    page = report(tmp_path / "r.html", told)
    data = data_of(page)
    assert data["label"] == draw_patches(1).label.tolist()
    assert data["reasons"][8][0][0] == told.rows[8]["reasons"][0]["text"]
    assert data["measures"]["rms_m"][3] == pytest.approx(told.rows[3]["rms_m"], rel=1e-4)
    assert len(data["regions"]) == len(told.head["regions"])
    assert f"{100 * told.head['verdict']['share_of_area']:.1f} %</strong>" in page
    assert "fails: no more than 5.0 % was asked for" in page
    assert "16 of 32 suspicious" in page
    assert '<html lang="en">' in page


def test_a_page_shows_coverage_and_disagreement_of_scans(tmp_path):
    told = read_findings(str(save_result(tmp_path / "r.ply")))
    told.head["counts"]["coverage"] = 0.125
    told.head["inputs"] = [{"path": "scans", "sha256": None}, {"path": "poses.txt", "sha256": "12ab"}]
    told.rows[3].update(disagreement_m=0.12345, low=0.05, high=0.25)
    page = report(tmp_path / "s.html", told)
    assert "; 12.5 % of all planes could be judged" in page
    assert "and 20.0 % to be judged" in page
    assert "12.5 % of the points that lie on planes of any tilt" in page
    assert data_of(page)["apart"][3] == [0.123, 0.05, 0.25]
    assert data_of(page)["apart"][4] == [None, None, None]
    made = without_scripts(page[page.index("How this was made") :])
    assert "extent of patches" in made
    assert "poses.txt, sha256 12ab" in made
    assert "None" not in made


def test_half_of_a_surrogate_pair_is_written_as_its_escape(tmp_path):
    """It is what names of files become that are no UTF-8, and JSON gives it back."""
    told = read_findings(str(save_result(tmp_path / "r.ply")))
    told.head["regions"][0]["cause"] = "seen \udcff before"
    told.rows[8]["reasons"][0]["text"] = "as \udcff"
    page = report(tmp_path / "r.html", told)
    assert "seen \\udcff before" in page
    assert data_of(page)["reasons"][8][0][0] == "as \udcff"


def test_nothing_of_a_page_lies_elsewhere(tmp_path):
    page = without_scripts(report(tmp_path / "r.html", read_findings(str(save_result(tmp_path / "r.ply")))))
    assert re.findall(r"(?:src|href)=[\"'](?!#)", page) == []
    assert "url(" not in page
    assert "@import" not in page
    assert "default-src 'none'" in page
    assert "unsafe-eval" not in page
    assert "unsafe-inline'; img" in page


def test_names_are_text_and_never_markup(tmp_path):
    wicked = "<script>alert(1)<"  # a slash cannot stand in a name
    told = read_findings(str(save_result(tmp_path / f"{wicked}.ply")))
    evil = '"><img src=x onerror=alert(2)></script><!--'
    for row in told.rows.values():
        row["reasons"] = [{"text": evil, "log_odds": 1.0, "other": 3}]
        row["cause"] = {"kind": evil, "text": evil}
    told.head["regions"][0]["cause"] = evil
    told.head["model"] = told.head["created"] = evil
    told.head["segmentation"]["report"]["warnings"] = [evil]
    told.head["versions"] = {evil: evil}
    page = report(tmp_path / "r.html", told, title=None)
    assert wicked not in page
    assert evil not in page
    assert "<img" not in without_scripts(page)
    assert "&lt;script&gt;alert(1)&lt;" in page
    assert page.count("<script") == page.count("</script>") == 8
    assert data_of(page)["reasons"][0][0][0] == evil


def test_scripts_run_by_their_digest_and_cannot_end_early():
    script = "const x = '</script><!--';"
    tag = script_tags([script])
    assert tag.count("</script>") == 1
    assert "<!--" not in tag
    content = tag.removeprefix("<script>").removesuffix("</script>")
    assert script_sources([script]) == script_sources([content])


def test_survey_coordinates_are_shifted_and_the_page_shows_by_what(tmp_path):
    patches = draw_patches(1)
    far = PointCloud.from_world(patches.cloud.xyz + np.array([413_000.0, 5_317_000.0, 0.0]))
    moved = patches.cloud.xyz[0] - far.xyz[0]
    centroid = patches.centroid - moved
    told = read_findings(str(save_result(tmp_path / "r.ply", replace(patches, cloud=far, centroid=centroid))))
    page = report(tmp_path / "r.html", told)
    data = data_of(page)
    assert "global shift" in page
    np.testing.assert_allclose(data["centre"], centroid, atol=1e-3)
    np.testing.assert_allclose(
        np.add(data["centre"], data["shift"]), [row["centroid"] for row in told.rows.values()], atol=1e-3
    )


def in_feet(patches):
    """Return patches of the same map in feet, which a PLY does not say."""
    return replace(patches, cloud=PointCloud.from_world(patches.cloud.xyz / 0.3048, patches.cloud.fields, unit=0.3048))


def test_a_map_in_feet_is_shown_and_compared_in_metres(tmp_path):
    plain, feet = (
        save_result(tmp_path / name, patches)
        for name, patches in (("m.ply", draw_patches(1)), ("ft.ply", in_feet(draw_patches(1))))
    )
    pages = [data_of(report(tmp_path / "r.html", read_findings(str(path)))) for path in (plain, feet)]
    for name in ("centre", "normal", "label"):
        np.testing.assert_allclose(*(page[name] for page in pages), atol=1e-3)
    np.testing.assert_allclose(*(page["scene"]["high"] for page in pages), atol=1e-3)
    np.testing.assert_allclose(*(read_picture(str(path)).xyz for path in (plain, feet)), atol=1e-3)
    judged = [read_judged(str(path), None, 0.01).xyz for path in (plain, feet)]
    np.testing.assert_allclose(*(np.unique(xyz.round(1), axis=0) for xyz in judged), atol=0.2)


def test_results_of_earlier_releases_are_in_the_unit_of_their_file(tmp_path):
    path = save_result(tmp_path / "ft.ply", in_feet(draw_patches(1)))
    text = (tmp_path / "ft.json").read_text()
    (tmp_path / "ft.json").write_text(text.replace('"cloud_unit": [0.3048, 0.3048, 0.3048], ', ""))
    told = read_findings(str(path))
    np.testing.assert_allclose(told.cloud.xyz, draw_patches(1).cloud.xyz / 0.3048, rtol=1e-5)
    for unit in ("[1, 2]", '"ft"'):
        (tmp_path / "ft.json").write_text(text.replace("[0.3048, 0.3048, 0.3048]", unit))
        with pytest.raises(InputError, match=r"ft\.json: damaged"):
            read_findings(str(path))


def test_a_map_without_patches_is_said_to_have_none(tmp_path):
    told = read_findings(str(save_result(tmp_path / "r.ply", make_patches([], np.zeros((0, 3)), loose=20))))
    page = report(tmp_path / "r.html", told)
    assert "No plane patch was found" in page
    assert data_of(page)["label"] == []


def test_numbers_that_do_not_exist_are_null(tmp_path):
    told = read_findings(str(save_result(tmp_path / "r.ply")))
    told.rows[0]["rms_m"] = told.rows[1]["rms_m"] = None
    assert page_data(told, {})["measures"]["rms_m"][:2] == [None, None]


def test_the_json_must_be_there_and_of_this_result(tmp_path):
    path, other = save_result(tmp_path / "r.ply"), save_result(tmp_path / "o.ply", draw_patches(2, n_walls=6))
    (tmp_path / "r.json").write_bytes((tmp_path / "o.json").read_bytes())
    with pytest.raises(InputError, match="not the JSON of"):
        read_findings(str(path))
    (tmp_path / "o.json").unlink()
    with pytest.raises(InputError, match="not beside it"):
        read_findings(str(other))


@pytest.mark.parametrize(("key", "value"), [("label", "odd"), ("normal", [1.0]), ("area_m2", "x"), ("n_points", [])])
def test_a_damaged_json_is_refused(tmp_path, key, value):
    path = save_result(tmp_path / "r.ply")
    content = json.loads((tmp_path / "r.json").read_text())
    content["patches"][3][key] = value
    (tmp_path / "r.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"r\.json.*damaged"):
        read_findings(str(path))


def test_clouds_and_streams_are_no_results(tmp_path):
    path = tmp_path / "c.ply"
    write_ply(path, draw_patches(1).cloud)
    with pytest.raises(InputError, match="no result"):
        read_findings(str(path))
    with pytest.raises(UsageError, match="standard input"):
        read_findings("-")


def test_of_many_patches_a_page_describes_those_that_matter(tmp_path, monkeypatch):
    path = save_result(tmp_path / "r.ply")
    every = read_findings(str(path))
    monkeypatch.setattr("mapq.report.findings.MAX_LISTED", 20)
    told = read_findings(str(path))
    in_regions = {patch for region in told.head["regions"] for patch in region["patches"]}
    assert len(in_regions) < 20 == len(told.rows)
    assert in_regions < set(told.rows)
    others = np.setdiff1d(np.arange(32), list(told.rows))
    assert every.area[others].max() <= every.area[list(set(told.rows) - in_regions)].min()
    page = report(tmp_path / "r.html", told)
    data = data_of(page)
    assert data["listed"] == sorted(told.rows)
    assert data["label"] == every.label.tolist()
    assert len(data["reasons"]) == 20
    assert "listed</dt><dd>20 of these patches" in page
    assert "16 of 32 suspicious" in page
