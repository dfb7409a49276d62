"""ROS maps: what map_server makes of them is the posterior."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import shapely
from matplotlib.image import imread
from scipy import ndimage

from prf.model.coloring import Draws, black_at, from_polygons
from prf.model.layout import image_grid, pixel_centres
from prf.model.window import Window
from prf.output.export import Options, export_source
from prf.output.export.cells import Raster, cells_of
from prf.output.export.ros import pgm_bytes, png_bytes, ros_map
from prf.output.export.source import read_source
from prf.output.run import read_run
from prf.results import write_run
from prf.results.estimate import occupied_probability, path_free
from prf.results.occupancy import OccupancyGrid, write_grid
from prf.shell.errors import InputError, UsageError
from tests.factories import make_run
from tests.output.export import map_server


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run whose window is no multiple of a cell: centres of the last row and column lie outside."""
    path = tmp_path_factory.mktemp("ros") / "office"
    write_run(path, make_run(n_draws=40, window=Window(-10.3, -5.2, 20.1, 9.2)))
    return path


@pytest.fixture
def ramp() -> Raster:
    """Return every probability from 0 to 1, rows of different content, and cells of which nothing is known."""
    probability = np.linspace(0.0, 1.0, 1001)[:1000].reshape(10, 100).astype(np.float32)
    probability[3, 7] = probability[9, 0] = np.nan
    probability[0, 99] = 1.0
    return Raster(probability, np.array([-12.25, 1e-5]), 0.05)


def serve(cells: Raster, folder: Path, unknown: tuple[float, float] | None = None):
    made = ros_map(cells, unknown, "map.pgm")
    (folder / "map.pgm").write_bytes(made[1])
    (folder / "map.yaml").write_text(made[0])
    return map_server.load(folder / "map.yaml"), made


def test_round_trip(ramp: Raster, tmp_path: Path) -> None:
    served, made = serve(ramp, tmp_path)
    p = ramp.probability.astype(float)
    expected = np.where(p > 0.65, 100, np.where(p < 0.196, 0, -1))
    np.testing.assert_array_equal(served.data, expected)
    assert set(np.unique(expected)) == {-1, 0, 100}
    assert made[2] == {
        "n_free": (expected == 0).sum(),
        "n_occupied": (expected == 100).sum(),
        "n_unknown": (expected == -1).sum(),
    }
    assert (served.resolution, served.origin) == (0.05, [-12.25, 0.00001, 0.0])


def test_thresholds_and_pixels_are_those_that_keep_unknown_cells_unknown(ramp: Raster, tmp_path: Path) -> None:
    served, made = serve(ramp, tmp_path)
    content = map_server.read_yaml(tmp_path / "map.yaml")
    assert (content["free_thresh"], content["occupied_thresh"], content["negate"]) == ("0.196", "0.65", "0")
    assert set(np.unique(map_server.read_pgm(tmp_path / "map.pgm"))) == {0, 205, 254}
    # The threshold that others write turns every unknown cell into free space: the reader sees it.
    (tmp_path / "map.yaml").write_text(made[0].replace("0.196", "0.25"))
    mistaken = map_server.load(tmp_path / "map.yaml")
    assert (served.data == -1).any()
    assert not (mistaken.data == -1).any()


@pytest.mark.parametrize("band", [(0.5, 0.5), (0.0, 0.25), (0.05, 0.95), (0.0, 1.0)])
def test_the_unknown_band_is_the_users(ramp: Raster, tmp_path: Path, band: tuple[float, float]) -> None:
    served, _ = serve(ramp, tmp_path, band)
    p = ramp.probability.astype(float)
    np.testing.assert_array_equal(served.data, np.where(p > band[1], 100, np.where(p < band[0], 0, -1)))


def test_other_readers_see_the_same_pixels(tmp_path: Path) -> None:
    grey = np.random.default_rng(3).integers(0, 256, (7, 11), dtype=np.uint8)
    (tmp_path / "a.pgm").write_bytes(pgm_bytes(grey))
    np.testing.assert_array_equal(imread(tmp_path / "a.pgm"), grey)


@pytest.mark.parametrize("squares", [False, True])
def test_a_run_from_its_directory_to_the_server(folder: Path, tmp_path: Path, squares: bool) -> None:
    image = read_run(folder).image
    own = Options(format="ros-map", squares=squares, resolution=image.resolution)
    done = export_source(folder, str(tmp_path / "office.yaml"), own)
    served = map_server.load(tmp_path / "office.yaml")
    p = np.where(image.seen, image.square_occupancy if squares else image.occupancy, np.nan).astype(float)
    np.testing.assert_array_equal(served.data, np.where(p > 0.65, 100, np.where(p < 0.196, 0, -1)))
    assert (served.resolution, served.origin) == (image.resolution, [*image.origin.tolist(), 0.0])
    assert np.isnan(p[-1]).all(), "the window ends before the last row's centres"
    assert [Path(file["path"]).name for file in done.files] == ["office.yaml", "office.pgm", "office.nav2.yaml"]
    assert [file["bytes"] for file in done.files] == [Path(file["path"]).stat().st_size for file in done.files]


def test_one_map_has_its_colours_at_the_places_of_the_server(folder: Path, tmp_path: Path) -> None:
    run = read_run(folder)
    export_source(folder / "map.geojson", str(tmp_path / "best.pgm"), Options(format="ros-map", resolution=0.17))
    served = map_server.load(tmp_path / "best.yaml")
    height, width = served.data.shape
    x = served.origin[0] + served.resolution * (np.arange(width) + 0.5)
    y = served.origin[1] + served.resolution * (np.arange(height) + 0.5)
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = run.draws.window.contains(centres)
    data = served.data.ravel()
    np.testing.assert_array_equal(data[inside] == 100, black_at(run.best, centres[inside]))
    assert (data[~inside] == -1).all()
    assert {0, 100} <= set(data[inside].tolist()) <= {0, 100}


def test_a_draw_has_cells_of_5_cm(folder: Path, tmp_path: Path) -> None:
    run = read_run(folder)
    export_source(folder, str(tmp_path / "last.yaml"), Options(format="ros-map", draw=-1))
    served = map_server.load(tmp_path / "last.yaml")
    window = run.draws.window
    centres = pixel_centres(image_grid(window, 0.05))
    inside = window.contains(centres) & run.image.seen_at(centres)
    np.testing.assert_array_equal(served.data.ravel()[inside] == 100, black_at(run.draws[-1], centres[inside]))
    assert (served.data.ravel()[~inside] == -1).all()


def test_what_no_reading_saw_is_unknown_but_near_it_with_extrapolate(folder: Path, tmp_path: Path) -> None:
    image = read_run(folder).image
    centres = pixel_centres(image_grid(read_run(folder).draws.window, image.resolution))
    seen = centres[image.seen.ravel()]
    away = np.hypot(*(centres[:, None] - seen[None]).transpose(2, 0, 1)).min(axis=1).reshape(image.seen.shape)
    assert 0.0 < away.max() <= 1.5
    for extrapolate in (0.0, 1.0, 2.0):
        known = (away <= extrapolate + 1e-9) & ~np.isnan(image.occupancy)
        cells = cells_of(read_source(folder), extrapolate=extrapolate, resolution=image.resolution)
        np.testing.assert_array_equal(~np.isnan(cells.probability), known)


@pytest.mark.parametrize("resolution", [0.21, None])
def test_a_run_takes_finer_cells_from_its_draws(folder: Path, resolution: float | None) -> None:
    run = read_run(folder)
    cells = cells_of(read_source(folder), extrapolate=100.0, resolution=resolution)
    centres = pixel_centres(image_grid(run.draws.window, resolution or 0.05))
    inside = run.draws.window.contains(centres)
    p = occupied_probability(run.draws, centres[inside])
    np.testing.assert_allclose(cells.probability.ravel()[inside], p)


def test_returns_are_those_of_a_beam_that_comes_to_a_cell(folder: Path, tmp_path: Path) -> None:
    run, options = read_run(folder), Options(format="ros-map", returns=True, resolution=0.2)
    facts = export_source(folder, str(tmp_path / "met.yaml"), options).facts
    assert facts["probability"] == "p_return"
    served = map_server.load(tmp_path / "met.yaml")
    centres = pixel_centres(image_grid(run.draws.window, served.resolution))
    known = run.draws.window.contains(centres) & run.image.seen_at(centres)
    assert (served.data.ravel()[~known] == -1).all()
    p = run.return_probability(centres[known])
    np.testing.assert_array_equal(served.data.ravel()[known], np.where(p > 0.65, 100, np.where(p < 0.196, 0, -1)))
    assert len(np.unique(served.data[served.data >= 0])) == 2


@pytest.mark.parametrize("mode", ["scale", "raw"])
@pytest.mark.parametrize("ros", [1, 2])
def test_percent_is_served_to_the_percent_and_the_unknown_as_such(ramp: Raster, tmp_path: Path, mode, ros) -> None:
    image = "map.png" if mode == "scale" else "map.pgm"
    yaml, pixels, counts = ros_map(ramp, None, image, mode)
    (tmp_path / "map.yaml").write_text(yaml)
    (tmp_path / image).write_bytes(pixels)
    served = map_server.load(tmp_path / "map.yaml", ros).data
    known = np.isfinite(ramp.probability)
    percent = np.rint(100.0 * ramp.probability[known].astype(float))
    assert counts == {"n_known": known.sum(), "n_unknown": 2}
    if mode == "scale" and ros == 1:  # 99 parts of a hundred, cut off; certainty, transparent or not, is not unknown
        assert np.abs(served[known] - percent).max() <= 2
        return
    assert (served[~known] == -1).all()
    np.testing.assert_array_equal(served[known], percent)


def test_a_png_is_read_by_others(tmp_path: Path) -> None:
    pixels = np.random.default_rng(3).integers(0, 256, (7, 11, 4), dtype=np.uint8)
    (tmp_path / "a.png").write_bytes(png_bytes(pixels))
    np.testing.assert_array_equal(np.rint(255 * imread(tmp_path / "a.png")), pixels)


@pytest.mark.parametrize(
    "radius", [pytest.param(0.05, marks=pytest.mark.slow), 0.4, pytest.param(1.3, marks=pytest.mark.slow)]
)
def test_a_cell_of_a_radius_is_what_a_disc_there_is_asked_by_query(folder: Path, tmp_path: Path, radius: float) -> None:
    run = read_run(folder)
    own = Options(format="ros-map", mode="raw", radius=radius, resolution=0.4)
    done = export_source(folder, str(tmp_path / "disc.yaml"), own)
    assert done.facts["probability"] == "p_not_free"
    served = map_server.load(tmp_path / "disc.yaml").data.ravel()
    centres = pixel_centres(image_grid(run.draws.window, 0.4))
    known = run.draws.window.contains(centres) & run.image.seen_at(centres)
    np.testing.assert_array_equal(served == -1, ~known)
    free = [path_free(run.draws, centre[None], radius) for centre in centres[known][::5]]
    p = cells_of(read_source(folder), radius=radius, resolution=0.4).probability.ravel()[known]
    np.testing.assert_allclose(p[::5], 1.0 - np.array(free), atol=1e-12)
    np.testing.assert_array_equal(served[known], np.rint(100.0 * p))
    assert len(np.unique(served)) > 5


def test_inflation_by_draws_is_not_that_of_the_mean(folder: Path) -> None:
    """A disc meets one wall or another in different draws: more often than any of its cells is occupied."""
    source = read_source(folder)
    plain = cells_of(source, extrapolate=100.0, resolution=0.2).probability
    disc = cells_of(source, extrapolate=100.0, radius=0.5, resolution=0.2).probability
    inside = np.isfinite(plain)
    assert (disc[inside] >= plain[inside] - 1e-9).all()
    rows, columns = np.mgrid[-2:3, -2:3]
    near = ((rows**2 + columns**2) * 0.2**2 <= 0.5**2).astype(bool)
    swollen = ndimage.maximum_filter(np.nan_to_num(plain), footprint=near)
    assert (disc[inside] > swollen[inside] + 0.1).any()


def test_a_mask_keeps_out_of_cells_above_its_probability(folder: Path, tmp_path: Path) -> None:
    own = Options(format="ros-map", radius=0.3, keep_out=0.1, resolution=0.4)
    export_source(folder, str(tmp_path / "mask"), own)
    served = map_server.load(tmp_path / "mask.yaml").data
    p = cells_of(read_source(folder), radius=0.3, resolution=0.4).probability
    np.testing.assert_array_equal(served, np.where(p > 0.1, 100, np.where(p < 0.1, 0, -1)))
    written = (tmp_path / "mask.nav2.yaml").read_text()
    assert written.startswith("# To be merged into the robot's parameters")
    assert f'yaml_filename: "{tmp_path}/mask.yaml"' in written
    assert "nav2_costmap_2d::KeepoutFilter" in written


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_parameters_of_nav2_load_the_map_from_anywhere_and_say_how_costs_are_made(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode
) -> None:
    yaml = pytest.importorskip("yaml")
    source = folder.resolve()
    with monkeypatch.context() as there:
        there.chdir(tmp_path)
        export_source(source, "a b.yaml", Options(format="ros-map", mode=mode, resolution=1.0))
    written = yaml.safe_load((tmp_path / "a b.nav2.yaml").read_text())
    named = written["map_server"]["ros__parameters"]["yaml_filename"]
    assert named == str(tmp_path / "a b.yaml")
    assert map_server.load(Path(named)).data.size > 0
    costmap = written["global_costmap"]["global_costmap"]["ros__parameters"]
    assert costmap["track_unknown_space"] is True
    assert costmap.get("trinary_costmap", True) == (mode == "trinary")
    mask = tmp_path / "m.yaml"
    export_source(folder, str(mask), Options(format="ros-map", keep_out=0.2, resolution=1.0))
    written = yaml.safe_load(mask.with_suffix(".nav2.yaml").read_text())
    topics = {written[name]["ros__parameters"][key] for name, key in MASK_TOPICS}
    assert topics == {"keepout_filter_mask"}


MASK_TOPICS = (("filter_mask_server", "topic_name"), ("costmap_filter_info_server", "mask_topic"))


def test_options_of_costmaps_that_do_not_go_together(folder: Path, tmp_path: Path) -> None:
    for options, words in (
        ({"mode": "raw", "unknown": (0.1, 0.2)}, "leave --unknown and --keep-out out"),
        ({"keep_out": 0.1, "unknown": (0.1, 0.2)}, "leave --unknown out"),
        ({"keep_out": 1.0}, "below 1"),
        ({"radius": 0.0}, "positive number of metres"),
        ({"radius": 0.3, "returns": True}, "leave --squares and --returns out"),
    ):
        with pytest.raises(UsageError, match=words):
            export_source(folder, str(tmp_path / "a.yaml"), Options(format="ros-map", **options))
    with pytest.raises(UsageError, match="--radius is for --format ros-map only"):
        export_source(folder, str(tmp_path / "a.svg"), Options(format="svg", radius=0.3))
    write_grid(tmp_path / "a.grid.npz", OccupancyGrid(*np.zeros((3, 2, 2), np.int32), np.zeros(2), 0.1))
    with pytest.raises(UsageError, match="a GRID has no whole maps"):
        export_source(tmp_path / "a.grid.npz", str(tmp_path / "a.yaml"), Options(format="ros-map", radius=0.3))


def test_a_grid_serves_what_was_seen(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    hits, misses = rng.integers(0, 3, (2, 6, 9), dtype=np.int32)
    occupancy = ((hits + 0.5) / (hits + misses + 1.0)).astype(np.float32)
    grid = OccupancyGrid(occupancy, hits, misses, np.array([-3.5, 2.0]), 0.1)
    write_grid(tmp_path / "room.grid.npz", grid)
    export_source(tmp_path / "room.grid.npz", str(tmp_path / "room.yaml"), Options(format="ros-map"))
    served = map_server.load(tmp_path / "room.yaml")
    expected = np.where(occupancy > 0.65, 100, np.where(occupancy < 0.196, 0, -1))
    np.testing.assert_array_equal(served.data, expected)
    assert (served.resolution, served.origin) == (0.1, [-3.5, 2.0, 0.0])


def test_thin_walls_are_seen_with_squares_only(tmp_path: Path) -> None:
    """A wall of a centimetre between the centres of cells."""
    import json

    wall = [[[0.0, 1.02], [0.0, 1.03], [4.0, 1.03], [4.0, 1.02], [0.0, 1.02]]]
    feature = {
        "schema": "prf.map/1",
        "type": "Feature",
        "geometry": {"type": "MultiPolygon", "coordinates": [[ring[::-1] for ring in wall]]},
        "properties": {"window": [-1.0, 0.0, 5.0, 2.0], "anchor_black": False},
    }
    (tmp_path / "wall.geojson").write_text(json.dumps(feature))
    seen = []
    for squares in (False, True):
        export_source(
            tmp_path / "wall.geojson",
            str(tmp_path / f"{squares}.yaml"),
            Options(format="ros-map", squares=squares, resolution=0.1),
        )
        seen.append((map_server.load(tmp_path / f"{squares}.yaml").data == 100).sum())
    assert seen[0] == 0
    assert 40 <= seen[1] <= 42


@pytest.mark.parametrize("name", ["map 1.yaml", "a'b.yaml"])
def test_odd_names_are_quoted(folder: Path, tmp_path: Path, name: str) -> None:
    export_source(folder, str(tmp_path / name), Options(format="ros-map"))
    line = (tmp_path / name).read_text().splitlines()[0]
    assert line == f'image: "{Path(name).stem}.pgm"'
    map_server.load(tmp_path / name)


def test_what_a_ros_map_cannot_be_made_from(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="squares of its own image alone"):
        export_source(folder, str(tmp_path / "a.yaml"), Options(format="ros-map", resolution=0.1, squares=True))
    with pytest.raises(UsageError, match="more than"):
        export_source(folder, str(tmp_path / "a.yaml"), Options(format="ros-map", resolution=1e-3, draw=0))
    with pytest.raises(UsageError, match="leave --squares and --draw out"):
        export_source(folder, str(tmp_path / "a.yaml"), Options(format="ros-map", returns=True, draw=0))
    with pytest.raises(UsageError, match="--returns is for --format ros-map only"):
        export_source(folder, str(tmp_path / "a.svg"), Options(format="svg", returns=True))
    with pytest.raises(InputError, match="one map has no returns"):
        export_source(folder / "map.geojson", str(tmp_path / "a.yaml"), Options(format="ros-map", returns=True))
    write_run(tmp_path / "blind", dataclasses.replace(make_run(), laser=None))
    with pytest.raises(InputError, match="used no laser"):
        export_source(tmp_path / "blind", str(tmp_path / "a.yaml"), Options(format="ros-map", returns=True))
    early = make_run(n_draws=0)
    write_run(tmp_path / "early", early)
    with pytest.raises(InputError, match=r"posterior\.npz: no such file"):
        export_source(tmp_path / "early", str(tmp_path / "a.yaml"), Options(format="ros-map"))
    assert {path.name for path in tmp_path.iterdir()} == {"blind", "early"}


def test_a_wall_that_lies_elsewhere_in_every_draw_is_told_of(tmp_path: Path) -> None:
    window = Window(0.0, 0.0, 4.0, 3.0)
    walls = [shapely.box(2.0 + 0.06 * k, 0.2, 2.05 + 0.06 * k, 2.8) for k in range(6)]
    for name, places in (("blurred", walls), ("sharp", walls[:1] * 6)):
        run = make_run(n_draws=len(places), window=window)
        draws = Draws.from_colorings([from_polygons(place, window) for place in places])
        everywhere = run.image._replace(seen=np.ones_like(run.image.seen))
        write_run(tmp_path / name, dataclasses.replace(run, draws=draws, image=everywhere))
        done = export_source(
            tmp_path / name, str(tmp_path / f"{name}.yaml"), Options(format="ros-map", resolution=0.05)
        )
        closed = done.facts["free_but_closed_m2"]
        data = map_server.load(tmp_path / f"{name}.yaml").data
        is_open = ndimage.label(data == 0)[0][data.shape[0] // 2][[10, -10]]
        if name == "sharp":
            assert (closed, done.facts["free_but_closed_at"]) == (0.0, None)
        else:
            assert done.facts["free_but_closed_at"] == pytest.approx((2.17, 1.5), abs=0.1)
            assert is_open[0] == is_open[1] > 0, "cell by cell one walks through"
            assert 0.2 * 2.6 < closed < 0.7 * 2.6
            assert any("closed to a disc of 0.2 m" in note for note in done.notes) == (closed > 1.0)
