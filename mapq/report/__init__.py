"""A report on one result: a page that opens without a network, with the map, its regions and its patches."""

from __future__ import annotations

from mapq.report.findings import Findings, read_findings
from mapq.report.page import MAX_POINTS, write_report

__all__ = ["MAX_POINTS", "Findings", "read_findings", "write_report"]
