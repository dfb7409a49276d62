"""Files that once broke a reader; each is refused in one line that names it."""

from __future__ import annotations

import contextlib
import io
import json
import os
import sqlite3
import struct
import zlib

import lazrs
import numpy as np
import pytest
from laspy import ExtraBytesParams, LasData, LasHeader
from laspy.vlrs import VLR

from mapq.io import read_cloud, read_patches, write_patches, write_ply
from mapq.io.e57 import e57_poses
from mapq.io.journal import journal_beside
from mapq.io.las import _read_points
from mapq.io.las_unit import unit_of
from mapq.io.patches import SCHEMA as PATCHES_SCHEMA
from mapq.io.result_json import stated_unit
from mapq.posed.calibration import read_calibration
from prf.coloring import read_geojsonl
from prf.export.source import read_source
from prf.inspection import inspect
from prf.logs import read_readings
from prf.occupancy import SCHEMA as GRID_SCHEMA
from prf.occupancy import read_grid, write_grid
from prf.run import inspect_files, names, read_run, write_run
from prf.run.state import PNG_MAGIC
from prf.score import read_occupied_area
from prf.shell.errors import InputError, OutputError
from prf.shell.storage import load_arrays, save_arrays
from prf.simulate import read_world
from prf.simulate.rasters import read_cell_map
from tests.factories import make_run
from tests.fuzz.prf_readers import PGM, YAML
from tests.logs.bags import Maker, drive
from tests.logs.samples import player_laser
from tests.mapq.io.samples import patches, refusal
from tests.test_occupancy import BEAM, build

HUGE = 10**400
"""A whole number that JSON and YAML give, and no float holds."""
DIGITS = "9" * 5000


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "run"
    write_run(folder, make_run(n_draws=2))
    return folder


def header_of(stream: io.BytesIO) -> LasHeader:
    stream.seek(0)
    return LasHeader.read_from(stream)


def states(folder) -> dict[str, str]:
    return {file.name: f"{file.state}: {file.summary}" for file in inspect_files(folder)}


@pytest.mark.parametrize("length", [0, 7])
def test_a_picture_that_says_no_size(whole, length):
    chunk = b"IHDR" + bytes(length)
    data = PNG_MAGIC + struct.pack(">I", length) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (whole / names.PICTURE).write_bytes(data)
    assert states(whole)[names.PICTURE].startswith("damaged: damaged (the picture says no size)")


@pytest.mark.parametrize(
    "counts", [np.array(3), np.zeros((40, 2), np.int64), np.full(40, np.nan), np.zeros(0, np.int64)]
)
def test_a_checkpoint_whose_counts_are_none(whole, counts):
    save_arrays(whole / names.CHECKPOINT, names.CHECKPOINT_SCHEMA, {"chain0.graph.counts": counts})
    assert states(whole)[names.CHECKPOINT].startswith("damaged")


@pytest.mark.parametrize("part", ["log_posterior", "window", "coordinates"])
def test_a_map_with_a_number_that_no_float_holds(tmp_path, part):
    write_run(tmp_path / "run", make_run(n_draws=2))
    path = tmp_path / "run" / names.MAP
    content = json.loads(path.read_text())
    if part == "coordinates":
        content["geometry"]["coordinates"][0][0][1] = [HUGE, 1]
    else:
        content["properties"][part] = HUGE if part == "log_posterior" else [0, 0, HUGE, 1]
    path.write_text(json.dumps(content))
    if part == "log_posterior":
        assert np.isnan(read_run(tmp_path / "run").best_log_posterior)
    else:
        assert str(path) in refusal(read_run, tmp_path / "run")
        assert str(path) in refusal(read_occupied_area, path)


@pytest.mark.parametrize("read", [inspect, read_occupied_area, read_source, read_world])
@pytest.mark.parametrize("part", ["coordinates", "window"])
def test_polygons_beyond_all_maps(tmp_path, part, read, recwarn):
    """GEOS computed infinities, numpy said so in many lines, and export ended with an internal error."""
    far = 1e200
    ring = [[0, 0], [4, 0], [4, 4], [0, far if part == "coordinates" else 4], [0, 0]]
    properties = {"window": [-1, -1, far if part == "window" else 5, 5]}
    geometry = {"type": "Polygon", "coordinates": [ring]}
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "Feature", "properties": properties, "geometry": geometry}))
    assert "beyond 1e+08 m" in refusal(read, path)
    assert len(recwarn) == 0


@pytest.mark.parametrize("resolution", ["1e308", "1e9"])
def test_cells_beyond_all_maps(tmp_path, resolution):
    (tmp_path / "a.pgm").write_bytes(PGM)
    (tmp_path / "map.yaml").write_text(YAML.replace("0.05", resolution))
    assert "map.yaml: window " in refusal(read_cell_map, tmp_path / "map.yaml")


def test_draws_with_a_number_that_no_float_holds(tmp_path):
    path = tmp_path / "a.geojsonl"
    window = [0, 0, HUGE, 1]
    geometry = {"type": "MultiLineString", "coordinates": []}
    feature = {"type": "Feature", "properties": {"anchor_black": True, "window": window}, "geometry": geometry}
    path.write_text(json.dumps(feature))
    assert f"{path}:1: property window" in refusal(read_geojsonl, path)


@pytest.mark.parametrize("text", ["[" * 100_000, DIGITS])
def test_json_without_end_within_arrays(tmp_path, text):
    write_grid(tmp_path / "a.npz", build(BEAM))
    arrays = load_arrays(tmp_path / "a.npz", GRID_SCHEMA) | {"settings": np.str_(text)}
    save_arrays(tmp_path / "a.npz", GRID_SCHEMA, arrays)
    assert "settings holds no JSON object" in refusal(read_grid, tmp_path / "a.npz")
    write_patches(tmp_path / "a.patches", patches())
    arrays = load_arrays(tmp_path / "a.patches", PATCHES_SCHEMA) | {"parameters": np.str_(text)}
    save_arrays(tmp_path / "a.patches", PATCHES_SCHEMA, arrays)
    assert "parameters is no JSON object" in refusal(read_patches, tmp_path / "a.patches")


@pytest.mark.parametrize("line", [DIGITS, "[" * 100_000])
def test_a_journal_without_end(tmp_path, line):
    path = tmp_path / "a.patches"
    write_patches(path, patches())
    journal_beside(path).write_text(line + "\n")
    assert "labels.jsonl: damaged (line 1" in refusal(read_patches, path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.05", DIGITS),
        ("0.05", str(HUGE)),
        ("0.05", f"[0x{'F' * 9000}, 1]"),
        ("0.05", "[" * 400),
        ("0.05", "!!timestamp x"),
        ("negate: 0", "mode: [a, b]"),
        ("negate: 0", "mode: {a: b}"),
        ("a.pgm", '"a\\0b"'),
        ("[-1.0, 2.0, 0.0]", "[*a, *a]"),
    ],
)
def test_yaml_that_breaks_its_parser(tmp_path, old, new):
    (tmp_path / "a.pgm").write_bytes(PGM)
    (tmp_path / "map.yaml").write_text(YAML.replace(old, new))
    assert str(tmp_path) in refusal(read_cell_map, tmp_path / "map.yaml")


@pytest.mark.parametrize("key", ["mode", "resolution", "image"])
def test_yaml_that_unfolds_without_end(tmp_path, key):
    """Twenty lines, each a list of ten times the one before: printed they would fill any memory."""
    lines = ["a0: &a0 [1, 1]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 21))]
    (tmp_path / "a.pgm").write_bytes(PGM)
    (tmp_path / "map.yaml").write_text(
        "\n".join([*lines, YAML, f"{key}: *a20"]).replace(f"\n{key}: 0.05", "").replace(f"{key}: a.pgm\n", "")
    )
    message = refusal(read_cell_map, tmp_path / "map.yaml")
    assert len(message) < 400


@pytest.mark.parametrize(
    "data",
    [
        b"P5\n99999999 99999999\n255\n",
        b"\x89PNG\r\n\x1a\n",
        b"P5\n4 3\n99999999\n" + bytes(12),
        PGM[:-20],
    ],
)
def test_images_that_are_none(tmp_path, data):
    (tmp_path / "map.yaml").write_text(YAML)
    (tmp_path / "a.pgm").write_bytes(data)
    assert "a.pgm: not an image" in refusal(read_cell_map, tmp_path / "map.yaml")


def test_an_e57_whose_pose_is_damaged():
    class Header:
        def has_pose(self):
            return True

        @property
        def rotation_matrix(self):
            raise ValueError("Got: 5, Expected: 4.")

    class File:
        scan_count = 1

        def get_header(self, _):
            return Header()

    assert refusal(e57_poses, File(), "a.e57").startswith("a.e57: the pose of a scan is damaged")


@pytest.mark.parametrize("column", ["type", "name"])
def test_a_bag_whose_topics_are_bytes(tmp_path, column):
    """SQLite takes any value for any column."""
    make = Maker("sqlite3")
    folder = make.write(tmp_path / "bag", drive(make))
    (path,) = folder.glob("*.db3")
    with contextlib.closing(sqlite3.connect(path)) as base:
        base.execute(f"UPDATE topics SET {column} = CAST({column} AS BLOB)")
        base.commit()
    assert "name or type of a topic is no text" in refusal(read_readings, str(path))


ODD_NAMES = ["a b.xyz", "ünï✓.xyz", "a\nb.xyz", "-n.xyz", "%s{0}.xyz", "\x1b[31m.xyz", b"\xff\xfe.xyz"]


@pytest.mark.parametrize("name", ODD_NAMES)
def test_odd_names(tmp_path, name):
    path = os.path.join(os.fsencode(tmp_path), name if isinstance(name, bytes) else os.fsencode(name))
    path = os.fsdecode(path)
    with open(path, "w", encoding="utf-8") as stream:
        stream.write("1 2 3\n4 5 6\n")
    assert len(read_cloud(path)) == 2
    with open(path, "w", encoding="utf-8") as stream:
        stream.write("1 2 3\n4 x 6\n")
    assert ":2: " in refusal(read_cloud, path)


def test_a_folder_or_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    assert str(tmp_path) in refusal(read_grid, tmp_path)
    assert str(tmp_path) in refusal(read_geojsonl, tmp_path)
    (tmp_path / "a.xyz").write_text("1 2 3\n")

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    assert refusal(read_cloud, str(tmp_path / "a.xyz")) == f"{tmp_path / 'a.xyz'}: permission denied."


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk(tmp_path):
    cloud = patches().cloud
    with pytest.raises((OutputError, OSError)) as caught:
        write_ply("/dev/full", cloud)
    assert isinstance(caught.value, OutputError) or caught.value.errno == 28


def test_a_place_that_takes_no_file(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file" / "a.ply", tmp_path / "absent" / "a.ply", "/proc/a.ply"):
        with pytest.raises(OutputError, match="cannot be written"):
            write_ply(str(place), patches().cloud)
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_laz_whose_points_are_long_is_read_in_small_pieces():
    """A file of 2.7 kB promised points of 15,258 bytes, of which 200,000 were to be decoded at once."""

    class Reader:
        header = LasHeader(point_format=7, version="1.4")

        def read_points(self, n_points):
            self.at_once = n_points
            return ()

    reader = Reader()
    reader.header.add_extra_dims([ExtraBytesParams(f"a{n}", "f8") for n in range(1900)])
    with pytest.raises(ValueError, match="at least one array"):
        _read_points(reader, "a.laz")
    assert reader.at_once * reader.header.point_format.size < 1 << 27


def test_laz_whose_chunk_is_empty_but_has_points(tmp_path):
    """What follows was taken for the lengths of its layers: 1,794 bytes asked for 3.4 GB, and the process aborted."""
    header = LasHeader(point_format=7, version="1.4")
    stream = io.BytesIO()
    las = LasData(header)
    las.x = las.y = las.z = np.arange(20.0)
    las.write(stream, do_compress=True)
    data, start = bytearray(stream.getvalue()), header_of(stream).offset_to_point_data
    (table,) = struct.unpack_from("<q", data, start)
    vlr = lazrs.LazVlr(bytes(header_of(stream).vlrs.get("LasZipVlr")[0].record_data))
    for size in (0, 10, table - start - 9):
        chunks = io.BytesIO()
        lazrs.write_chunk_table(chunks, [(20, size)], vlr)
        (tmp_path / "a.laz").write_bytes(bytes(data[:table]) + chunks.getvalue())
        assert "damaged: chunk 0 is not as long as its layers" in refusal(read_cloud, str(tmp_path / "a.laz"))
    (tmp_path / "a.laz").write_bytes(data)
    assert len(read_cloud(str(tmp_path / "a.laz"))) == 20


@pytest.mark.parametrize("size", [np.nan, np.inf])
def test_a_code_of_a_unit_that_is_no_number(size):
    keys = struct.pack("<8H", 1, 1, 0, 1, 3076, 34736, 1, 0)
    records = VLR("LASF_Projection", 34735, "", keys), VLR("LASF_Projection", 34736, "", struct.pack("<d", size))
    assert unit_of(records, "a.las").tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("unit", ["1e999", -1, 0, '"1"'])
def test_a_unit_that_is_none(tmp_path, unit):
    (tmp_path / "a.json").write_text(f'{{"schema": "mapq.result/1", "cloud_unit": [{unit}, 1, 1], "patches": [\n]}}\n')
    assert "cloud_unit is no unit" in refusal(stated_unit, tmp_path / "a.json")


def test_a_matrix_next_to_nothing(tmp_path, recwarn):
    (tmp_path / "calib.txt").write_text("Tr: 1 0 0 0 0 0 0 0 0 1e-308 1 0\n")
    assert "is no rotation" in refusal(read_calibration, str(tmp_path / "calib.txt"))
    assert len(recwarn) == 0


def test_a_normal_beyond_all_numbers(tmp_path, recwarn):
    write_patches(tmp_path / "a.patches", patches())
    arrays = load_arrays(tmp_path / "a.patches", PATCHES_SCHEMA)
    arrays["normal"][0] = 1e308
    save_arrays(tmp_path / "a.patches", PATCHES_SCHEMA, arrays)
    assert "a normal is not of length 1" in refusal(read_patches, tmp_path / "a.patches")
    assert len(recwarn) == 0


def test_steps_of_beams_beyond_all_numbers(tmp_path, recwarn):
    (tmp_path / "a.log").write_text("## Player version 2.1.2\n" + player_laser([1, 2, 3], low=0.0, step=1e308))
    assert "are no scan" in refusal(read_readings, str(tmp_path / "a.log"))
    assert len(recwarn) == 0


@pytest.mark.parametrize(
    ("array", "value"), [("angle", np.inf), ("origin", np.nan), ("range", np.nan), ("range", -1.0), ("range", -np.inf)]
)
def test_readings_that_none_has(whole, array, value, recwarn):
    """Directions without end were drawn, with warnings of numpy."""
    path = whole / names.READINGS
    before = path.read_bytes()
    arrays = load_arrays(path, names.SCHEMAS[names.READINGS])
    arrays[array][0] = value
    save_arrays(path, names.SCHEMAS[names.READINGS], arrays)
    assert f"a reading has a value of {array} that none has" in states(whole)[names.READINGS]
    path.write_bytes(before)
    assert len(recwarn) == 0


def test_the_whole_ones_are_read(whole, tmp_path):
    assert len(read_run(whole).draws) == 2
    (tmp_path / "map.yaml").write_text(YAML)
    (tmp_path / "a.pgm").write_bytes(PGM)
    assert read_cell_map(tmp_path / "map.yaml").occupied.shape == (3, 4)
    with pytest.raises(InputError):
        read_occupied_area(tmp_path / "map.yaml")
