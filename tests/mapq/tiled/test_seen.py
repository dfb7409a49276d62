"""A map that tells when and from where it was seen: in tiles the same patches, features and labels as in memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mapq.axes import turn, turn_cloud
from mapq.cloud import PointCloud
from mapq.configuration import AS_IT_IS, SIZES, Configuration, SimulateSettings, TileSettings
from mapq.features.disagreement import Known, Span, decide, known_of
from mapq.io import read_cloud, write_cloud
from mapq.io.tiles import open_map
from mapq.model import Model
from mapq.results.result import Result, assess
from mapq.segmentation import segment
from mapq.simulate import simulate
from mapq.tiled.run import assess_map, classify_map, cut_map
from prf.shell.cli.files import work_folder

SEED = 10
"""Of a drive whose patches are the same in tiles, so that their features can be compared."""
TILES = 4


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> str:
    """A drive that drifts, with two passes, times, scans of 5 s, and where the sensor was."""
    cloud = simulate(SimulateSettings(**SIZES["small"]), SEED)
    scan = (cloud.fields["time"] // 5.0).astype(np.int32)
    path = str(tmp_path_factory.mktemp("drive") / "drive.ply")
    write_cloud(path, cloud.with_fields(scan=scan))
    return path


def without(path: str, names: tuple[str, ...]) -> str:
    """The same map without some fields."""
    cloud = read_cloud(path)
    fields = {name: values for name, values in cloud.fields.items() if name not in names}
    target = str(Path(path).with_name("without_" + "_".join(names) + ".ply"))
    write_cloud(target, PointCloud.from_world(cloud.world(), fields))
    return target


def in_tiles(path: str, n_tiles: int, model: Model) -> Result:
    settings = Configuration(tiles=TileSettings(tile_points=-(-len(read_cloud(path)) // n_tiles)))
    with work_folder(path) as folder:
        return assess_map(cut_map(open_map(path, AS_IT_IS), settings, map, folder), settings, model, map)


def assert_alike(found: Result, plain: Result) -> None:
    """Nearly all patches are the same, and so nearly are their features; those of windows depend on what is near."""
    tree = cKDTree(plain.patches.centroid)
    distance, theirs = tree.query(found.patches.centroid)
    mine = np.flatnonzero((distance < 1e-3) & (found.patches.counts == plain.patches.counts[theirs]))
    theirs = theirs[mine]
    n_points = plain.patches.counts
    assert n_points[theirs].sum() > 0.95 * n_points.sum()
    assert (found.features.node_names, found.features.edge_names) == (
        plain.features.node_names,
        plain.features.edge_names,
    )
    one, other = found.features.node[mine], plain.features.node[theirs]
    assert np.mean(np.isnan(one) != np.isnan(other), axis=0).max() < 0.03
    away = np.nan_to_num(np.abs(one - other))
    if "n_scans" in found.features.node_names:
        # A count, of which one more or less is as much as a centimetre of the others.
        away[:, found.features.node_names.index("n_scans")] *= 0.01
        # A scan with a point less than counts moves an upper bound as far as it lies off: bounds must hold each other.
        away[:, found.features.node_names.index("disagreement_high")] = 0.0
        (low, _, high), (begin, _, end) = found.features.disagreement[mine].T, plain.features.disagreement[theirs].T
        known = np.isfinite(high) & np.isfinite(end)
        # Without scans, times or passes nothing is known of either.
        assert np.count_nonzero(~((low <= end) & (begin <= high))[known]) <= 0.02 * np.count_nonzero(known)
    assert np.quantile(away, 0.95, axis=0).max() < 0.05
    number = np.full(len(found.patches), -1)
    number[mine] = theirs
    pairs = {tuple(sorted(pair)) for pair in number[found.features.pairs].tolist() if min(pair) >= 0}
    known = {tuple(sorted(pair)) for pair in plain.features.pairs.tolist()}
    assert len(pairs - known) < 0.02 * len(known)
    assert len(pairs) > 0.95 * len(known)
    # Whether a scan has ten points on a patch decides labels too, at few patches.
    assert np.mean(found.labelling.label[mine] != plain.labelling.label[theirs]) < 0.025


@pytest.mark.parametrize(
    "missing",
    [
        (),
        *(
            pytest.param(names, marks=pytest.mark.slow)
            for names in (("scan",), ("scan", "time"), ("scan", "time", "pass_id"))
        ),
    ],
)
def test_tiles_have_the_features_of_the_map_in_memory(drive, model, missing):
    """Moments are scans, times, or passes, or not known."""
    path = without(drive, missing) if missing else drive
    plain = assess(segment(read_cloud(path)), model)
    assert_alike(in_tiles(path, TILES, model), plain)
    for name in ("shift_support", *(() if "pass_id" in missing else ("disagreement",))):
        column = plain.features.node[:, plain.features.node_names.index(name)]
        assert np.count_nonzero(np.isfinite(column) & (column > 0.0)) > 10, name


@pytest.mark.slow
def test_a_map_turned_by_a_quarter_has_the_same_features_in_tiles(drive, model):
    path = str(Path(drive).with_name("turned.ply"))
    write_cloud(path, turn_cloud(read_cloud(drive), 1))
    known, found = in_tiles(drive, TILES, model), in_tiles(path, TILES, model)
    assert len(found.patches) > 100
    assert found.patches.parameters == known.patches.parameters == segment(read_cloud(drive)).parameters
    for name in ("node", "pairs", "edge", "shape"):
        np.testing.assert_array_equal(getattr(found.features, name), getattr(known.features, name))
    np.testing.assert_array_equal(found.labelling.difference, known.labelling.difference)
    for name in ("normal", "centroid"):
        np.testing.assert_array_equal(turn(getattr(found.patches, name), -1), getattr(known.patches, name))
    for one, two in zip(known.regions, found.regions, strict=True):
        corners = turn(np.array([two.low, two.high]), -1)
        np.testing.assert_array_equal(np.sort(corners, axis=0), [one.low, one.high])


@pytest.mark.parametrize("missing", [("scan", "time"), pytest.param(("to_sensor_x",), marks=pytest.mark.slow)])
def test_tiles_have_the_causes_of_the_map_in_memory(drive, model, missing):
    """Where one range of points is all of the map, and a patch is suspicious in both, they are nearly the same."""
    path = without(drive, missing)
    plain, found = assess(segment(read_cloud(path)), model), in_tiles(path, TILES, model)
    assert plain.visits is not None
    assert found.visits is not None
    assert found.visits.unit == plain.visits.unit
    distance, theirs = cKDTree(plain.patches.centroid).query(found.patches.centroid)
    both = [i for i in found.causes if distance[i] < 1e-3 and int(theirs[i]) in plain.causes]
    assert len(both) > 0.95 * len(plain.causes) > 10
    # Disagreements are those of windows, which in tiles see a little less: a cause may just be found, or not.
    assert np.mean([found.causes[i].kind == plain.causes[int(theirs[i])].kind for i in both]) > 0.9
    assert found.scans_apart == pytest.approx(plain.scans_apart, abs=0.02, nan_ok=True)


@pytest.mark.slow
def test_points_of_a_result_in_tiles_have_causes(drive, model, tmp_path):
    target = str(tmp_path / "result.ply")
    result = classify_map(drive, target, model, Configuration(tiles=TileSettings(tile_points=20_000)), False)
    fields = read_cloud(target).fields
    codes = result.cause_codes()
    assert codes is not None
    np.testing.assert_array_equal(fields["cause"], np.append(codes, np.uint8(255))[fields["patch"]])


def test_a_map_without_fields_has_unknown_causes(drive, model):
    path = without(drive, ("scan", "time", "pass_id"))
    found = in_tiles(path, TILES, replace(model, threshold=-50.0))
    assert found.visits is None
    assert found.cause_codes() is None
    assert {cause.text for cause in found.causes.values()} == {
        "the map does not record by which scans or when it was seen"
    }


class TestWhichFieldsCount:
    def test_of_parts_it_is_decided_as_of_the_whole(self):
        whole = PointCloud(np.zeros((4, 3)), np.zeros(3), {"pass_id": np.array([1, 1, 2, 2]), "time": np.arange(4.0)})
        parts = [Span(1.0, 1.0), Span(2.0, 2.0)]
        joined = parts[0].joined(parts[1])
        assert decide({"pass_id": parts[0]}).moment is None
        assert decide({"pass_id": joined}) == Known("pass_id", 0.0, False) == known_of(whole)

    def test_a_field_with_a_value_that_is_none_does_not(self):
        for span in (Span(0.0, 3.0, is_known=False), Span(0.0, 3.0, is_whole=False)):
            assert decide({"scan": Span(0.0, 1.0).joined(span)}).moment is None
