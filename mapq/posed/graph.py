"""The edges of a g2o file: read with the scans that are their ends, and written without some."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mapq.posed.find import NO_CALIBRATION
from mapq.posed.match import match_poses
from mapq.posed.poses import read_calibration
from mapq.posed.scans import PosedScans
from prf.shell.cli.files import STREAM, gunzip, open_input, open_output
from prf.shell.errors import InputError
from prf.shell.poses.files import FARTHEST, GZIP_MAGIC, ROTATION_TOLERANCE, read_pose_file

EDGES = {b"EDGE_SE3:QUAT": 7, b"EDGE_SE2": 3}
"""Rows of g2o with two numbers of vertices and a measured pose of so many numbers; the information follows."""


class GraphEdge(NamedTuple):
    """An edge of a graph: where it has the second vertex in the frame of the first."""

    row: int  # of the file, from 0
    ids: tuple[int, int]  # numbers of the vertices
    scans: tuple[int, int]  # their scans, -1 where there is none
    motion: NDArray[np.float64]  # (4, 4) of the sensor


def read_edges(scans: PosedScans, every: int = 1, calibration: str | None = None) -> list[GraphEdge]:
    """Return the edges of the file that scans have their poses from; none unless it is g2o.

    Parameters
    ----------
    scans : PosedScans
        All for which the file has poses.
    every : int
        The edges have numbers of ``scans.every(every)``.
    calibration : str, optional
        As of :class:`mapq.configuration.FindSettings`: the file by which poses became those of the laser.

    Raises
    ------
    InputError
        If an edge is not two numbers of vertices and a pose.
    """
    if scans.poses_from in ("", STREAM):
        return []
    found = [edge for row, line in enumerate(_rows(scans.poses_from)) if (edge := _edge(line, row, scans.poses_from))]
    if not found:
        return []
    table = read_pose_file(scans.poses_from)
    rows = match_poses(scans.names, table, scans.poses_from)
    scan_of = {(table.names or ())[row]: -1 if scan % every else scan // every for scan, row in enumerate(rows)}
    turned = np.eye(4) if calibration in (None, NO_CALIBRATION) else read_calibration(str(calibration))
    return [
        edge._replace(
            scans=(scan_of.get(f"v{edge.ids[0]}", -1), scan_of.get(f"v{edge.ids[1]}", -1)),
            motion=np.linalg.inv(turned) @ edge.motion @ turned,
        )
        for edge in found
    ]


def write_without(path: str, target: str, dropped: Collection[int]) -> None:
    """Write a graph without some of its rows, all else byte for byte, whole or not at all."""
    kept = [line for row, line in enumerate(_rows(path)) if row not in dropped]
    with open_output(target, binary=True) as stream:
        stream.write(b"".join(kept))


def _rows(path: str) -> list[bytes]:
    """Return the rows of a file, gzipped or not, with their ends."""
    with open_input(path) as stream:
        data = stream.read()
    data = gunzip(data, path) if data.startswith(GZIP_MAGIC) else data
    return data.splitlines(keepends=True)


def _edge(line: bytes, row: int, path: str) -> GraphEdge | None:
    """Return the edge of a row; None for other rows."""
    fields = line.partition(b"#")[0].split()
    if not fields or fields[0] not in EDGES:
        return None
    where, width = f"{path}:{row + 1}", EDGES[fields[0]]
    try:
        ids, values = (int(fields[1]), int(fields[2])), np.array(fields[3 : 3 + width], np.float64)
    except (IndexError, ValueError):
        ids, values = (0, 0), np.zeros(0)
    if len(values) != width or not (np.abs(values) < FARTHEST).all():
        raise InputError(f"{where}: not an edge of two vertices and a pose of {width} numbers. Correct this line.")
    motion = np.eye(4)
    if width == 7:
        length = float(np.linalg.norm(values[3:]))
        if abs(length - 1.0) > ROTATION_TOLERANCE:
            raise InputError(f"{where}: the quaternion of this edge has length {length:.3g}, not 1. Correct this line.")
        motion[:3, :3] = Rotation.from_quat(values[3:]).as_matrix()
        motion[:3, 3] = values[:3]
    else:
        motion[:3, :3] = Rotation.from_rotvec([0.0, 0.0, values[2]]).as_matrix()
        motion[:2, 3] = values[:2]
    return GraphEdge(row, ids, (-1, -1), motion)
