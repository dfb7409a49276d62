"""Which scans, and which edges of their graph, are wrong: both checks together, as a result has them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mapq.cloud import PointCloud
from mapq.posed.check_scans import Drift, ScanMotion, check_scans
from mapq.posed.edges import EdgeError, check_edges
from mapq.posed.graph import GraphEdge
from mapq.posed.register import Floats
from mapq.posed.scans import PosedScans

WRONG = 0.5
"""Probability from which a scan or an edge is called wrong."""


class CheckedPoses(NamedTuple):
    """What the clouds of scans say of their poses, and of the graph that these are from."""

    scans: tuple[ScanMotion, ...] = ()  # worst first
    edges: tuple[EdgeError, ...] = ()  # worst first
    drift: Drift | None = None
    motion: Floats = np.zeros((0, 4, 4))  # (k, 4, 4) that makes each scan agree with the others, in the map's frame
    places: Floats = np.zeros((0, 3))  # (k, 3) of the sensors

    @property
    def wrong_rows(self) -> set[int]:
        """Rows of the graph's file with edges that are more probably wrong than right."""
        return {edge.row for edge in self.edges if edge.p_wrong > WRONG}


def check_poses(
    cloud: PointCloud,
    scans: PosedScans,
    graph: Sequence[GraphEdge] = (),
    progress: Callable[[float], None] = lambda done: None,
) -> CheckedPoses:
    """Return what is wrong with the poses of scans, and with the edges of their graph.

    Parameters
    ----------
    cloud : PointCloud
        Made of the scans by :func:`mapq.posed.merge_scans`.
    scans : PosedScans
    graph : sequence of GraphEdge
        As :func:`mapq.posed.graph.read_edges` returns them.
    progress : callable
        Receives the share done.
    """
    part = 0.5 if graph else 1.0
    checked = check_scans(cloud, scans, lambda done: progress(part * done))
    edges = check_edges(checked, cloud, scans, graph, lambda done: progress(part + part * done)) if graph else ()
    return CheckedPoses(checked.rows, edges, checked.drift, checked.corrections.motion, checked.scene.places)
