"""Which scans, and which edges of their graph, are wrong: both checks together, as a result has them."""

from __future__ import annotations

from typing import NamedTuple

from mapq.cloud import PointCloud
from mapq.posed.check_scans import Drift, ScanMotion, check_scans
from mapq.posed.edges import EdgeError, check_edges
from mapq.posed.graph import read_edges
from mapq.posed.scans import PosedScans


class CheckedPoses(NamedTuple):
    """What the clouds of scans say of their poses, and of the graph that these are from."""

    scans: tuple[ScanMotion, ...] = ()  # worst first
    edges: tuple[EdgeError, ...] = ()  # worst first
    drift: Drift | None = None


def check_poses(
    cloud: PointCloud, scans: PosedScans, whole: PosedScans, calibration: str | None = None
) -> CheckedPoses:
    """Return what is wrong with the poses of scans, and with the edges of the g2o file that they are from.

    Parameters
    ----------
    cloud : PointCloud
        Made of the scans by :func:`mapq.posed.merge_scans`.
    scans : PosedScans
    whole : PosedScans
        All for which the file has poses, of which `scans` are some.
    calibration : str, optional
        The file by which poses became those of the laser.

    Raises
    ------
    InputError
        If an edge of the file cannot be read.
    """
    graph = read_edges(whole, scans, calibration)
    checked = check_scans(cloud, scans)
    edges = check_edges(checked, cloud, scans, graph) if graph else ()
    return CheckedPoses(checked.rows, edges, checked.drift)
