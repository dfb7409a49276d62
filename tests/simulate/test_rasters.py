"""ROS maps as worlds: what map_server would serve, contours exact before they are made straight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from prf.coloring import violations
from prf.export.cells import Cells, rasterise
from prf.export.ros_map import ros_map
from prf.shell.errors import InputError
from prf.simulate import OfficePlan, World, office, read_world
from prf.simulate.rasters import CellMap, _joined, cell_contours, read_cell_map, world_of_cells
from prf.window import Window
from tests.export.map_server import load


def write_map(folder: Path, probability: np.ndarray, mode: str = "trinary", resolution: float = 0.1) -> Path:
    image = "map.png" if mode == "scale" else "map.pgm"
    cells = Cells(probability, np.array([-3.0, 2.0]), resolution)
    files = ros_map(cells, mode, None, image)
    (folder / "map.yaml").write_text(files.yaml)
    (folder / image).write_bytes(files.image)
    return folder / "map.yaml"


def random_cells(rng: np.random.Generator) -> np.ndarray:
    return np.pad(rng.random((7, 9)) < rng.uniform(0.2, 0.8), 2, constant_values=bool(rng.integers(2)))


def test_contours_are_exact() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        taken = _joined(random_cells(rng))
        area = cell_contours(taken)
        cells = [box(x, y, x + 1, y + 1) for y, x in np.argwhere(taken)]
        assert area.is_valid
        assert area.symmetric_difference(shapely.union_all(cells)).area == 0.0


def test_cells_that_touch_at_a_corner_are_joined_and_none_goes() -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        taken = random_cells(rng)
        joined = _joined(taken)
        assert joined[taken].all()
        blocks = np.stack([joined[:-1, :-1], joined[:-1, 1:], joined[1:, 1:], joined[1:, :-1]])
        assert not ((blocks[0] == blocks[2]) & (blocks[1] == blocks[3]) & (blocks[0] != blocks[1])).any()
    square = np.zeros((6, 6), bool)
    square[2:4, 2:4] = True
    assert np.array_equal(_joined(square), square)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_maps_are_read_as_map_server_serves_them(mode: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    probability = rng.choice([0.0, 0.1, 0.9, 1.0, np.nan], (12, 17))
    path = write_map(tmp_path, probability, mode)
    cells = read_cell_map(path)
    served = load(path)
    assert np.array_equal(cells.unknown, served.data == -1)
    assert np.array_equal(cells.occupied, served.data > 65)
    assert (cells.origin, cells.resolution) == ((-3.0, 2.0), 0.1)


@pytest.mark.parametrize("unknown_is_occupied", [False, True])
def test_any_cells_make_a_valid_world(unknown_is_occupied: bool) -> None:
    rng = np.random.default_rng(4)
    for _ in range(60):
        state = rng.integers(0, 3, (12, 15))
        cells = CellMap(state == 1, state == 2, (1.0, -2.0), 0.5)
        world = world_of_cells(cells, unknown_is_occupied)
        assert violations(world.coloring()) == []
        assert world.window == (0.0, -3.0, 9.5, 5.0)


def test_a_floor_comes_back_from_its_raster(tmp_path: Path) -> None:
    """Walls within a cell of where they were; of the few dozen of a slanted room one wall each."""
    truth = office(OfficePlan(14.0, 9.0, furniture=False), np.random.default_rng(5))
    cells = rasterise(truth.coloring(), 0.02, squares=False)
    files = ros_map(cells, "trinary", None, "map.pgm")
    (tmp_path / "map.yaml").write_text(files.yaml)
    (tmp_path / "map.pgm").write_bytes(files.image)
    world = read_world(tmp_path / "map.yaml", unknown_is_occupied=False)
    assert world.occupied.symmetric_difference(truth.occupied).area < 0.02 * shapely.length(truth.occupied)
    assert shapely.hausdorff_distance(world.occupied.boundary, truth.occupied.boundary) < 0.05
    assert len(world.walls) < 1.5 * len(truth.walls)


def test_staircases_become_straight() -> None:
    window = Window(0.0, 0.0, 20.0, 20.0)
    slanted = World.from_polygons(Polygon([(3.0, 4.0), (16.0, 9.0), (13.0, 17.0), (4.0, 13.0)]), window)
    raster = rasterise(slanted.coloring(), 0.05, squares=False)
    cells = CellMap(raster.probability > 0.5, np.zeros(raster.probability.shape, bool), (0.0, 0.0), 0.05)
    world = world_of_cells(cells, unknown_is_occupied=False)
    assert 4 <= len(world.walls) <= 16
    assert shapely.hausdorff_distance(world.occupied, slanted.occupied) < 0.11


@pytest.mark.parametrize("unknown_is_occupied", [False, True])
def test_a_map_that_a_robot_made(unknown_is_occupied: bool, shared_data: Path) -> None:
    world = read_world(shared_data / "prf" / "ros1" / "meeting.yaml", unknown_is_occupied)
    assert 500 < len(world.walls) < 3000
    assert world.free_at([(15.0, 15.0)]).all()
    assert world.free_at([(28.0, 2.0)]).all() != unknown_is_occupied


YAML = "image: map.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "not YAML"),
        ("- 1", "not the yaml file"),
        (YAML.replace("0.1", "-1"), "resolution -1"),
        (YAML.replace("0.1", "fine"), "resolution is 'fine'"),
        (YAML.replace("[0.0, 0.0, 0.0]", "[0.0]"), "origin is"),
        (YAML + "mode: colourful\n", "mode 'colourful'"),
        (YAML.replace("image", "picture"), "no image"),
        (YAML, r"map\.yaml: image .*map\.pgm: no such file"),
    ],
)
def test_damaged_maps_are_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_cell_map(tmp_path / "map.yaml")


def test_a_turned_map_is_no_world(tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n2 1\n255\n\xff\x00")
    (tmp_path / "map.yaml").write_text(YAML.replace("0.0]", "0.5]"))
    assert read_cell_map(tmp_path / "map.yaml").yaw == 0.5
    with pytest.raises(InputError, match=r"map\.yaml: origin has the yaw 0\.5"):
        read_world(tmp_path / "map.yaml")


def test_a_damaged_image_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(YAML)
    (tmp_path / "map.pgm").write_bytes(b"P5\n10 10\n255\nshort")
    with pytest.raises(InputError, match=r"map\.pgm: not an image"):
        read_cell_map(tmp_path / "map.yaml")


def test_images_of_two_bytes_a_pixel(tmp_path: Path) -> None:
    grey = np.array([[0, 20_000, 40_000, 53_000, 65_535]], ">u2")
    (tmp_path / "map.pgm").write_bytes(b"P5\n5 1\n65535\n" + grey.tobytes())
    (tmp_path / "map.yaml").write_text(YAML)
    cells = read_cell_map(tmp_path / "map.yaml")
    assert cells.occupied.tolist() == [[True, True, False, False, False]]
    assert cells.unknown.tolist() == [[False, False, True, False, False]]


def test_negated_images_and_lists_over_lines(tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n2 1\n255\n\xff\x00")
    (tmp_path / "map.yaml").write_text(
        YAML.replace("negate: 0", "negate: 1").replace("[0.0, 0.0, 0.0]", "\n- 0\n- 0\n- 0")
    )
    assert read_cell_map(tmp_path / "map.yaml").occupied.tolist() == [[True, False]]
