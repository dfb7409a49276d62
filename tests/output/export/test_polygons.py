"""GeoJSON, SVG and DXF: each read back, each the area that the map has."""

from __future__ import annotations

import dataclasses
import importlib.util
import io
import json
import math
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.model.coloring import (
    Coloring,
    Draws,
    black_areas,
    from_polygons,
    occupied_polygons,
    oriented_polygons,
)
from prf.model.window import Window
from prf.output.export import Options, export_source
from prf.output.export.cells import WALL, cut_to_known
from prf.output.export.drawings import dxf_text, paper_ratio, svg_text
from prf.output.export.export import _counts as counts
from prf.output.export.netcdf import align_chains
from prf.output.export.outlines import APART, _parted, edge_probability, outlines, simplified
from prf.output.export.source import Map
from prf.output.run import Run
from prf.results import PosteriorImage, map_text, read_map_feature, write_run
from prf.shell.errors import InputError, UsageError
from tests.factories import WINDOW, make_room_run, make_run, random_draws

SVG = "{http://www.w3.org/2000/svg}"
MAPS = [*random_draws(5, 4), Coloring.empty(WINDOW), Coloring.empty(WINDOW, black=True)]


def area_of(coloring: Coloring) -> float:
    return float(black_areas(Draws.from_colorings([coloring]))[0])


def read_svg(text: str) -> tuple[ElementTree.Element, shapely.Geometry]:
    """Return the document, and the area that its paths fill by the even-odd rule."""
    root = ElementTree.fromstring(text)
    group = root.find(f"{SVG}g[@id='map']/{SVG}g[@id='occupied']")
    assert group.get("fill-rule") == "evenodd"
    filled = shapely.Polygon()
    for path in group:
        for ring in re.findall(r"M([^Z]*)Z", path.get("d")):
            corners = [tuple(map(float, corner.split())) for corner in ring.split("L")]
            filled = filled.symmetric_difference(shapely.make_valid(shapely.Polygon(corners)))
    return root, filled


def read_dxf(text: str):
    ezdxf = pytest.importorskip("ezdxf")
    return ezdxf.read(io.StringIO(text))


@pytest.mark.parametrize("coloring", MAPS)
def test_geojson_is_valid_oriented_and_read_again(coloring: Coloring, tmp_path: Path) -> None:
    area = oriented_polygons(coloring)
    (tmp_path / "map.geojson").write_text(map_text(coloring, {"log_posterior": -1.5}))
    feature = json.loads((tmp_path / "map.geojson").read_text())
    shape = shapely.geometry.shape(feature["geometry"]) if len(area.geoms) else area
    assert (feature["type"], feature["geometry"]["type"]) == ("Feature", "MultiPolygon")
    assert shapely.is_valid(shape)
    assert shape.area == pytest.approx(area_of(coloring), abs=1e-9)
    for polygon in shape.geoms:
        assert polygon.exterior.is_ccw
        assert not any(ring.is_ccw for ring in polygon.interiors)
    read, properties = read_map_feature(tmp_path / "map.geojson")
    assert sorted(map(sorted, read.xy[read.edges].tolist())) == sorted(
        map(sorted, coloring.xy[coloring.edges].tolist())
    )
    assert (read.anchor_black, properties["log_posterior"]) == (coloring.anchor_black, -1.5)


def test_holes_are_kept_and_counted() -> None:
    areas = [oriented_polygons(coloring) for coloring in MAPS]
    found = [counts(area) for area in areas]
    assert sum(one["n_holes"] for one in found) > 0
    assert tuple(found[-2].values()) == (0, 0, 0, 0.0)
    assert tuple(found[-1].values()) == (1, 0, 4, WINDOW.area)
    for area, one in zip(areas, found, strict=True):
        rings = [ring for polygon in area.geoms for ring in (polygon.exterior, *polygon.interiors)]
        assert one["n_vertices"] == sum(len(ring.coords) - 1 for ring in rings)


@pytest.mark.parametrize("coloring", MAPS)
def test_svg_fills_the_occupied_area_in_metres(coloring: Coloring) -> None:
    area = oriented_polygons(coloring)
    root, filled = read_svg(svg_text(area, WINDOW, "a < b & c"))
    assert filled.area == pytest.approx(area.area, abs=1e-4 * area.length + 1e-9)
    assert filled.symmetric_difference(area).area <= 1e-4 * area.length + 1e-9
    assert root.find(f"{SVG}title").text == "a < b & c"
    assert root.find(f"{SVG}g[@id='map']").get("transform") == "scale(1 -1)"


@pytest.mark.parametrize(
    ("window", "ratio"),
    [
        (WINDOW, 100),
        (Window(0, 0, 41, 30), 200),
        (Window(0, 0, 1, 2), 5),
        (Window(499_950.0, 4_000_000.0, 500_050.0, 4_000_300.0), 1000),
    ],
)
def test_svg_states_its_scale(window: Window, ratio: int) -> None:
    root, _ = read_svg(svg_text(shapely.MultiPolygon(), window, "map"))
    assert paper_ratio(window) == ratio
    x, y, width, height = map(float, root.get("viewBox").split())
    assert (x, -y) == pytest.approx((window.x_min, window.y_max))
    assert float(root.get("width").removesuffix("mm")) == pytest.approx(1e3 * width / ratio, abs=1e-3)
    assert float(root.get("height").removesuffix("mm")) == pytest.approx(1e3 * height / ratio, abs=1e-3)
    assert width == pytest.approx(window.width)
    bar = root.find(f"{SVG}g[@id='scale']")
    words = bar.find(f"{SVG}text").text
    assert words.endswith(f" m, 1:{ratio}")
    start, end = re.search(r"M([-\d.]+) .*H([-\d.]+)V", bar.find(f"{SVG}path").get("d")).groups()
    assert float(end) - float(start) == pytest.approx(float(words.split()[0]))


@pytest.mark.parametrize("coloring", MAPS)
def test_dxf_is_sound_and_has_every_ring(coloring: Coloring) -> None:
    area = oriented_polygons(coloring)
    document = read_dxf(dxf_text(outlines(area, None, 0.0), WINDOW, "office, best map"))
    audit = document.audit()
    assert (audit.errors, audit.fixes) == ([], [])
    assert (document.units, document.header["$MEASUREMENT"]) == (6, 1), "metres"
    lines = list(document.modelspace())
    assert all(line.dxftype() == "LWPOLYLINE" and line.closed for line in lines)
    rings = [shapely.Polygon(line.get_points("xy")) for line in lines if line.dxf.layer == "OCCUPIED"]
    assert len(rings) == sum(list(counts(area).values())[:2])
    signed = [ring.area if ring.exterior.is_ccw else -ring.area for ring in rings]
    assert sum(signed) == pytest.approx(area.area)
    filled = shapely.Polygon()
    for ring in rings:
        filled = filled.symmetric_difference(ring)
    assert shapely.equals(filled, area) or filled.symmetric_difference(area).area < 1e-9
    (outline,) = [line for line in lines if line.dxf.layer == "OUTLINE"]
    assert shapely.Polygon(outline.get_points("xy")).equals(shapely.box(*WINDOW))


def test_dxf_keeps_coordinates_to_the_last_bit() -> None:
    area = oriented_polygons(MAPS[0])
    document = read_dxf(dxf_text(outlines(area, None, 0.0), WINDOW, "map"))
    written = {
        corner for polygon in area.geoms for ring in (polygon.exterior, *polygon.interiors) for corner in ring.coords
    }
    lines = document.modelspace().query('LWPOLYLINE[layer=="OCCUPIED"]')
    assert {(float(x), float(y)) for line in lines for x, y in line.get_points("xy")} == written


# Fewer vertices, and layers by probability.


@pytest.mark.parametrize("coloring", MAPS)
@pytest.mark.parametrize("tolerance", [0.05, 0.3])
def test_simplified_outlines_are_near_and_have_fewer_vertices(coloring: Coloring, tolerance: float) -> None:
    area = oriented_polygons(coloring)
    found = simplified(area, tolerance)
    assert shapely.is_valid(found)
    assert len(found.geoms) == len(area.geoms)
    if not area.is_empty:
        assert shapely.hausdorff_distance(found.boundary, area.boundary, densify=0.05) <= tolerance + 1e-9
        assert shapely.get_num_coordinates(found) <= shapely.get_num_coordinates(area)
    assert simplified(area, 0.0) is area


def test_a_ring_of_many_vertices_on_straight_walls_becomes_its_corners() -> None:
    rng = np.random.default_rng(2)
    along = np.linspace(0.0, 4.0, 60)[:-1]
    sides = [(along, 0), (4, along), (4 - along, 4), (0, 4 - along)]
    ring = np.concatenate([np.column_stack(np.broadcast_arrays(x, y)) for x, y in sides])
    ring = ring + rng.uniform(-0.01, 0.01, ring.shape)
    found = simplified(shapely.MultiPolygon([shapely.Polygon(ring)]), 0.05)
    assert len(found.geoms[0].exterior.coords) - 1 <= 6


@pytest.mark.slow
def test_the_probability_of_an_edge_is_the_share_of_draws_with_a_wall_along_it() -> None:
    """By the definition, draw by draw and place by place, for draws and for edges of theirs and others."""
    draws = Draws.from_colorings(random_draws(5, 12))
    rng = np.random.default_rng(3)
    begin, end = rng.uniform(WINDOW[:2], WINDOW[2:], (2, 30, 2))
    begin[:10], end[:10] = draws[0].xy[draws[0].edges[:10]].transpose(1, 0, 2)
    found = edge_probability(draws, begin, end, 0.2)
    expected = []
    for a, b in zip(begin, end, strict=True):
        n = max(1, math.ceil(math.dist(a, b) / APART))
        boxes = [shapely.box(*(p - 0.2), *(p + 0.2)) for p in a + (np.arange(n)[:, None] + 0.5) / n * (b - a)]
        walls = [shapely.MultiLineString(list(one.xy[one.edges])) for one in draws]
        expected.append(np.mean([[wall.intersects(box) for box in boxes] for wall in walls]))
    np.testing.assert_allclose(found, expected)
    assert (found[:10] >= 1.0 / 12.0).all()


def test_rings_are_parted_where_the_layer_changes_and_joined_across_their_beginning() -> None:
    xy = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    assert [line.is_closed for line in _parted(xy, ["a"] * 4)] == [True]
    lines = _parted(xy, ["a", "b", "b", "a"])
    assert [(line.layer, line.xy.tolist()) for line in lines] == [
        ("b", [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
        ("a", [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]]),
    ]
    assert not any(line.is_closed for line in lines)


def test_layers_of_a_run_are_those_of_its_draws(tmp_path: Path) -> None:
    """Half of the draws have a cupboard that the others have not: its outline is on another layer than the walls."""
    run = make_room_run()
    write_run(tmp_path / "room", run)
    done = export_source(tmp_path / "room", str(tmp_path / "room.dxf"), Options())
    document = read_dxf((tmp_path / "room.dxf").read_text())
    assert (document.audit().errors, document.audit().fixes) == ([], [])
    layers = Counter(line.dxf.layer for line in document.modelspace())
    assert layers["WALL-90"] > 0
    assert layers["OCCUPIED"] == 0
    assert done.facts["n_vertices_before"] >= done.facts["n_vertices"]
    assert {name: n for name, n in layers.items() if name != "OUTLINE"} == {
        key.removeprefix("n_"): value for key, value in done.facts.items() if key.startswith("n_WALL")
    }
    export_source(tmp_path / "room", str(tmp_path / "draw.dxf"), Options(draw=0))
    layers = {line.dxf.layer for line in read_dxf((tmp_path / "draw.dxf").read_text()).modelspace()}
    assert layers == {"OCCUPIED", "OUTLINE"}
    with pytest.raises(UsageError, match="--simplify is for"):
        export_source(tmp_path / "room", str(tmp_path / "a.geojson"), Options(simplify=0.1))


# Polygons end where nothing is known.


CELLS_WINDOW = Window(0.0, 0.0, 10.0, 10.0)


def image_of(seen: np.ndarray) -> PosteriorImage:
    zeros = np.zeros(seen.shape, np.float32)
    return PosteriorImage(zeros, zeros, np.zeros(2), 0.5, seen)


def test_walls_keep_half_a_metre_and_what_is_in_unseen_ground_is_removed() -> None:
    seen = np.zeros((20, 20), np.bool_)
    seen[:, :8] = True  # x < 4
    wall, island = shapely.box(3.6, 2.0, 9.0, 3.1), shapely.box(7.0, 6.0, 8.0, 7.0)
    near = shapely.box(1.0, 7.0, 2.0, 8.0)
    found = Map(from_polygons(shapely.MultiPolygon([wall, island, near]), CELLS_WINDOW), {"draw": 1}, "title")
    cut = cut_to_known(found, image_of(seen), 0.0)
    expected = shapely.union(shapely.box(3.6, 2.0, 4.0 + WALL, 3.1), near)
    assert shapely.symmetric_difference(occupied_polygons(cut.coloring), expected).area < 1e-3
    assert (cut.properties, cut.title) == (found.properties, found.title)
    whole = cut_to_known(found, image_of(seen), 20.0)
    assert (
        shapely.symmetric_difference(occupied_polygons(whole.coloring), occupied_polygons(found.coloring)).area < 1e-3
    )


def test_nothing_is_cut_where_all_was_seen_or_of_a_map_alone() -> None:
    found = Map(from_polygons(shapely.MultiPolygon([shapely.box(1.0, 1.0, 2.0, 2.0)]), CELLS_WINDOW), {}, "title")
    assert cut_to_known(found, image_of(np.ones((20, 20), np.bool_)), 0.0) is found
    assert cut_to_known(found, None, 0.0) is found


def test_a_map_of_which_nothing_is_known_is_empty() -> None:
    seen = np.zeros((20, 20), np.bool_)
    seen[0, 0] = True
    found = Map(from_polygons(shapely.MultiPolygon([shapely.box(5.0, 5.0, 6.0, 6.0)]), CELLS_WINDOW), {}, "title")
    assert cut_to_known(found, image_of(seen), 0.0).coloring.n_edges == 0


def test_a_window_that_is_all_occupied_stays_so() -> None:
    seen = np.ones((20, 20), np.bool_)
    seen[0, 0] = False
    found = Map(Coloring.empty(CELLS_WINDOW, black=True), {}, "title")
    assert cut_to_known(found, image_of(seen), 0.0).coloring.anchor_black


# netCDF: opened again by xarray, and by ArviZ where it is installed.


xarray = pytest.importorskip("xarray")
pytest.importorskip("h5netcdf")


def make_full_run(n_draws: int) -> Run:
    run = make_run(n_draws=n_draws)
    rng = np.random.default_rng(2)
    likelihoods = {"log_prior": rng.normal(size=n_draws), "log_likelihood": rng.normal(size=n_draws)}
    manifest = {
        **run.manifest,
        "created": "2030-01-02T03:04:05+00:00",
        "versions": {"prf": "9.9"},
        "steps": 5000,
        "seed": 2**70,
    }
    diagnostics = {**run.diagnostics, "acceptance": {"split": {"proposed": 10, "accepted": 3}}}
    functionals = {**run.functionals, **likelihoods}
    return dataclasses.replace(run, manifest=manifest, functionals=functionals, diagnostics=diagnostics)


@pytest.fixture
def exported(tmp_path: Path) -> tuple[Run, Path]:
    """Return a run of 4 chains, two of them one draw longer, and its export."""
    run = make_full_run(14)
    write_run(tmp_path / "office", run)
    done = export_source(tmp_path / "office", str(tmp_path / "office.nc"), Options())
    assert done.facts == {"n_chains": 4, "n_draws_per_chain": 3, "n_draws_left_out": 2}
    assert "2 of 14 draws left out" in done.notes[0]
    return run, tmp_path / "office.nc"


def test_values_of_every_chain_and_draw(exported: tuple[Run, Path]) -> None:
    run, path = exported
    with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as posterior:
        assert set(posterior.data_vars) == {*run.functionals, "probe_black"}
        assert posterior["n_edges"].dims == ("chain", "draw")
        assert posterior["probe_black"].dims == ("chain", "draw", "probe")
        for chain in range(4):
            rows = np.flatnonzero(run.chain == chain)[:3]
            for name, values in run.functionals.items():
                np.testing.assert_array_equal(posterior[name].sel(chain=chain), values[rows])
            np.testing.assert_array_equal(posterior["probe_black"].sel(chain=chain) == 1, run.probe_black[rows])
        np.testing.assert_array_equal(posterior["probe_x"], run.probe_xy[:, 0])
        np.testing.assert_array_equal(posterior["probe_y"], run.probe_xy[:, 1])
        assert posterior["total_length"].attrs["units"] == "m"


def test_sample_stats_and_provenance(exported: tuple[Run, Path]) -> None:
    run, path = exported
    with xarray.open_dataset(path, group="sample_stats", engine="h5netcdf") as stats:
        np.testing.assert_array_equal(stats["step"][0], [1000, 2000, 3000])
        total = run.functionals["log_prior"] + run.functionals["log_likelihood"]
        np.testing.assert_array_equal(stats["lp"].sel(chain=2), total[run.chain == 2])
        assert json.loads(stats.attrs["acceptance"]) == {"split": {"proposed": 10, "accepted": 3}}
        assert stats.attrs["inference_library"] == "prf"
    with xarray.open_dataset(path, engine="h5netcdf") as root:
        assert root.attrs["schema"] == "prf.netcdf/1"
        assert (root.attrs["prf_version"], root.attrs["created_at"]) == ("9.9", "2030-01-02T03:04:05+00:00")
        assert (root.attrs["seed"], root.attrs["steps"]) == (str(2**70), 5000), "too large for a number of netCDF"
        assert json.loads(root.attrs["configuration"]) == {"scale": 0.1}
        assert root.attrs["n_draws_left_out"] == 2


@pytest.mark.skipif(importlib.util.find_spec("arviz") is None, reason="ArviZ is not installed")
def test_arviz_opens_it(exported: tuple[Run, Path]) -> None:
    arviz = pytest.importorskip("arviz")
    data = arviz.from_netcdf(str(exported[1]))
    assert data.posterior["n_edges"].shape == (4, 3)


def test_chains_are_ordered_by_step_and_cut_to_the_shortest() -> None:
    run = dataclasses.replace(
        make_run(n_draws=7),
        chain=np.array([5, 5, 2, 5, 2, 2, 5], np.int32),
        step=np.array([30, 10, 10, 20, 30, 20, 40], np.int64),
    )
    np.testing.assert_array_equal(align_chains(run), [[2, 5, 4], [1, 3, 0]])


def test_without_draws_there_is_nothing_to_export(tmp_path: Path) -> None:
    write_run(tmp_path / "early", make_run(n_draws=0))
    with pytest.raises(InputError, match="no draws yet"):
        export_source(tmp_path / "early", str(tmp_path / "early.nc"), Options())
    assert not (tmp_path / "early.nc").exists()
