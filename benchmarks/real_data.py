"""Public scans and sub-maps as the benchmarks on real maps take them, and how they become labelled patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.commands import ROOT
from mapq.cloud import PointCloud
from mapq.configuration import FindSettings, ReadOptions
from mapq.io import read_cloud
from mapq.labels import FROM_FIELD, PLAUSIBLE
from mapq.patches import Patches, label_from_field
from mapq.posed import PosedScans, find_scans
from mapq.segmentation import segment
from prf.shell.poses.files import read_pose_file

DATA = ROOT.parent / "shared" / "data" / "mapq"
FEWEST_POINTS = 5000
"""Of a part of a sub-map that is worth segmenting."""
ROOM_POSES = (
    (
        (0.95267, -0.29606, 0.06901, -0.57124),
        (0.30022, 0.95195, -0.06049, 0.73136),
        (-0.04779, 0.07835, 0.99578, 0.13445),
    ),
    (
        (0.97807, -0.20367, 0.04346, -0.90158),
        (0.20623, 0.97627, -0.06614, 1.46865),
        (-0.02896, 0.07365, 0.99686, 0.17305),
    ),
    (
        (0.96937, -0.24341, 0.03264, -0.98565),
        (0.24551, 0.96383, -0.1037, 2.18069),
        (-0.00622, 0.10854, 0.99407, 0.3086),
    ),
)
"""Of the second to the fourth scan of the classroom on the first, by point-to-plane ICP of all pairs together, started
from 27 turns: points lie 7 to 16 mm off the planes of the other scans, in the median."""
CORRIDOR_POSE = (
    (0.999787, -0.01323, 0.01583, 1.560634),
    (0.013312, 0.999899, -0.005029, 0.041005),
    (-0.015762, 0.005239, 0.999862, -0.083743),
)
"""Of the second scan on the first, likewise: 17 mm, 1.5 cm from the pose of its file."""
ROOMS_POSE = (
    (0.756932, -0.652966, 0.026257, 1.961055),
    (0.652845, 0.75736, 0.014105, 0.054068),
    (-0.029096, 0.006465, 0.999556, 0.021922),
)
"""Of the second scan of two rooms on the first, likewise: 13 mm."""
FINISHED = {
    **{name: f"na_localization_maps/{name}/cloud_map.pcd" for name in ("twofloor", "cx_office", "fenchalu")},
    "region_growing": "pcl_data/region_growing_tutorial.pcd",
}
"""Maps of an office, a hall and a tunnel, and a facade with balconies."""
MILLIMETRE = 0.001
"""Taken for the unit of the facade, which is not stated: it is then 5 by 8 by 2 m."""


def kitti(data: Path, published: bool = False) -> PosedScans:
    """Return 20 scans of KITTI 00: with poses from registration, or as published."""
    folder = data / "kitti00_map-metrics"
    if published:
        return find_scans([str(folder)], FindSettings(calibration=str(folder / "derived" / "calib_Tr.txt")))
    return find_scans([str(folder)], FindSettings(poses=str(folder / "derived" / "poses_velodyne_icp.txt")))


def quad(data: Path) -> PosedScans:
    """Return five scans of New College, the points of planes alone."""
    return find_scans([str(data / "newer_college_01")], FindSettings(pattern="planes_*"), ReadOptions(bin_columns=3))


def hall(data: Path) -> PosedScans:
    """Return eleven scans of a hall, taken turning on the spot."""
    return find_scans([str(data / "plane_localization_hall")], FindSettings(quaternion="wxyz"))


def facade(data: Path) -> PosedScans:
    """Return two scans of a building with their registered poses; unregistered they are half a metre apart."""
    folder = data / "small_gicp_pair"
    files = (str(folder / "target.ply"), str(folder / "source.ply"))
    poses = np.stack([np.eye(4), read_pose_file(str(folder / "T_target_source.txt")).poses[0]])
    return PosedScans(files, poses, None, lambda number: read_cloud(files[number]), np.arange(2), str(folder))


def park(data: Path) -> PosedScans:
    """Return eleven sub-maps of a business park, chained as odometry has them."""
    folder = data / "dxmcu_map"
    return find_scans([str(folder)], FindSettings(poses=str(folder / "derived" / "poses_chain.txt")))


def room(data: Path) -> PosedScans:
    """Return four scans of a classroom with their registered poses."""
    return _registered([data / "pcl_icp_ndt_room" / f"{number}.pcd" for number in range(4)], ROOM_POSES)


def corridor(data: Path) -> PosedScans:
    """Return two scans of a corridor with their registered poses."""
    return _registered([data / "3dtk_dat" / f"scan00{number}.3d.gz" for number in range(2)], (CORRIDOR_POSE,))


def rooms(data: Path) -> PosedScans:
    """Return two scans of two rooms with their registered poses."""
    return _registered([data / "pcl_data" / f"room_scan{number}.pcd" for number in (1, 2)], (ROOMS_POSE,))


def _registered(files: Sequence[Path], motions: Sequence[Sequence[Sequence[float]]]) -> PosedScans:
    """Return scans of which each but the first lies at a pose on the first."""
    poses = np.tile(np.eye(4), (len(files), 1, 1))
    poses[1:, :3] = np.array(motions)
    names = tuple(map(str, files))
    return PosedScans(names, poses, None, lambda number: read_cloud(names[number]), np.arange(len(files)), names[0])


def finished(data: Path, name: str) -> PointCloud:
    """Return a map of others that is right; who saw what when is not known."""
    cloud = read_cloud(str(data / FINISHED[name]))
    if name != "region_growing":
        return cloud
    return PointCloud.from_world(cloud.world(), dict(cloud.fields), cloud.source, MILLIMETRE)


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
