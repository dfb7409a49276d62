"""A trajectory as TUM has it, which evo and SLAM programs read: timestamp tx ty tz qx qy qz qw."""

from __future__ import annotations

import numpy as np

from prf.output.export.source import Source, draw_number
from prf.poses.posterior import Trajectory
from prf.shell.errors import InputError


def trajectory_of(source: Source) -> Trajectory:
    """Return the sampled poses of a run (InputError if it has none)."""
    run = source.require_run("trajectory")
    if run.trajectory is None:
        raise InputError(
            f"{source.path}: its poses were not sampled: they are those of the log. For a trajectory sample with "
            "--pose-noise METRES RADIANS or --odometry KIND."
        )
    if not len(run.trajectory.draws):
        raise InputError(f"{source.path}: no draws yet, so no trajectory. Resume with prf sample --resume.")
    return run.trajectory


def tum_text(source: Source, draw: int | None) -> str:
    """Return the posterior means of the poses of a run, or those of one draw.

    Numbers of scans are the times where the time of any pose is unknown.
    """
    found = trajectory_of(source)
    poses = found.mean if draw is None else found.given + found.draws[draw_number(source.require_run("draws"), draw)]
    time = found.time if np.isfinite(found.time).all() else found.scan.astype(np.float64)
    flat, half = np.zeros(len(poses)), 0.5 * poses[:, 2]
    rows = np.column_stack([time, poses[:, :2], flat, flat, flat, np.sin(half), np.cos(half)])
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())
