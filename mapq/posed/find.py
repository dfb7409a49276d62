"""Scans with their poses, from a folder or a list of files."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import AS_IT_IS, FindSettings, ReadOptions
from mapq.io.clouds import parse_cloud, recognise
from mapq.io.content import Content, suffix_of
from mapq.io.e57 import e57_poses, has_points, open_e57, read_e57_scan
from mapq.io.pcd import read_viewpoint
from mapq.io.ptx import ptx_pose, read_ptx_scan
from mapq.io.uos import read_uos_pose
from mapq.posed.files import E57_SUFFIX, MOST_LISTED, UOS_SUFFIX, natural_key, pose_file, scan_files
from mapq.posed.match import match_poses, times_of, with_poses_at
from mapq.posed.poses import laser_poses, looks_ahead, read_calibration
from mapq.posed.scans import PosedScans
from prf.shell.errors import InputError, UsageError
from prf.shell.poses.files import PoseFile, check_rotations, read_pose_file

logger = logging.getLogger(__name__)

CALIBRATION_NAME, TIMES_NAME = "calib.txt", "times.txt"
NO_CALIBRATION = "none"
QUATERNION_KEY = "scans.quaternion"
LOOKED_AT = 8
"""Scans by which the frame of points is decided, about."""


def find_scans(
    inputs: Sequence[str], settings: FindSettings | None = None, options: ReadOptions = AS_IT_IS
) -> PosedScans:
    """Return the scans of a folder or of files, with their poses.

    Scans are in the natural order of their names: 2 before 10, whatever order a shell gives.

    Parameters
    ----------
    inputs : sequence of str
        One folder, one E57 file, or the files of the scans.
    settings : FindSettings
    options : ReadOptions
        How to read a scan; of E57 the unit is that of its poses too.

    Raises
    ------
    InputError
        If there are no scans or no poses, more than one set of either, or not as many of one as of the other.
    UsageError
        If a pattern is given for files.
    """
    settings = settings or FindSettings()
    files = _files(inputs, settings.pattern)
    kinds = {suffix_of(path) for path in files}
    if E57_SUFFIX in kinds:
        if settings.calibration not in (None, NO_CALIBRATION):
            raise InputError(f"{files[0]}: a calibration is not for E57, which has its poses. Leave out --calibration.")
        scans = _e57_scans(files, options.unit or 1.0)
        return scans if settings.poses is None else replace_poses(scans, settings.poses, settings)
    path = settings.poses or (None if kinds == {UOS_SUFFIX} else pose_file(files))
    if path is None:
        poses, frame = _own_poses(files, kinds)
        return _listed(files, poses, None, settings.frame or frame, options)
    table = with_poses_at(read_pose_file(path, settings.quaternion, QUATERNION_KEY), files)
    rows = match_poses(files, table, path)
    times = table.times if table.times is not None else _times_beside(path, files[0], len(table.poses))
    poses, lost = _sensor_poses(table, path, files, settings), [Path(files[k]).name for k in np.flatnonzero(rows < 0)]
    if lost:
        named = ", ".join(lost[:MOST_LISTED]) + (", ..." if len(lost) > MOST_LISTED else "")
        logger.warning("%s: no pose for %d of %d scans, which are left out: %s", path, len(lost), len(files), named)
    files, rows = [files[k] for k in np.flatnonzero(rows >= 0)], rows[rows >= 0]
    return _listed(files, poses[rows], times_of(files) if times is None else times[rows], settings.frame, options, path)


def _files(inputs: Sequence[str], pattern: str | None) -> list[str]:
    """Return the files of the scans, in natural order."""
    if len(inputs) == 1 and Path(inputs[0]).is_dir():
        return scan_files(inputs[0], pattern)
    if pattern is not None:
        raise UsageError("--scans chooses among the files of a folder, but files are given. Leave it out.")
    for path in inputs:
        if Path(path).is_dir():
            raise InputError(f"{path}: this is a folder; give one folder alone, or files, and poses by --poses.")
        if not Path(path).is_file():
            raise InputError(f"{path}: no such file.")
    return sorted(inputs, key=natural_key)


def _own_poses(files: Sequence[str], kinds: set[str]) -> tuple[NDArray[np.float64], str]:
    """Return the poses (k, 4, 4) that scans carry themselves, and the frame of their points; InputError if none.

    Some programs write points in the frame of the sensor beside VIEWPOINT, others in that of the map: the one that
    has them closer to the sensor is believed.
    """
    if kinds == {UOS_SUFFIX}:
        beside = [Path(path.removesuffix(".gz")).with_suffix(".pose") for path in files]
        return np.array([read_uos_pose(str(path)) for path in beside]), "sensor"
    if kinds == {".ptx"}:
        return np.array([ptx_pose(Content(path)) for path in files]), "sensor"
    poses = np.array([read_viewpoint(Content(path)) for path in files]) if kinds == {".pcd"} else np.zeros((1, 4, 4))
    if not np.ptp(poses, axis=0).any():
        raise InputError(f"{files[0]}: no file of poses beside the scans. Name it with --poses.")
    from_origin, from_pose = [], []
    for number in range(0, len(files), -(-len(files) // LOOKED_AT)):
        xyz = parse_cloud(Content(files[number]))[1]
        places = xyz.metric_of(xyz.xyz[xyz.finite()])
        from_origin.append(np.median(np.linalg.norm(places, axis=1)))
        from_pose.append(np.median(np.linalg.norm(places - poses[number, :3, 3], axis=1)))
    frame = "map" if np.median(from_pose) < np.median(from_origin) else "sensor"
    logger.info("%s: poses from VIEWPOINT; points are in the frame of the %s (scans.frame)", files[0], frame)
    return poses, frame


def replace_poses(scans: PosedScans, path: str, settings: FindSettings) -> PosedScans:
    """Return the same scans with the poses of another file, under the same settings.

    A calibration is for poses of a camera: these may be such, or those of the laser.

    Raises
    ------
    InputError
        As :func:`prf.shell.poses.files.read_pose_file`, and if poses and scans do not fit.
    """
    table = with_poses_at(read_pose_file(path, settings.quaternion, QUATERNION_KEY), scans.names)
    rows = match_poses(scans.names, table, path)
    if rows.min() < 0:
        raise InputError(f"{path}: no pose for {scans.names[int(rows.argmin())]}. Give one for each scan.")
    return scans.with_poses(_sensor_poses(table, path, scans.names, settings, is_reference=True)[rows], path)


def _sensor_poses(
    table: PoseFile, path: str, names: Sequence[str], settings: FindSettings, is_reference: bool = False
) -> NDArray[np.float64]:
    """Return the poses (n, 4, 4) of a file as those of the sensor: KITTI's are those of a camera.

    A calibration that is named for these poses is used. One beside them, or one that was named for others, is
    used unless they are clearly not a camera's: registration writes poses of the laser in the same layout.
    """
    given, poses, ahead = settings.calibration, table.poses, looks_ahead(table.poses)
    if given == NO_CALIBRATION:
        return poses
    is_kitti = table.layout == "KITTI" and all(suffix_of(name) == ".bin" for name in names)
    found = given or (_beside(CALIBRATION_NAME, path, names[0]) if is_kitti else None)
    if found is not None and (ahead is not False or (given is not None and not is_reference)):
        taken = laser_poses(poses, read_calibration(found))
        logger.info("%s: taken from the camera to the laser with %s", path, found)
        if ahead is False:
            logger.warning("%s: does not move along its z axis as a camera does. Is %s meant for it?", path, found)
        return taken
    if ahead:
        words = "the sensor moves along its z axis: poses of a camera, with which floors would be vertical. Give the "
        words += "calib.txt of the sequence with --calibration, or --calibration none if the scans have these axes."
        if is_kitti:
            raise InputError(f"{path}: {words}")
        logger.warning("%s: %s", path, words)
    return poses


def _beside(name: str, poses: str, scan: str) -> str | None:
    """Return the file of that name beside the poses, or beside a scan or its folder, as KITTI has it; None if none."""
    folders = Path(poses).parent, *Path(scan).parents[:2]
    return next((str(folder / name) for folder in folders if (folder / name).is_file()), None)


def _times_beside(poses: str, scan: str, n_poses: int) -> NDArray[np.float64] | None:
    """Return the times (n,) of the file times.txt beside poses or scans, None if there is none of that length."""
    beside = _beside(TIMES_NAME, poses, scan)
    if beside is None:
        return None
    try:
        return np.array(Content(beside).text().split(), np.float64).reshape(n_poses)
    except ValueError:
        logger.warning("%s: not %d times, one a pose; it is left out", beside, n_poses)
        return None


def _listed(
    files: Sequence[str],
    poses: NDArray[np.float64],
    times: NDArray[np.float64] | None,
    frame: str | None,
    options: ReadOptions,
    poses_from: str = "",
) -> PosedScans:
    """Return scans that are files of their own."""

    def load(number: int) -> PointCloud:
        content = Content(files[number])
        if recognise(content) == "ptx":  # with a pose of its own, which is not the one
            scan, unit = read_ptx_scan(content), options.unit
            return scan if unit is None else scan.in_unit(np.full(3, unit))
        cloud = parse_cloud(content, options)[1]
        if frame != "map":
            return cloud
        local = (cloud.metric_of(cloud.xyz) - poses[number, :3, 3]) @ poses[number, :3, :3]
        return PointCloud.from_world(local, cloud.fields, cloud.source)

    return PosedScans(tuple(files), poses, times, load, np.arange(len(files)), str(Path(files[0]).parent), poses_from)


def _e57_scans(files: Sequence[str], unit: float) -> PosedScans:
    """Return the scans of E57 files that have points, file after file; `unit`: metres in that of points and poses."""
    strange = [path for path in files if suffix_of(path) != E57_SUFFIX]
    if strange:
        raise InputError(f"{strange[0]}: not E57, beside files that are. Give scans of one kind.")
    opened = [open_e57(path, path) for path in files]
    tables = [e57_poses(file, path) for file, path in zip(opened, files, strict=True)]
    places = [(n, scan) for n, file in enumerate(opened) for scan in range(len(tables[n])) if has_points(file, scan)]
    if not places:
        raise InputError(f"{files[0]}: no scan in it has points. Check how the file was written.")
    names = tuple(f"{files[number]} scan {scan}" for number, scan in places)
    poses = np.array([tables[number][scan] for number, scan in places])
    check_rotations(poses[:, :3, :3], names)
    poses[:, :3, 3] *= unit

    def load(number: int) -> PointCloud:
        file, scan = places[number]
        return read_e57_scan(opened[file], scan, files[file], unit)

    return PosedScans(names, poses, None, load, np.arange(len(names)), files[0])
