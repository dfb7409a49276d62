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
from mapq.io.content import Content, suffix_of
from mapq.io.e57 import e57_poses, open_e57, read_e57_scan
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.ptx import read_ptx_scan
from mapq.io.uos import read_uos_pose
from mapq.posed.files import E57_SUFFIX, UOS_SUFFIX, natural_key, number_of, pose_file, scan_files, stamp_of
from mapq.posed.poses import laser_poses, looks_ahead, read_calibration
from mapq.posed.scans import PosedScans
from prf.shell.errors import InputError, UsageError
from prf.shell.trajectory import Order, Trajectory, check_rotations, read_trajectory

logger = logging.getLogger(__name__)

CALIBRATION_NAME, TIMES_NAME = "calib.txt", "times.txt"
NO_CALIBRATION = "none"
QUATERNION_KEY = "perturb.quaternion"
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
        See :func:`prf.shell.trajectory.read_trajectory`.
    options : ReadOptions
        How to read a scan; E57 states all of it.
    """

    poses: str | None = None
    calibration: str | None = None
    pattern: str | None = None
    quaternion: Order | None = None
    options: ReadOptions = AS_IT_IS


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
    UsageError
        If a pattern is given for files.
    """
    settings = settings or FindSettings()
    is_folder = len(inputs) == 1 and Path(inputs[0]).is_dir()
    if is_folder:
        files = scan_files(inputs[0], settings.pattern)
    elif settings.pattern is not None:
        raise UsageError("--scans chooses among the files of a folder, but files are given. Leave it out.")
    else:
        files = sorted(inputs, key=natural_key)
    for path in files:
        if Path(path).is_dir():
            raise InputError(f"{path}: this is a folder; give one folder alone, or files.")
        if not Path(path).is_file():
            raise InputError(f"{path}: no such file.")
    kinds = {suffix_of(path) for path in files}
    if E57_SUFFIX in kinds:
        if settings.calibration not in (None, NO_CALIBRATION):
            raise InputError(f"{files[0]}: a calibration is not for E57, which has its poses. Leave out --calibration.")
        if settings.options.unit is not None:
            raise InputError(f"{files[0]}: E57 is in metres, as its poses are. Leave out cloud.unit.")
        scans = _e57_scans(files)
        return scans if settings.poses is None else replace_poses(scans, settings.poses, settings)
    if settings.poses is None and kinds == {UOS_SUFFIX}:
        beside = [Path(path.removesuffix(".gz")).with_suffix(".pose") for path in files]
        return _listed(files, np.array([read_uos_pose(str(path)) for path in beside]), None, settings)
    path = settings.poses or pose_file(files)
    table = read_trajectory(path, settings.quaternion, QUATERNION_KEY)
    rows = match_poses(files, table, path, is_folder)
    times = table.times if table.times is not None else _times_beside(path, len(table.poses))
    poses = _sensor_poses(table, path, files, settings)[rows]
    return _listed(files, poses, None if times is None else times[rows], settings)


def replace_poses(scans: PosedScans, path: str, settings: FindSettings) -> PosedScans:
    """Return the same scans with the poses of another file, under the same settings.

    A calibration is for poses of a camera: these may be such, or those of the laser.

    Raises
    ------
    InputError
        As :func:`prf.shell.trajectory.read_trajectory`, and if poses and scans do not fit.
    """
    table = read_trajectory(path, settings.quaternion, QUATERNION_KEY)
    rows = match_poses(scans.names, table, path)
    return scans.with_poses(_sensor_poses(table, path, scans.names, settings, is_reference=True)[rows], path)


def _sensor_poses(
    table: Trajectory, path: str, names: Sequence[str], settings: FindSettings, is_reference: bool = False
) -> NDArray[np.float64]:
    """Return the poses (n, 4, 4) of a file as those of the sensor: KITTI's are those of a camera.

    A calibration that is named for these poses is used. One beside them, or one that was named for others, is
    used unless they plainly are no camera's: registration writes poses of the laser in the same layout.
    """
    given, poses, ahead = settings.calibration, table.poses, looks_ahead(table.poses)
    if given == NO_CALIBRATION:
        return poses
    is_named = given is not None and not is_reference
    if not (table.is_matrix and all(suffix_of(name) == ".bin" for name in names)):
        if is_named:
            raise InputError(
                f"{path}: a calibration is for .bin scans and rows of 12 numbers, as KITTI has them. Leave out "
                f"--calibration."
            )
        if ahead and given is None:
            logger.warning(
                "%s: the sensor moves along its z axis, as a camera does; points of a laser would lie on their side. "
                "--calibration none: the scans have these axes",
                path,
            )
        return poses
    beside = Path(path).with_name(CALIBRATION_NAME)
    found = given or (str(beside) if beside.is_file() else None)
    if found is not None and (is_named or ahead is not False):
        logger.info("%s: taken from the camera to the laser with %s", path, found)
        return laser_poses(poses, read_calibration(found))
    if ahead:
        raise InputError(
            f"{path}: the sensor moves along its z axis, so these are poses of a camera, as KITTI has them. Give the "
            f"calib.txt of the sequence with --calibration, or --calibration none if the scans have these axes."
        )
    return poses


def match_poses(names: Sequence[str], table: Trajectory, path: str, is_folder: bool = False) -> NDArray[np.int64]:
    """Return the row (k,) of the table that is the pose of each scan.

    Scans whose names are times are matched by time, where the table has times; else one row a scan by order; else the
    last number in a scan's name picks the row of that name or, without names, of that place, from 0: as the poses of a
    whole KITTI sequence and some of its scans. `is_folder`: whether --scans can choose among the scans.
    """
    stamps = np.array([stamp_of(name) for name in names], np.float64)
    if table.times is not None and np.isfinite(stamps).all():
        order = np.argsort(table.times, kind="stable")
        middle = 0.5 * (table.times[order][1:] + table.times[order][:-1])
        nearest = order[np.searchsorted(middle, stamps)]
        if len(set(nearest)) == len(names) and (np.abs(table.times[nearest] - stamps) <= SAME_TIME).all():
            return np.asarray(nearest)
    if len(table.poses) == len(names):
        return np.arange(len(names))
    keys = range(len(table.poses)) if table.names is None else (number_of(f"{name}.x") for name in table.names)
    known = {number: row for row, number in enumerate(keys)}
    rows = [known.get(number_of(name), -1) for name in names]
    if min(rows) < 0 or len(set(rows)) < len(rows) or np.isfinite(stamps).any():
        advice = "Choose scans with --scans, or other poses." if is_folder else "Give other scans, or other poses."
        raise InputError(
            f"{path}: {len(table.poses)} poses for {len(names)} scans, and the numbers in the names of the scans do "
            f"not identify theirs. {advice}"
        )
    if table.times is not None:
        _refuse_other_numbers(names, rows, table.times, path)
    return np.array(rows, np.int64)


def _refuse_other_numbers(names: Sequence[str], rows: list[int], times: NDArray[np.float64], path: str) -> None:
    """Raise InputError if the first column may be numbers of scans, by which other rows are theirs than by place."""
    row_of: dict[float | None, int] = {time: row for row, time in enumerate(times.tolist())}
    by_number = [row_of.get(number_of(name), -1) for name in names]
    if min(by_number) >= 0 and by_number != rows:
        raise InputError(
            f"{path}: is the first column times, or numbers of scans? By number {names[0]} has row {by_number[0] + 1}, "
            f"by place row {rows[0] + 1}. Give a row a scan, or leave the column out."
        )


def _times_beside(poses: str, n_poses: int) -> NDArray[np.float64] | None:
    """Return the times (n,) of the file times.txt beside the poses, None if there is none of that length."""
    beside = Path(poses).with_name(TIMES_NAME)
    if not beside.is_file():
        return None
    try:
        return np.array(Content(str(beside)).text().split(), np.float64).reshape(n_poses)
    except ValueError:
        logger.warning("%s: not %d times, one a pose; it is left out", beside, n_poses)
        return None


def _listed(
    files: Sequence[str], poses: NDArray[np.float64], times: NDArray[np.float64] | None, settings: FindSettings
) -> PosedScans:
    """Return scans that are files of their own."""

    def load(number: int) -> PointCloud:
        content = Content(files[number])
        if recognise(content) == "ptx":  # with a pose of its own, which is not the one
            scan, unit = read_ptx_scan(content), settings.options.unit
            return scan if unit is None else scan.in_unit(np.full(3, unit))
        return parse_cloud(content, settings.options)[1]

    return PosedScans(tuple(files), poses, times, load, np.arange(len(files)), str(Path(files[0]).parent))


def _e57_scans(files: Sequence[str]) -> PosedScans:
    """Return the scans of E57 files, one file after the other."""
    strange = [path for path in files if suffix_of(path) != E57_SUFFIX]
    if strange:
        raise InputError(f"{strange[0]}: not E57, beside files that are. Give scans of one kind.")
    opened = [open_e57(path, path) for path in files]
    tables = [e57_poses(file, path) for file, path in zip(opened, files, strict=True)]
    places = [(number, scan) for number, table in enumerate(tables) for scan in range(len(table))]
    names = tuple(f"{files[number]} scan {scan}" for number, scan in places)
    poses = np.concatenate(tables)
    check_rotations(poses[:, :3, :3], names)

    def load(number: int) -> PointCloud:
        file, scan = places[number]
        return read_e57_scan(opened[file], scan, files[file])

    return PosedScans(names, poses, None, load, np.arange(len(names)), files[0])
