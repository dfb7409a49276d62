"""A report on one result: a page that opens without a network, with the map, its regions and its patches."""

from mapq.report.findings import read_findings as read_findings
from mapq.report.page import write_report as write_report
