"""Scans of a robot that drives through rooms, for tests of trajectories."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from scipy.ndimage import uniform_filter1d

from prf.configuration import ODOMETRY, LaserPhysics
from prf.poses.model import pose_model
from prf.poses.plane import compose
from prf.readings import LogNotes, Readings, ScanTable
from prf.simulate.sensors import bearings_of, simulate_laser


def box(x0, y0, x1, y1):
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


ROOM = np.array([*box(0, 0, 8, 6), *box(2.5, 2.0, 3.3, 3.4), *box(5.5, 3.5, 6.5, 4.0)])

BLOCK = np.array(
    [
        *box(0, 0, 16, 12),
        *box(3, 3, 13, 9),
        *box(0, 5, 0.6, 6),
        *box(6, 2.5, 7, 3),
        *box(15.2, 8, 16, 8.4),
        *box(9, 11, 10.5, 12),
    ]
)


def round_the_block(spacing=0.6):
    """Return poses (n, 3) of a drive once and a half round the corridor of the block."""
    corners = np.array([(1.5, 1.5), (14.5, 1.5), (14.5, 10.3), (1.5, 10.3)] * 2)[:7]
    poses = []
    for (x0, y0), (x1, y1) in itertools.pairwise(corners.tolist()):
        share = np.arange(0.0, 1.0, spacing / np.hypot(x1 - x0, y1 - y0))
        heading = np.full(len(share), np.arctan2(y1 - y0, x1 - x0))
        poses.append(np.column_stack([x0 + share * (x1 - x0), y0 + share * (y1 - y0), heading]))
    found = np.concatenate(poses)
    found[:, 2] = np.unwrap(found[:, 2])
    # Corners are cut, as a robot does that turns while it drives.
    return np.column_stack([uniform_filter1d(each, 4, mode="nearest") for each in found.T])


def odometry_of(truth, kind="wheels"):
    """Return the prior of poses (n, 3) by odometry along them."""
    readings = readings_at(ROOM, np.array([[4.0, 1.0, 0.0]] * len(truth)), truth, n_beams=2)
    return pose_model(readings, None, None, ODOMETRY[kind]).prior


def driven_beside(readings, driven):
    """Return readings of a log whose odometry (n, 3) is a file beside its poses."""
    scans = readings.notes.scans._replace(odometry=driven)
    return dataclasses.replace(readings, notes=dataclasses.replace(readings.notes, scans=scans))


def readings_at(walls, truth, given, seed=0, n_beams=90, **physics):
    """Return the scans of a laser at true poses (n, 3), as a log has them that takes the robot to be at given ones."""
    physics = LaserPhysics(beams=n_beams, max_range=12.0, **physics)
    ranges = simulate_laser(np.asarray(walls, float), truth, physics, np.random.default_rng(seed))
    n = np.arange(len(truth))
    beams = np.stack(
        [np.zeros_like(ranges), np.zeros_like(ranges), np.tile(bearings_of(physics), (len(n), 1))], axis=-1
    )
    world = compose(given[:, None], beams).reshape(-1, 3)
    table = ScanTable(n, n + 1, np.full(len(n), n_beams), np.zeros(len(n), int), given, n.astype(float))
    readings = Readings.from_arrays(
        world[:, :2],
        world[:, 2],
        ranges.ravel(),
        scan=np.repeat(n, n_beams),
        time=np.repeat(n.astype(float), n_beams),
        notes=LogNotes(scans=table),
    )
    return readings.within(physics.max_range)


def off(found, truth):
    """Return the root mean square distance of poses from the truth, aligned with it, metres."""
    a, b = found[:, :2] - found[:, :2].mean(axis=0), truth[:, :2] - truth[:, :2].mean(axis=0)
    turn = np.angle(np.sum((b[:, 0] + 1j * b[:, 1]) * (a[:, 0] - 1j * a[:, 1])))
    left = np.exp(1j * turn) * (a[:, 0] + 1j * a[:, 1]) - (b[:, 0] + 1j * b[:, 1])
    return float(np.sqrt(np.mean(np.abs(left) ** 2)))
