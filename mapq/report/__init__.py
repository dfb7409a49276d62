"""A report on one result: a page of its own that opens without a network, with the map, its regions and its patches."""

from __future__ import annotations

from mapq.report.page import MOST_POINTS, Palette, write_report
from mapq.report.source import Findings, read_findings

__all__ = ["MOST_POINTS", "Findings", "Palette", "read_findings", "write_report"]
