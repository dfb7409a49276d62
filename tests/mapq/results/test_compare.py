from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.io.results import write_result
from mapq.results.compare import compare as compare_maps
from mapq.results.compare import comparison_content
from mapq.results.judged import judge, read_judged
from mapq.results.result import assess
from prf.shell.cli.jsonout import dump_object
from prf.shell.errors import InputError, UsageError
from tests.mapq.factories import Rectangle, sample_patches, wall
from tests.mapq.results.test_result import make_model

STREET = [wall((14.0 * k + 1, 2), (14.0 * k + 9, 2)) for k in range(4)]


def judged(walls: list[Rectangle], name: str = "map"):
    return judge(assess(sample_patches(walls, density=20.0), make_model()), name)


@pytest.fixture(scope="module")
def maps():
    """The same street, doubled at its first wall, and doubled at its last."""
    first = judged([*STREET, wall((1, 2.4), (9, 2.4))], "first")
    return first, judged([*STREET, wall((43, 2.4), (51, 2.4))], "second")


def test_it_reports_where_each_map_is_better(maps):
    found = compare_maps(*maps, 5.0)
    assert found.better == "same"
    by_kind = {place.worse: place for place in found.places}
    assert len(found.places) == 2
    assert by_kind[False].low[0] == 0.0
    assert by_kind[False].high[0] == 10.0
    assert by_kind[True].low[0] == 40.0
    assert by_kind[True].change > 0.0 > by_kind[False].change
    assert by_kind[True].after > 0.5 > by_kind[True].before


def test_swapping_the_maps_swaps_the_answer(maps):
    clean = judged(STREET, "clean")
    forth, back = compare_maps(maps[0], clean, 5.0), compare_maps(clean, maps[0], 5.0)
    assert (forth.better, back.better) == ("second", "first")
    np.testing.assert_allclose(forth.expected, back.expected[::-1])
    assert [place.change for place in forth.places] == pytest.approx([-place.change for place in back.places])
    assert forth.suspicious[1] == 0.0 < forth.suspicious[0]


def test_only_common_ground_counts(maps):
    longer = judged([*STREET, wall((100, 2), (110, 2)), wall((100, 2.4), (110, 2.4))])
    found = compare_maps(judged(STREET), longer, 5.0)
    assert found.better == "same"
    assert found.covered[0] == 1.0 > found.covered[1]


def test_maps_of_different_places_are_refused(maps):
    far = maps[0]._replace(xyz=maps[0].xyz + 1000.0)
    with pytest.raises(InputError, match="share no cell of 5 m"):
        compare_maps(maps[0], far, 5.0)
    with pytest.raises(UsageError, match="no length"):
        compare_maps(*maps, 0.0)


def test_a_result_file_repeats_the_patches(tmp_path, maps):
    patches = sample_patches([*STREET, wall((1, 2.4), (9, 2.4))], density=20.0)
    patches = replace(patches, cloud=replace(patches.cloud, coordinate_type=np.float64))
    result = assess(patches, make_model())
    path = str(tmp_path / "r.ply")
    write_result(path, result.cloud(), result.head(), result.patch_rows())
    found, expected = read_judged(path, None), judge(result, path)
    assert len(found.xyz) < len(expected.xyz)
    one, other = compare_maps(found, maps[1], 5.0), compare_maps(expected, maps[1], 5.0)
    for name in ("area", "suspicious", "expected", "covered"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6)
    with pytest.raises(UsageError, match="Leave out --model"):
        read_judged(path, make_model())
    other = assess(sample_patches(STREET[:2], density=20.0), make_model())
    (tmp_path / "r.json").write_text(dump_object("mapq.result/1", {"patches": list(other.patch_rows())}))
    with pytest.raises(InputError, match="not the JSON of"):
        read_judged(path, None)
    (tmp_path / "r.json").write_text(dump_object("mapq.result/1", {"patches": [{"patch": 1}]}))
    with pytest.raises(InputError, match="without area_m2, n_points"):
        read_judged(path, None)


def test_the_content_is_that_of_the_json(maps):
    content = comparison_content(compare_maps(*maps, 5.0))
    assert set(content) == {"cell_m", "n_cells", "first", "second", "better", "by", "difference", "places"}
    assert {place["change"] for place in content["places"]} == {"better", "worse"}
    assert set(content["first"]) == {"area_m2", "share_of_area", "expected_share_of_area", "share_in_common"} | {
        "disagreement_m",
        "coverage",
    }


def known(judged, metres, error=0.02):
    """Return a map in which scans disagree by so much everywhere."""
    every = np.ones(len(judged.xyz))
    return judged._replace(disagreement=metres * every, error=error * every)


@pytest.mark.parametrize(("metres", "better"), [(0.25, "first"), (0.15, "second"), (0.21, "same"), (0.2, "same")])
def test_the_map_whose_scans_disagree_by_less_is_better_whatever_is_called_suspicious(maps, metres, better):
    clean = judged(STREET, "clean")
    found = compare_maps(known(maps[0], 0.2), known(clean, metres), 5.0)
    assert (found.by, found.better) == ("disagreement", better)
    np.testing.assert_allclose(found.disagreement, [0.2, metres])
    low, value, high = found.difference
    assert low < value < high
    assert value == pytest.approx(metres - 0.2)


def test_disagreement_does_not_decide_where_it_is_known_of_little(maps):
    clean = judged(STREET, "clean")
    some = known(clean, 0.5)
    few = np.where(clean.xyz[:, 0] < 6.0, 0.5, np.nan)
    found = compare_maps(known(maps[0], 0.2), some._replace(disagreement=few), 5.0)
    assert (found.by, found.better) == ("expected share", "second")
    assert np.isnan(found.disagreement).all()


def test_a_result_file_knows_disagreement_and_coverage(tmp_path, maps):
    patches = sample_patches(STREET, density=20.0)
    report = {"dropped_for_tilt": {"patches": 1, "points": int(patches.counts.sum()), "area": 1.0}}
    cloud = patches.cloud.with_fields(scan=np.arange(len(patches.cloud)) % 2)
    result = assess(replace(patches, cloud=cloud, report=report), make_model())
    path = str(tmp_path / "r.ply")
    write_result(path, result.cloud(), result.head(), result.patch_rows())
    found, expected = read_judged(path, None), judge(result, path)
    assert found.coverage == expected.coverage == 0.5
    assert np.isfinite(found.disagreement).any()
    for name in ("disagreement", "error"):
        np.testing.assert_allclose(np.unique(getattr(found, name)), np.unique(getattr(expected, name)), atol=1e-6)
