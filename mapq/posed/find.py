"""Scans with their poses, from a folder or a list of files."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.clouds import parse_cloud, recognise
from mapq.io.content import Content, read_bytes, suffix_of
from mapq.io.e57 import e57_poses, open_e57, read_e57_scan
from mapq.io.fields import make_cloud
from mapq.io.options import ReadOptions
from mapq.io.ptx import read_ptx_scan
from mapq.io.uos import read_uos_pose
from mapq.posed.files import (
    E57_SUFFIX,
    UOS_SUFFIX,
    natural_key,
    number_of,
    pose_file,
    refuse_missing,
    scan_files,
    stamp_of,
)
from mapq.posed.poses import PoseTable, check_rotations, laser_poses, looks_ahead, read_calibration, read_poses
from mapq.posed.scans import PosedScans
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

CALIBRATION_NAME, TIMES_NAME = "calib.txt", "times.txt"
NO_CALIBRATION = "none"
SAME_TIME = 1e-3
"""Seconds within which the name of a scan is the time of a pose: either may have been rounded."""


@dataclass(frozen=True)
class FindSettings:
    """What a user states about scans and poses besides their names.

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

    Scans are in the natural order of their names: 2 before 10, whatever order a shell gives.

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
        return _listed(
            files,
            np.array([read_uos_pose(str(Path(name.removesuffix(".gz")).with_suffix(".pose"))) for name in files]),
            None,
            settings,
        )
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
    """Return the pose (k, 4, 4) of the sensor at each scan, their rows, and the table."""
    table = read_poses(path, settings.quaternion)
    chosen = match_poses(names, table, path)
    if table.is_matrix and all(suffix_of(Path(name).name) == ".bin" for name in names):
        return _of_laser(table.poses, path, settings.calibration, is_reference)[chosen], chosen, table
    if settings.calibration not in (None, NO_CALIBRATION) and not is_reference:
        raise InputError(
            f"{path}: a calibration is for .bin scans and rows of 12 numbers, as KITTI has them. Leave out "
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

    A calibration that is named for these poses is used. One beside them, or one that was named for others, is
    used unless they plainly are no camera's: registration writes poses of the laser in the same layout.
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


def match_poses(names: Sequence[str], table: PoseTable, path: str) -> NDArray[np.int64]:
    """Return the row (k,) of the table that is the pose of each scan.

    Scans whose names are times are matched by time, where the table has times; else one row a scan by order; else the
    last number in a scan's name picks the row of that name or, without names, of that place, from 0: as the poses of a
    whole KITTI sequence and some of its scans.
    """
    stamps = [stamp_of(name) for name in names]
    found = _match_times(np.array(stamps, np.float64), table.times) if table.times is not None else None
    if found is not None:
        return found
    if len(table.poses) == len(names):
        return np.arange(len(names))
    wrong = InputError(
        f"{path}: {len(table.poses)} poses for {len(names)} scans, and the numbers in the names of the scans do not "
        f"identify theirs. Choose scans with --scans, or other poses with --poses."
    )
    if any(stamp is not None for stamp in stamps):
        raise wrong
    if table.names is not None:
        known = {number_of(f"{name}.x"): row for row, name in enumerate(table.names)}
    else:
        known = {row: row for row in range(len(table.poses))}
    rows = [known.get(number_of(name), -1) for name in names]
    if min(rows) < 0 or len(set(rows)) < len(rows):
        raise wrong
    if table.times is not None:
        _refuse_other_numbers([number_of(name) for name in names], rows, table.times, path)
    return np.array(rows, np.int64)


def _refuse_other_numbers(
    numbers: Sequence[int | None], rows: Sequence[int], times: NDArray[np.float64], path: str
) -> None:
    """Raise InputError if the first column may be numbers of scans, by which other rows are theirs than by place."""
    row_of = {float(time): row for row, time in enumerate(times.tolist())}
    by_number = [row_of.get(-1.0 if number is None else float(number), -1) for number in numbers]
    if min(by_number) >= 0 and by_number != list(rows):
        raise InputError(
            f"{path}: are the whole numbers of its first column times, or the numbers of scans? By these scan "
            f"{numbers[0]} has row {by_number[0] + 1}, by its place row {rows[0] + 1}. Give a row a scan, or leave the "
            f"column out."
        )


def _match_times(stamps: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.int64] | None:
    """Return the row (k,) of the times (n,) that each stamp (k,) is; None where one is none, or two are the same."""
    if not np.isfinite(stamps).all():
        return None
    order = np.argsort(times, kind="stable")
    middle = 0.5 * (times[order][1:] + times[order][:-1])
    rows = order[np.searchsorted(middle, stamps)]
    is_one = len(set(rows.tolist())) == len(rows) and (np.abs(times[rows] - stamps) <= SAME_TIME).all()
    return rows if is_one else None


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

    def load(number: int) -> PointCloud:
        file, scan = places[number]
        return read_e57_scan(opened[file], scan, files[file])

    return PosedScans(names, poses, None, load, np.arange(len(names)), files[0])
