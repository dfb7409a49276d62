from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np
import pytest

from mapq.configuration import ReadOptions
from mapq.io import read_cloud
from prf.shell.errors import ConfigError
from tests.mapq.io.samples import refusal
from tests.readings.bags import KINDS, START, Maker, Note, drive, yaw

FIELDS = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "normal"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", ("<f4", (3,))],
        "offsets": [0, 4, 8, 16, 20, 24],
        "itemsize": 40,
    }
)
NUMBERS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def rows(n: int = 12, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = np.zeros(n, FIELDS)
    for name in ("x", "y", "z", "intensity", "normal"):
        points[name] = rng.normal(size=points[name].shape)
    points["ring"] = rng.integers(0, 64, n)
    return points


def message(make: Maker, time: float, points: np.ndarray, frame: str, height: int = 1, padding: int = 0):
    """A PointCloud2 of a grid, with bytes between its rows."""
    order = ">" if points.dtype["x"].base.str[0] == ">" else "<"
    fields = []
    for name in points.dtype.names:
        kind, shape = points.dtype[name].base, points.dtype[name].shape
        number = NUMBERS[kind.str[1:]]
        count = shape[0] if shape else 1
        offset = points.dtype.fields[name][1]
        fields.append(make.store.types["sensor_msgs/msg/PointField"](name, offset, number, count))
    width = len(points) // height
    lines = [points[k * width : (k + 1) * width].tobytes() + bytes(padding) for k in range(height)]
    step = points.dtype.itemsize
    return make.store.types["sensor_msgs/msg/PointCloud2"](
        make.header(time, frame),
        height,
        width,
        fields,
        order == ">",
        step,
        width * step + padding,
        np.frombuffer(b"".join(lines), np.uint8),
        True,
    )


def write(folder, kind: str, notes, name: str = "map") -> str:
    make = Maker(kind)
    return str(make.write(folder / (f"{name}.bag" if kind == "ros1" else name), notes(make)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_map_is_read_to_the_last_bit(tmp_path, kind, order):
    points = rows().astype(rows().dtype.newbyteorder(order))
    path = write(tmp_path, kind, lambda make: [Note("/map", START, message(make, START, points, "map", 3, 8))])
    cloud = read_cloud(path)
    assert cloud.coordinate_type is np.float32
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(cloud.xyz[:, axis], points[name])
    assert {name: (values.dtype.name, values.shape) for name, values in cloud.fields.items()} == {
        "intensity": ("float32", (12,)),
        "ring": ("uint16", (12,)),
        "normal": ("float32", (12, 3)),
    }
    for name, values in cloud.fields.items():
        np.testing.assert_array_equal(values, points[name])


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_any_name_zipped_or_piped(tmp_path, monkeypatch, kind):
    path = Path(write(tmp_path, kind, lambda make: [Note("/map", START, message(make, START, rows(), "map"))]))
    if path.is_dir():
        path = next(file for file in path.iterdir() if file.suffix in (".db3", ".mcap"))
    (tmp_path / "cloud.gz").write_bytes(gzip.compress(path.read_bytes()))
    (tmp_path / "cloud").write_bytes(path.read_bytes())
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    for name in (tmp_path / "cloud.gz", tmp_path / "cloud", "-"):
        assert len(read_cloud(str(name))) == 12


@pytest.mark.parametrize("kind", KINDS)
def test_scans_are_placed_by_tf(tmp_path, kind):
    """At time t the laser is at (10, 20) + a quarter turn of (t + 0.2, 0, 0.3), heading along y."""
    first, second = rows(seed=1), rows(8, seed=2)
    frame = "/laser" if kind == "ros1" else "laser"  # ROS 1 had the slash
    path = write(
        tmp_path,
        kind,
        lambda make: sorted(
            [
                *drive(make),
                Note("/points", START + 0.5, message(make, START + 0.5, first, frame)),
                Note("/points", START + 1.5, message(make, START + 1.5, second, "laser")),
                Note("/points", START + 9.0, message(make, START + 9.0, rows(3), "laser")),
            ],
            key=lambda note: note.time,
        ),
    )
    cloud = read_cloud(path)
    assert cloud.fields["scan"].tolist() == [0] * 12 + [1] * 8
    for points, t, index in ((first, 0.5, 0), (second, 1.5, 1)):
        expected = np.column_stack([10.0 - points["y"], 20.0 + t + 0.2 + points["x"], points["z"] + 0.3])
        np.testing.assert_allclose(cloud.xyz[cloud.fields["scan"] == index], expected, atol=1e-6)
    np.testing.assert_allclose(np.unique(cloud.fields["time"]), [START + 0.5, START + 1.5], atol=1e-3)
    sensor = cloud.xyz[-1] + [cloud.fields[f"to_sensor_{axis}"][-1] for axis in "xyz"]
    np.testing.assert_allclose(sensor, [10.0, 21.7, 0.3], atol=1e-4)
    plain = read_cloud(path, ReadOptions(frame="laser"))
    assert len(plain) == 23
    np.testing.assert_array_equal(plain.xyz[:12, 0], first["x"])
    odometry = read_cloud(path, ReadOptions(frame="odom"))
    np.testing.assert_allclose(odometry.xyz[:12, 0], 0.7 + first["x"], atol=1e-6)
    small = read_cloud(path, ReadOptions(frame="odom", unit=0.01))  # of the points alone: tf is in metres
    np.testing.assert_allclose(small.xyz[:12, 0], 0.7 + 0.01 * first["x"], atol=1e-6)


def test_a_map_that_is_published_again_counts_once(tmp_path):
    def notes(make):
        tf = Note("/tf", START, make.tf(START, "map", "odom", (1, 2, 3), yaw(0.0)))
        clouds = [Note("/map", START + k, message(make, START + k, rows(), "odom")) for k in range(3)]
        return [tf, *clouds]

    path = write(tmp_path, "ros1", notes)
    cloud = read_cloud(path)
    assert len(cloud) == 12
    assert "scan" not in cloud.fields
    np.testing.assert_array_equal(cloud.xyz[:, 0], rows()["x"])
    np.testing.assert_allclose(read_cloud(path, ReadOptions(frame="map")).xyz[:, 0], rows()["x"] + 1.0, rtol=1e-6)


def test_several_topics_require_a_choice(tmp_path):
    path = write(
        tmp_path,
        "ros1",
        lambda make: [
            Note("/map", START, message(make, START, rows(), "map")),
            Note("/ground", START, message(make, START, rows(5), "map")),
        ],
    )
    with pytest.raises(ConfigError, match=r"several topics of clouds, /ground, /map. Choose one with --topic"):
        read_cloud(path)
    assert (
        len(read_cloud(path, ReadOptions(topic="/ground"))) == len(read_cloud(path, ReadOptions(topic="ground"))) == 5
    )
    with pytest.raises(ConfigError, match=r"--topic /walls: .* has /ground, /map"):
        read_cloud(path, ReadOptions(topic="/walls"))


def test_what_is_refused(tmp_path):
    path = write(tmp_path, "ros1", lambda make: [Note("/tf", START, make.tf(START, "map", "odom", (1, 2, 3)))])
    assert "no sensor_msgs/msg/PointCloud2 messages. The bag has /tf (TFMessage)" in refusal(read_cloud, path)
    two = [rows(seed=1), rows(seed=2)]
    path = write(
        tmp_path,
        "ros1",
        lambda make: [Note("/p", START + k, message(make, START + k, two[k], "velodyne")) for k in range(2)],
        "two",
    )
    line = refusal(read_cloud, path)
    assert "2 clouds in frame velodyne, and tf does not lead there from map" in line
    assert "cloud.frame" in line
    assert "folder without metadata.yaml and with 2 bag files" in refusal(read_cloud, str(tmp_path))
