"""A small town in one tile and in four has the patches and labels of the map in memory."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.configuration import AS_IT_IS, SURFACES, Configuration, SegmentSettings, TileSettings
from mapq.io import read_cloud, write_cloud
from mapq.io.tiles import open_map
from mapq.model import Model
from mapq.results.result import assess
from mapq.segmentation import segment
from mapq.simulate.city import ORIGIN, PITCH, SIDES, make_block, plan_city, write_city
from mapq.tiled.measure import PatchGroup
from mapq.tiled.run import assess_map, classify_map, cut_map
from prf.shell.cli.files import work_folder

N_POINTS = 145_000


@pytest.fixture(scope="module")
def town(tmp_path_factory) -> Path:
    """A block in four tiles, so that its facades are cut."""
    folder = tmp_path_factory.mktemp("town") / "tiles"
    folder.mkdir()
    block = make_block(5, 0, 0, 0)
    west, south = (block.xyz[:, :2] < 0.45 * PITCH).T
    for number, some in enumerate((west & south, west & ~south, ~west & south, ~west & ~south)):
        part = block.take(some)
        cloud = PointCloud.from_world(part.xyz + ORIGIN, {"truth": part.truth})
        write_cloud(folder / f"part_{number}.laz", cloud)
    return folder


def classified(town: Path, model: Model, name: str, tile_points: int) -> tuple[dict, PointCloud]:
    target = town.parent / name
    classify_map(str(town), str(target), model, Configuration(tiles=TileSettings(tile_points=tile_points)), False)
    return json.loads((target / "result.json").read_text()), whole(target)


def whole(folder: Path) -> PointCloud:
    """All tiles of a folder as one cloud."""
    clouds = [read_cloud(str(path)) for path in sorted(folder.glob("*.laz"))]
    fields = {name: np.concatenate([cloud.fields[name] for cloud in clouds]) for name in clouds[0].fields}
    return PointCloud.from_world(np.concatenate([cloud.world() for cloud in clouds]), fields)


@pytest.fixture(scope="module")
def four(town, model) -> tuple[dict, PointCloud]:
    return classified(town, model, "four", N_POINTS // 4)


@pytest.fixture(scope="module")
def plain(town, model):
    return assess(segment(whole(town)), model)


def test_one_tile_is_the_map_in_memory(town, model, plain):
    head, cloud = classified(town, model, "one", 10**6)
    assert head["tiles"] == 1
    np.testing.assert_array_equal(cloud.fields["patch"], plain.patches.patch)
    suspicious = np.append(plain.labelling.label, np.uint8(255))[plain.patches.patch]
    np.testing.assert_array_equal(cloud.fields["suspicious"], suspicious)
    counts = json.loads(json.dumps(plain.head()["counts"]))
    mine, theirs = head["counts"].pop("by_surface"), counts.pop("by_surface")
    assert head["counts"] == pytest.approx(counts, rel=1e-6)
    assert set(mine) == set(theirs) == {"upright", "level"}
    for name in mine:
        assert mine[name] == pytest.approx(theirs[name], rel=1e-6)
    for mine, theirs in zip(head["regions"], plain.head()["regions"], strict=True):
        for name in ("area_m2", "severity_m2", "low", "high", "centre", "n_points"):
            assert mine[name] == pytest.approx(theirs[name], rel=1e-6)
    assert [row["reasons"] for row in head["patches"]] == [row["reasons"] for row in plain.patch_rows()]


def test_four_tiles_have_the_patches_and_labels_of_the_map_in_memory(plain, four):
    head, cloud = four
    assert head["tiles"] == 4
    np.testing.assert_array_equal(cloud.world(), plain.patches.cloud.world())
    mine, theirs = plain.patches.patch, cloud.fields["patch"]
    n_mine, n_theirs = np.bincount(mine[mine >= 0]), np.bincount(theirs[theirs >= 0])
    shared = np.zeros((len(n_mine), len(n_theirs)), np.int64)
    both = (mine >= 0) & (theirs >= 0)
    np.add.at(shared, (mine[both], theirs[both]), 1)
    iou = (shared / (n_mine[:, None] + n_theirs - shared)).max(axis=1)
    assert iou @ n_mine / n_mine.sum() > 0.99
    assert np.mean(plain.cloud().fields["suspicious"] == cloud.fields["suspicious"]) > 0.995


def test_tiles_keep_their_names_points_and_fields(town, four):
    for path in sorted(town.glob("*.laz")):
        old, new = read_cloud(str(path)), read_cloud(str(town.parent / "four" / path.name))
        np.testing.assert_array_equal(new.world(), old.world())
        np.testing.assert_array_equal(new.fields["truth"], old.fields["truth"])
    assert four[1].fields["red"].max() > 255
    assert not list(town.parent.glob(".*.work"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["joined.laz", "joined.ply"])
def test_several_files_become_one_cloud(town, model, four, name):
    target = town.parent / name
    settings = Configuration(tiles=TileSettings(tile_points=N_POINTS // 4))
    classify_map(str(town), str(target), model, settings, True)
    joined = read_cloud(str(target))
    np.testing.assert_array_equal(joined.fields["patch"], four[1].fields["patch"])
    np.testing.assert_allclose(joined.world(), four[1].world(), atol=1e-4)
    assert target.with_suffix(".json").exists()


def test_a_city_is_the_same_whatever_its_tiles(tmp_path):
    n_points = 290_000
    for name, size in (("one", 10**6), ("several", 150_000)):
        write_city(tmp_path / name, n_points, 5, size)
    one, several = whole(tmp_path / "one"), whole(tmp_path / "several")
    assert len(list((tmp_path / "several").iterdir())) > 1
    order = [np.lexsort(cloud.world().T) for cloud in (one, several)]
    np.testing.assert_array_equal(one.world()[order[0]], several.world()[order[1]])
    np.testing.assert_array_equal(one.fields["truth"][order[0]], several.fields["truth"][order[1]])
    assert 0.05 < one.fields["truth"].mean() < 0.4
    assert plan_city(n_points).columns * plan_city(n_points).rows == 2


def test_sides_that_were_seen_once_are_plausible():
    blocks = [make_block(1, column, 0, column) for column in range(3)]
    for block in blocks:
        numbers = block.surface[block.surface >= 0]
        share = np.bincount(numbers - numbers.min(), block.truth[block.surface >= 0])
        assert (share > 0).sum() < SIDES * 5
    assert any(block.truth.any() for block in blocks)
    assert not all(block.truth[block.surface >= 0].all() for block in blocks)


def test_a_task_loads_what_lies_about_its_patches_though_the_ground_lies_about_all(town, model, monkeypatch):
    """All tilts are kept, in nine tiles; the ground, of more points than a task has, is measured by itself."""
    monkeypatch.setattr("mapq.tiled.measure.LARGEST_PATCH", 40_000)
    settings = Configuration(tiles=TileSettings(tile_points=N_POINTS // 9), segment=SegmentSettings(surfaces=SURFACES))
    loaded, own, among = [], [], []

    def workers(call, tasks):
        for task in tasks:
            part, is_own = getattr(task, "args", (None, None))[:2]
            if isinstance(part, PatchGroup):
                loaded.append(sum(len(range(*row[1:])) for row in part.slices.tolist()))
                own.append(int(is_own.sum()))
                among.append(len(is_own))
            yield call(task)

    with work_folder(str(town)) as folder:
        cut = cut_map(open_map(str(town), AS_IT_IS), settings, workers, folder)
        assess_map(cut, settings, model, workers)
    assert cut.patches.counts.max() > 50_000
    assert own[-1] == 1 < among[-1]
    assert N_POINTS // 9 < loaded[-1] < 40_000 + 2 * N_POINTS // 9
    assert max(loaded) < 0.7 * cut.patches.counts.sum()


@pytest.mark.slow
def test_the_ground_spans_tiles_and_large_patches_are_thinned(town, model, monkeypatch):
    """With all tilts kept, in nine tiles, and no more than 20 000 points of a patch looked at."""
    found = []
    for most in (10**9, 20_000):
        monkeypatch.setattr("mapq.tiled.measure.LARGEST_PATCH", most)
        settings = Configuration(
            tiles=TileSettings(tile_points=N_POINTS // 9), segment=SegmentSettings(surfaces=SURFACES)
        )
        with work_folder(str(town)) as folder:
            cut = cut_map(open_map(str(town), AS_IT_IS), settings, map, folder)
            found.append(assess_map(cut, settings, model, map))
    whole, thinned = found
    ground = int(np.argmax(whole.patches.counts))
    assert whole.patches.counts[ground] > 50_000
    assert abs(whole.patches.normal[ground, 2]) > 0.999
    np.testing.assert_array_equal(whole.patches.counts, thinned.patches.counts)
    np.testing.assert_allclose(thinned.area, whole.area, rtol=0.1)
    assert np.mean(whole.labelling.label == thinned.labelling.label) > 0.98


def test_points_far_from_all_others_are_left_out(town, tmp_path, four):
    """Such as those at 0, 0, 0 that some sensors write into a survey grid for no return."""
    for path in sorted(town.glob("*.laz")):
        cloud = read_cloud(str(path))
        world = np.concatenate([np.zeros((1, 3)), cloud.world()])
        fields = {"truth": np.append(np.uint8(0), cloud.fields["truth"])}
        write_cloud(tmp_path / path.name, PointCloud.from_world(world, fields))
    with work_folder(str(tmp_path)) as folder:
        cut = cut_map(
            open_map(str(tmp_path), AS_IT_IS), Configuration(tiles=TileSettings(tile_points=N_POINTS // 4)), map, folder
        )
    assert cut.patches.report["points_far_outside"] == 4
    assert cut.patches.report["warnings"]
    assert len(cut.tiling.boxes) == 4
    n_points = np.bincount(four[1].fields["patch"] + 1)[1:]
    assert cut.patches.counts.sum() == pytest.approx(n_points.sum(), rel=0.01)
    np.testing.assert_allclose(cut.patches.counts[:8], n_points[:8], rtol=0.02)
