"""Readers of mapq, each with whole files to begin from."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable, Sequence
from functools import partial
from importlib import resources
from pathlib import Path

import numpy as np

from mapq.io import ReadOptions, read_cloud, read_patches, write_patches
from mapq.io.describe import describe
from mapq.io.journal import SUFFIX, Event, Journal
from mapq.io.las_pieces import read_las_head, read_las_pieces
from mapq.io.models import read_model
from mapq.patches import SUSPICIOUS
from mapq.posed import find_scans, read_poses
from mapq.posed.calibration import read_calibration
from mapq.posed.uos import read_uos_pose
from mapq.settings import check_settings, read_settings
from tests.fuzz.reader import Reader
from tests.logs.bags import START, Maker, Note, drive
from tests.mapq.io.las_files import FOOT_WKT, geo_keys, las_bytes, wkt
from tests.mapq.io.samples import patches, pcd, ply, table, text_rows
from tests.mapq.io.test_bag import message, rows
from tests.mapq.io.test_ptx import TURNED, ptx
from tests.mapq.io.test_vtk import vtk

ROWS = table(20)
PLAIN = ROWS[["x", "y", "z"]].copy()
PLAIN["x"][3] = 0.0
LISTS = b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty list uchar int seen\n" + b"".join(
    b"property float %c\n" % axis for axis in b"xyz"
)
LISTS += b"end_header\n" + (b"\x02" + bytes(8) + np.ones(3, "<f4").tobytes()) * 2
SETTINGS = (
    b'[segment]\nneighbours = 20\nnoise = 0.02\nup = [0, 1, 0]\n[features]\nreading = "literal"\ncontext = ["rays"]\n'
)
KITTI_POSE = "1 0 0 0.5 0 1 0 0 0 0 1 0\n"
TUM = "# time x y z q\n0.0 1 2 3 0 0 0 1\n1.0 1 2 4 0 0 0.6 0.8\n"
GRAPH = "v0 1 2 3 0 0 0 1\nv1 1 2 4 0 0 0.6 0.8\n"
RESULT = '{"schema": "mapq.result/1", "model": {"name": "a"}, "n": 3, "patches": [\n{"patch": 0, "terms": [1, 2]}\n]}\n'


def _cloud(path: Path) -> None:
    """Read a cloud, and all that is told of it."""
    read_cloud(str(path))
    describe(str(path))


def _las(path: Path) -> None:
    """Read a cloud whole, and piece by piece."""
    _cloud(path)
    head = read_las_head(str(path), ReadOptions())
    for _ in read_las_pieces(str(path), ReadOptions(), 0, head.n_points, np.zeros(3)):
        pass


def _bytes(*files: bytes) -> Callable[[Path], Sequence[bytes]]:
    return lambda _: files


def _stored(save: Callable[..., None], *args: np.ndarray, **arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    save(stream, *args, **arrays)
    return stream.getvalue()


def _bag(kind: str, folder: Path) -> Sequence[bytes]:
    make = Maker(kind)
    notes = [*drive(make), Note("/map", START + 0.5, message(make, START + 0.5, rows(), "laser"))]
    path = make.write(folder / "made.bag", sorted(notes, key=lambda note: note.time))
    files = [path] if path.is_file() else [file for file in path.iterdir() if file.suffix in (".db3", ".mcap")]
    return [files[0].read_bytes()]


def _e57(folder: Path) -> Sequence[bytes]:
    try:
        import pye57
    except ImportError:
        return []
    rng = np.random.default_rng(0)
    data = {f"cartesian{axis}": rng.uniform(-20, 20, 10) for axis in "XYZ"}
    data |= {"intensity": rng.uniform(size=10).astype(np.float32), "colorRed": np.arange(10, dtype=np.uint8)}
    file = pye57.E57(str(folder / "a.e57"), mode="w")
    file.write_scan_raw(data, rotation=np.array([1.0, 0, 0, 0]), translation=np.array([1.0, 2, 3]))
    file.close()
    return [(folder / "a.e57").read_bytes()]


def _copc(_: Path) -> Sequence[bytes]:
    """A LAZ that says at its head that it is COPC, as the hierarchy is not read."""
    from laspy.vlrs import VLR

    record = VLR("copc", 1, "", bytes(160))
    return [las_bytes(True, n=20, kind=7, version="1.4", extra=False, records=(record,))]


def _patches(folder: Path) -> Sequence[bytes]:
    write_patches(folder / "a.patches", patches(20))
    return [(folder / "a.patches").read_bytes()]


def _journal(folder: Path) -> Sequence[bytes]:
    path = folder / "a.patches"
    write_patches(path, patches(20))
    journal = Journal(path, patches(20))
    for event in (Event(1, SUSPICIOUS), Event(2, SUSPICIOUS), Event(2, None)):
        journal.add(event)
    return [journal.file.read_bytes()]


def _read_patches(path: Path) -> None:
    read_patches(path)
    describe(str(path))


def _read_journal(journal: Path) -> None:
    path = journal.with_name("a.patches")
    read_patches(path)
    Journal(path, patches(20))


def _folder(path: Path) -> None:
    scans = find_scans([str(path.parent)])
    for number in range(len(scans)):
        scans.read(number)


def _scans(folder: Path) -> None:
    for name in ("0.bin", "1.bin"):
        (folder / name).write_bytes(np.ones((3, 4), "<f4").tobytes())
    (folder / "calib.txt").write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")


def _model(_: Path) -> Sequence[bytes]:
    return [resources.files("mapq").joinpath("models", "default.json").read_bytes()]


def _read_model(path: Path) -> None:
    read_model(path)
    describe(str(path))


def _result(path: Path) -> None:
    describe(str(path))
    describe(str(path.with_suffix(".ply")))


def _result_cloud(folder: Path) -> None:
    labelled = np.zeros(
        4, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("patch", "i4"), ("suspicious", "u1"), ("p_suspicious", "f4")]
    )
    (folder / "a.ply").write_bytes(ply(labelled))


def _settings(path: Path) -> None:
    check_settings(path)
    read_settings(path)


def _uos(path: Path) -> None:
    read_uos_pose(str(path))


def _calibration(path: Path) -> None:
    read_calibration(str(path))


READERS: dict[str, Reader] = {
    "ply": Reader("a.ply", _bytes(ply(ROWS), ply(ROWS, ">"), ply(ROWS, ""), LISTS), _cloud),
    "pcd": Reader("a.pcd", _bytes(pcd(ROWS, "ascii"), pcd(ROWS), pcd(np.repeat(ROWS, 3), "binary_compressed")), _cloud),
    "text": Reader(
        "a.xyz",
        _bytes(
            text_rows(ROWS).encode(),
            b"// made\n# by hand\nx , y,z,i\n" + text_rows(ROWS[["x", "y", "z", "field_u1"]], delimiter=",").encode(),
            gzip.compress(text_rows(ROWS).encode(), mtime=0),
        ),
        _cloud,
    ),
    "kitti": Reader("0.bin", _bytes(np.random.default_rng(0).normal(size=(20, 4)).astype("<f4").tobytes()), _cloud),
    "las": Reader(
        "a.las", _bytes(las_bytes(n=20, records=(wkt(FOOT_WKT),)), las_bytes(n=9, kind=7, version="1.4")), _las
    ),
    "laz": Reader(
        "a.laz",
        _bytes(
            las_bytes(True, n=20, records=(geo_keys(k1024=1, k3076=9003),)),
            las_bytes(True, n=20, kind=7, version="1.4"),
        ),
        _las,
    ),
    "copc": Reader("a.copc.laz", _copc, _las),
    "e57": Reader("a.e57", _e57, _cloud),
    "ptx": Reader("a.ptx", _bytes(ptx(["1 2 3 0.5 10 20 255"] * 20, 4, TURNED).encode()), _cloud),
    "vtk": Reader("a.vtk", _bytes(vtk(False), vtk(True)), _cloud),
    "npy": Reader("a.npy", _bytes(_stored(np.save, np.ones((9, 4), "f4")), _stored(np.save, ROWS)), _cloud),
    "npz": Reader("a.npz", _bytes(_stored(np.savez, xyz=np.ones((20, 3)), label=np.arange(20))), _cloud),
    "3d": Reader("scan000.3d", _bytes(text_rows(PLAIN).encode()), _cloud),
    "cloud-ros1": Reader("a.bag", partial(_bag, "ros1"), _cloud),
    "cloud-sqlite": Reader("a.db3", partial(_bag, "sqlite3"), _cloud),
    "cloud-mcap": Reader("a.mcap", partial(_bag, "mcap"), _cloud),
    "patches": Reader("b.patches", _patches, _read_patches),
    "journal": Reader(f"a.patches{SUFFIX}", _journal, _read_journal, _patches),
    "mapq-settings": Reader("a.toml", _bytes(SETTINGS), _settings),
    "model": Reader("a.json", _model, _read_model),
    "result": Reader("a.json", _bytes(RESULT.encode()), _result, _result_cloud),
    "poses": Reader("poses.txt", _bytes(KITTI_POSE.encode() * 2, TUM.encode(), GRAPH.encode()), read_poses),
    "posed-folder": Reader("poses.txt", _bytes(KITTI_POSE.encode() * 2, TUM.encode()), _folder, _scans),
    "uos-pose": Reader("scan000.pose", _bytes(b"1 2 3\n0.1 0.2 0.3\n"), _uos),
    "calibration": Reader("calib.txt", _bytes(b"P0: 1 2 3\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n"), _calibration),
}
