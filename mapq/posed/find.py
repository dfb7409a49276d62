"""Scans with their poses, from a folder or a list of files."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content, read_bytes
from mapq.io.e57 import e57_poses, open_e57, read_e57_scan
from mapq.io.fields import make_cloud
from mapq.io.options import ReadOptions
from mapq.io.ptx import read_ptx_scan
from mapq.io.recognise import recognise, suffix_of
from mapq.posed.calibration import laser_poses, looks_ahead, read_calibration
from mapq.posed.files import E57_SUFFIX, UOS_SUFFIX, natural_key, pose_file, refuse_missing, scan_files
from mapq.posed.match import match_poses
from mapq.posed.poses import PoseTable, check_rotations, read_poses
from mapq.posed.scans import PosedScans
from mapq.posed.uos import read_uos_pose
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

CALIBRATION_NAME, TIMES_NAME = "calib.txt", "times.txt"
NO_CALIBRATION = "none"


@dataclass(frozen=True)
class FindSettings:
    """What a user says of scans and poses beside their names.

    Attributes
    ----------
    poses : str or None
        File of poses; None: the one beside the scans.
    calibration : str or None
        calib.txt of KITTI where poses are those of a camera; None: the one beside the poses; "none": there is none.
    pattern : str or None
        Which files of a folder are scans, such as ``planes_*.bin``.
    quaternion : {"xyzw", "wxyz"} or None
        See :func:`mapq.posed.poses.read_poses`.
    bin_columns : {3, 4}
        Columns of .bin files.
    """

    poses: str | None = None
    calibration: str | None = None
    pattern: str | None = None
    quaternion: str | None = None
    bin_columns: int = 4


def find_scans(inputs: Sequence[str], settings: FindSettings | None = None) -> PosedScans:
    """Return the scans of a folder or of files, with their poses.

    Scans go by the natural order of their names: 2 before 10, whatever order a shell gives.

    Parameters
    ----------
    inputs : sequence of str
        One folder, one E57 file, or the files of the scans.
    settings : FindSettings

    Raises
    ------
    InputError
        If there are no scans or no poses, more than one set of either, or not as many of one as of the other.
    """
    settings = settings or FindSettings()
    is_folder = len(inputs) == 1 and Path(inputs[0]).is_dir()
    files = scan_files(inputs[0], settings.pattern) if is_folder else sorted(inputs, key=natural_key)
    refuse_missing(files)
    if any(suffix_of(Path(name).name) == E57_SUFFIX for name in files):
        scans = _e57_scans(files)
        return scans if settings.poses is None else replace_poses(scans, settings.poses, settings)
    if settings.poses is None and all(suffix_of(Path(name).name) == UOS_SUFFIX for name in files):
        return _listed(files, np.array([read_uos_pose(_pose_beside(name)) for name in files]), None, settings)
    path = settings.poses or pose_file(files)
    poses, chosen, table = _poses_of(path, files, settings)
    times = table.times if table.times is not None else _times_beside(path, len(table.poses))
    return _listed(files, poses, None if times is None else times[chosen], settings)


def replace_poses(scans: PosedScans, path: str, settings: FindSettings) -> PosedScans:
    """Return the same scans with the poses of another file, under the same settings.

    A calibration is for poses of a camera: these may be such, or those of the laser.

    Raises
    ------
    InputError
        As :func:`mapq.posed.poses.read_poses`, and if poses and scans do not fit.
    """
    poses = _poses_of(path, scans.names, settings, is_reference=True)[0]
    return scans.with_poses(poses, path)


def _poses_of(
    path: str, names: Sequence[str], settings: FindSettings, is_reference: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.int64], PoseTable]:
    """Return the pose (k, 4, 4) of the sensor at each scan, the rows they stand in, and the table."""
    table = read_poses(path, settings.quaternion)
    chosen = match_poses(names, table, path)
    if table.is_matrix and all(suffix_of(Path(name).name) == ".bin" for name in names):
        return _of_laser(table.poses, path, settings.calibration, is_reference)[chosen], chosen, table
    if settings.calibration not in (None, NO_CALIBRATION) and not is_reference:
        raise InputError(
            f"{path}: a calibration goes with .bin scans and rows of 12 numbers, as KITTI has them. Leave out "
            f"--calibration."
        )
    if settings.calibration is None and looks_ahead(table.poses):
        logger.warning(
            "%s: the sensor moves along its z axis, as a camera does; points of a laser would lie on their side. "
            "--calibration none says that the scans have these axes",
            path,
        )
    return table.poses[chosen], chosen, table


def _of_laser(poses: NDArray[np.float64], path: str, given: str | None, is_reference: bool) -> NDArray[np.float64]:
    """Return the poses (k, 4, 4) of the laser: those given, unless they are those of KITTI's camera.

    A calibration that is named for these poses is taken. One that lies beside them, or that was named for others, is
    taken unless they plainly are no camera's: registration writes poses of the laser in the same layout.
    """
    if given == NO_CALIBRATION:
        return poses
    camera = looks_ahead(poses)
    beside = str(Path(path).with_name(CALIBRATION_NAME))
    found = given or (beside if Path(beside).is_file() else None)
    if given is not None and not is_reference:
        camera = True
    if found is not None and camera is not False:
        motion = read_calibration(found)
        logger.info("%s: taken from the camera to the laser with %s", path, found)
        return laser_poses(poses, motion)
    if camera:
        raise InputError(
            f"{path}: the sensor moves along its z axis, so these are poses of a camera, as KITTI has them. Give the "
            f"calib.txt of the sequence with --calibration, or --calibration none if the scans have these axes."
        )
    return poses


def _times_beside(poses: str, n_poses: int) -> NDArray[np.float64] | None:
    """Return the times (n,) of the file times.txt beside the poses, None if there is none of that length."""
    beside = Path(poses).with_name(TIMES_NAME)
    if not beside.is_file():
        return None
    fields = read_bytes(str(beside)).decode("utf-8", "replace").split()
    try:
        times = np.array(fields, np.float64)
    except ValueError:
        times = np.empty(0)
    if len(times) == n_poses and np.isfinite(times).all():
        return times
    logger.warning("%s: not %d times, one a pose; it is left out", beside, n_poses)
    return None


def _pose_beside(path: str) -> str:
    """Return the name of the .pose file of a .3d file."""
    return str(Path(path.removesuffix(".gz")).with_suffix(".pose"))


def _listed(
    files: Sequence[str], poses: NDArray[np.float64], times: NDArray[np.float64] | None, settings: FindSettings
) -> PosedScans:
    """Return scans that are files of their own."""

    def load(number: int) -> PointCloud:
        return _read_scan(files[number], ReadOptions(bin_columns=settings.bin_columns))

    return PosedScans(tuple(files), poses, times, load, np.arange(len(files)), str(Path(files[0]).parent))


def _read_scan(path: str, options: ReadOptions) -> PointCloud:
    """Return the points of a scan in the frame of its sensor: PTX has a pose in the file too, which is not the one."""
    content = Content(path)
    if recognise(content) == "ptx":
        return make_cloud(read_ptx_scan(content.data(), content.source), content.source)
    return parse_cloud(content, options)[1]


def _e57_scans(files: Sequence[str]) -> PosedScans:
    """Return the scans of E57 files, one file after the other."""
    strange = [path for path in files if suffix_of(Path(path).name) != E57_SUFFIX]
    if strange:
        raise InputError(f"{strange[0]}: not E57, beside files that are. Give scans of one kind.")
    opened = [open_e57(path, path) for path in files]
    tables = [e57_poses(file, path) for file, path in zip(opened, files, strict=True)]
    places = [(number, scan) for number, table in enumerate(tables) for scan in range(len(table))]
    names = tuple(f"{files[number]} scan {scan}" for number, scan in places)
    poses = np.concatenate(tables)
    check_rotations(poses[:, :3, :3], list(names))
    load = _e57_loader(opened, files, places)
    return PosedScans(names, poses, None, load, np.arange(len(names)), files[0])


def _e57_loader(
    opened: Sequence[object], files: Sequence[str], places: Sequence[tuple[int, int]]
) -> Callable[[int], PointCloud]:
    def load(number: int) -> PointCloud:
        file, scan = places[number]
        return read_e57_scan(opened[file], scan, files[file])

    return load
