"""Readers: one file a format, all of them returning `Readings`."""

from __future__ import annotations

from prf.logs.describe import LogSummary, describe
from prf.logs.open import log_stem, read_logs, read_readings
from prf.logs.points import PointSummary, PointTable, describe_points, read_point_data
from prf.logs.posed import Poses, read_poses
from prf.logs.poses import CONE
from prf.logs.readings import Kind, LogNotes, NoReadings, Readings, ScanTable
from prf.logs.suspicions import warn_of_spoiling
from prf.logs.table import write_table
from prf.logs.thin import thin

__all__ = [
    "CONE",
    "Kind",
    "LogNotes",
    "LogSummary",
    "NoReadings",
    "PointSummary",
    "PointTable",
    "Poses",
    "Readings",
    "ScanTable",
    "describe",
    "describe_points",
    "log_stem",
    "read_logs",
    "read_point_data",
    "read_poses",
    "read_readings",
    "thin",
    "warn_of_spoiling",
    "write_table",
]
