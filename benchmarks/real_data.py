"""Public scans and sub-maps as `benchmarks.real_maps` takes them, and how they become labelled patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.commands import ROOT
from mapq.cloud import PointCloud
from mapq.io import read_cloud
from mapq.labels import label_from_field
from mapq.patches import FROM_FIELD, NO_PATCH, PLAUSIBLE, Patches
from mapq.posed import FindSettings, PosedScans, find_scans, read_poses
from mapq.segmentation import segment

DATA = ROOT.parent / "shared" / "data" / "mapq"
FEWEST_POINTS = 5000
"""Of a part of a sub-map that is worth segmenting."""


def kitti(data: Path, published: bool = False) -> PosedScans:
    """Return 20 scans of KITTI 00: with poses from registration, or as published."""
    folder = data / "kitti00_map-metrics"
    if published:
        return find_scans([str(folder)], FindSettings(calibration=str(folder / "derived" / "calib_Tr.txt")))
    return find_scans([str(folder)], FindSettings(poses=str(folder / "derived" / "poses_velodyne_icp.txt")))


def quad(data: Path) -> PosedScans:
    """Return five scans of New College, the points of planes alone."""
    return find_scans([str(data / "newer_college_01")], FindSettings(pattern="planes_*", bin_columns=3))


def hall(data: Path) -> PosedScans:
    """Return eleven scans of a hall, taken turning on the spot."""
    return find_scans([str(data / "plane_localization_hall")], FindSettings(quaternion="wxyz"))


def facade(data: Path) -> PosedScans:
    """Return two scans of a building with their registered poses; unregistered they are half a metre apart."""
    folder = data / "small_gicp_pair"
    files = (str(folder / "target.ply"), str(folder / "source.ply"))
    poses = np.stack([np.eye(4), read_poses(str(folder / "T_target_source.txt")).poses[0]])
    return PosedScans(files, poses, None, lambda number: read_cloud(files[number]), np.arange(2), str(folder))


def park(data: Path) -> PosedScans:
    """Return eleven sub-maps of a business park, chained as odometry has them."""
    folder = data / "dxmcu_map"
    return find_scans([str(folder)], FindSettings(poses=str(folder / "derived" / "poses_chain.txt")))


def some(scans: PosedScans, chosen: Sequence[int]) -> PosedScans:
    """Return some of the scans."""
    index = list(chosen)
    names = tuple(scans.names[scan] for scan in index)
    return replace(scans, names=names, poses=scans.poses[index], numbers=scans.numbers[index], times=None)


def labelled(cloud: PointCloud) -> Patches:
    """Return the patches of a cloud that `mapq perturb` made, with its labels."""
    return label_from_field(segment(cloud), "suspicious", cloud.source)[0]


def plausible(patches: Patches) -> Patches:
    """Return patches of which nothing can be wrong."""
    label = np.full(len(patches), PLAUSIBLE, np.uint8)
    return replace(patches, label=label, label_source=np.full(len(patches), FROM_FIELD, np.uint8))


def alone(scans: PosedScans, axis: int, strip: tuple[float, float], test: bool) -> list[Patches]:
    """Return the patches of the part of each sub-map that lies before or beyond a strip: one pass each, plausible."""
    found = []
    for scan in range(len(scans)):
        pose = scans.poses[scan]
        world = scans.read(scan).world() @ pose[:3, :3].T + pose[:3, 3]
        part = world[world[:, axis] > strip[1] if test else world[:, axis] < strip[0]]
        if len(part) >= FEWEST_POINTS:
            fields = {"scan": np.full(len(part), scan, np.int32)}
            cloud = PointCloud.from_world(part.astype(np.float32), fields, f"sub-map {scan}")
            found.append(plausible(segment(cloud)))
    return [patches for patches in found if len(patches)]


def disagreement_of(patches: Patches) -> np.ndarray:
    """Return the median disagreement (m,) of the points of each patch, nan where not half of them are known."""
    metres = np.asarray(patches.cloud.fields["disagreement"], np.float64)
    inside = np.flatnonzero(patches.patch != NO_PATCH)
    found = np.full(len(patches), np.nan)
    order = inside[np.argsort(patches.patch[inside], kind="stable")]
    for patch, rows in enumerate(np.split(order, np.cumsum(patches.counts)[:-1])):
        known = metres[rows][np.isfinite(metres[rows])]
        if 2 * len(known) >= len(rows) > 0:
            found[patch] = np.median(known)
    return found
