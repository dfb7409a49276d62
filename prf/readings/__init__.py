"""Readers: one file a format, all of them returning `Readings`."""

from __future__ import annotations

from prf.readings.describe import LogSummary, describe, warn_of_spoiling
from prf.readings.ground import thin
from prf.readings.open import log_stem, read_logs, read_readings
from prf.readings.points import PointTable, describe_points, read_point_data
from prf.readings.poses import GivenPoses, read_poses
from prf.readings.readings import Kind, LogNotes, NoReadings, Readings, ScanTable
from prf.readings.several import join_logs
from prf.readings.table import write_table

__all__ = [
    "GivenPoses",
    "Kind",
    "LogNotes",
    "LogSummary",
    "NoReadings",
    "PointTable",
    "Readings",
    "ScanTable",
    "describe",
    "describe_points",
    "join_logs",
    "log_stem",
    "read_logs",
    "read_point_data",
    "read_poses",
    "read_readings",
    "thin",
    "warn_of_spoiling",
    "write_table",
]
