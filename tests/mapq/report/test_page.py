from __future__ import annotations

import base64
import gzip
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from mapq.cloud import PointCloud
from mapq.io import write_ply
from mapq.report.drawing import read_picture
from mapq.report.findings import read_findings
from mapq.report.histogram import N_BINS, histogram
from mapq.report.page import write_report
from mapq.report.scene import build_scene, evenly, outlines
from mapq.results.judged import read_judged
from prf.shell.cli.page import script_sources, script_tags
from prf.shell.errors import InputError, UsageError
from tests.mapq.factories import make_patches, sample_patches, wall
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
    assert "fails: more than the 5.0 % asked for" in page
    assert "16 of 32 suspicious" in page
    assert '<html lang="en">' in page


def test_a_page_shows_coverage_and_disagreement_of_scans(tmp_path):
    told = read_findings(str(save_result(tmp_path / "r.ply")))
    told.head["counts"] |= {"coverage": 0.125, "n_points": 1000, "n_points_in_patches": 80}
    told.head["verdict"]["flat_share"] = 0.34
    told.head["inputs"] = [{"path": "scans", "sha256": None}, {"path": "poses.txt", "sha256": "12ab"}]
    told.rows[3].update(disagreement_m=0.12345, low=0.05, high=0.25)
    page = report(tmp_path / "s.html", told)
    assert "; 64.0 % of all points lie in patches large enough to judge, 12.5 % of these were judged" in page
    assert "and less than 20.0 % judged" in page
    assert "it says little, as only 34% of neighbourhoods are flat" in page
    assert "12.5 % of the points in patches that are large enough, in which 64.0 % of all points lie" in page
    assert data_of(page)["apart"][3] == [0.123, 0.05, 0.25]
    assert data_of(page)["apart"][4] == [None, None, None]
    made = without_scripts(page[page.index("How this was made") :])
    assert "extent of patches" in made
    assert "poses.txt, sha256 12ab" in made
    assert "None" not in made


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
    texts = [report(tmp_path / "r.html", read_findings(str(path))) for path in (plain, feet)]
    assert "<dd>coordinates taken as metres</dd>" in texts[0]
    assert "<dd>coordinates in units of 0.3048 m; lengths" in texts[1]
    pages = [data_of(text) for text in texts]
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


def test_the_json_must_be_there_and_of_this_result(tmp_path):
    path, other = save_result(tmp_path / "r.ply"), save_result(tmp_path / "o.ply", draw_patches(2, n_walls=6))
    (tmp_path / "r.json").write_bytes((tmp_path / "o.json").read_bytes())
    with pytest.raises(InputError, match="not the JSON of"):
        read_findings(str(path))
    (tmp_path / "o.json").unlink()
    with pytest.raises(InputError, match="not beside it"):
        read_findings(str(other))


def test_clouds_and_streams_are_no_results(tmp_path):
    path = tmp_path / "c.ply"
    write_ply(path, draw_patches(1).cloud)
    with pytest.raises(InputError, match="expected a result"):
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


def test_the_aspect_of_a_scene_is_that_of_the_taller_view():
    flat = build_scene(
        np.array([[0.0, 0.0, 0.0], [20.0, 5.0, 0.0]]), np.zeros(2, np.int32), np.eye(3)[2:], np.zeros(1, np.uint8), 9
    )
    assert 0.25 < flat.aspect < 0.6, "it is seen aslant"
    assert flat._replace(high=np.array([20.0, 80.0, 0.0])).aspect == 4.0


def test_areas_by_probability_and_label():
    p = np.array([0.0, 0.04, 0.96, 1.0, np.nan])
    sums, unit = histogram(p, np.array([0, 1, 1, 1, 0], np.uint8), np.array([1.0, 2.0, 4.0, 8.0, 16.0]))
    assert unit == "m²"
    assert (sums[0, 0], sums[1, 0], sums[1, N_BINS - 1]) == (1.0, 2.0, 12.0)
    assert sums.sum() == 15.0


def test_patches_are_counted_where_areas_are_not_known():
    sums, unit = histogram(np.array([0.5, 0.5]), np.array([0, 1], np.uint8), np.array([1.0, np.nan]))
    assert (unit, sums.sum()) == ("patches", 2.0)


def area_of(ring: np.ndarray) -> float:
    return 0.5 * float(np.linalg.norm(np.cross(ring[1:-1] - ring[0], ring[2:] - ring[0]).sum(axis=0)))


def unpack(head: dict, content: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Read what pages read, as docs/report.md says."""
    values = np.frombuffer(content, "<i4")
    parts = np.split(values, np.cumsum([3 * head["k"], head["m"] + 2, 3 * head["h"]]))
    places = [part.reshape(3, -1).T * head["step"] + head["low"] for part in (parts[0], parts[2])]
    return places[0], parts[1], places[1], parts[3]


def test_outlines_are_hulls_but_for_blunt_corners():
    patches = sample_patches([wall((0, 0), (8, 1)), wall((20, 3), (20, 9))], seed=1, noise=0.0)
    points, start = patches.members
    xyz = patches.cloud.xyz[points]
    corners, begin = outlines(xyz, start, patches.normal)
    for patch in range(2):
        mine, ring = xyz[start[patch] : start[patch + 1]], corners[begin[patch] : begin[patch + 1]]
        across = np.cross(patches.normal[patch], [0.0, 0.0, 1.0])
        hull = ConvexHull(np.column_stack([mine @ across, mine[:, 2]])).volume
        assert 0.95 * hull < area_of(ring) <= hull * (1 + 1e-9)


def test_a_line_of_points_a_pair_and_a_lost_normal_have_no_outline():
    line = np.outer(np.linspace(0, 1, 9), [1.0, 0.0, 0.0])
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    xyz = np.concatenate([line, square[:2], square, square])
    normal = np.array([[0.0, 0, 1], [0, 0, 1], [np.nan, 0, 0], [0, 0, 1]])
    corners, begin = outlines(xyz, np.array([0, 9, 11, 15, 19]), normal)
    assert (begin[1], begin[2], begin[3], begin[4]) == (0, 0, 0, 4)
    assert area_of(corners) == pytest.approx(1.0)


def test_points_are_ordered_by_patch_and_stored_to_the_millimetre():
    patches = sample_patches([wall((0, 0), (8, 0)), wall((0, 5), (8, 5))], seed=2)
    patches = make_patches(
        [patches.cloud.xyz[patches.patch == 1], patches.cloud.xyz[patches.patch == 0]], patches.normal, 7
    )
    patches.cloud.xyz[3] = np.nan
    scene = build_scene(patches.cloud.xyz, patches.patch, patches.normal, patches.label, 500)
    points, start, corners, corner_start = unpack(*scene.pack())
    np.testing.assert_allclose(points, scene.points, atol=6e-4)
    np.testing.assert_allclose(corners, scene.corners, atol=6e-4)
    np.testing.assert_array_equal(start, scene.start)
    assert corner_start[-1] == len(corners)
    assert np.abs(points[: start[1], 1] - 5.0).max() < 0.2
    assert start[-1] - start[-2] == 7
    assert len(points) <= 500
    assert scene.n_points == len(patches.cloud) - 1


def test_loose_points_get_what_patches_leave():
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 10, (4_000, 3))
    patch = np.where(np.arange(4_000) < 100, 0, -1).astype(np.int32)
    scene = build_scene(xyz, patch, np.array([[0.0, 0.0, 1.0]]), np.zeros(1, np.uint8), 1_000)
    assert scene.start[1] == 100
    assert 600 < len(scene.points) <= 1_000


def test_the_box_holds_every_patch_and_leaves_out_what_lies_far_off():
    rng = np.random.default_rng(0)
    xyz = np.concatenate([rng.uniform(20, 30, (100, 3)), rng.uniform(0, 10, (4_000, 3)), [[900.0, -900.0, 50.0]]])
    patch = np.where(np.arange(len(xyz)) < 100, 0, -1).astype(np.int32)
    scene = build_scene(xyz, patch, np.array([[0.0, 0.0, 1.0]]), np.zeros(1, np.uint8), 1_000)
    assert (scene.high >= xyz[:100].max(axis=0)).all()
    assert (scene.low < 0.5).all()
    assert (np.abs(np.concatenate([scene.low, scene.high])) <= 30.0).all()


def test_what_is_sparse_keeps_its_points_beside_what_is_dense():
    rng = np.random.default_rng(2)
    dense, sparse = rng.uniform(0, 10, (50_000, 2)), rng.uniform(0, 10, (8_000, 2)) + 20.0
    xyz = np.column_stack([np.concatenate([dense, sparse]), np.zeros(58_000)])
    chosen = evenly(xyz, np.zeros(58_000, np.int32), 2_000)
    assert 0.8 < np.count_nonzero(chosen >= 50_000) / np.count_nonzero(chosen < 50_000) < 1.2


def test_every_group_stays():
    rng = np.random.default_rng(3)
    group = np.repeat(np.arange(300, dtype=np.int32), 40)
    chosen = evenly(rng.uniform(0, 0.1, (12_000, 3)), group, 400)
    assert len(np.unique(group[chosen])) == 300
