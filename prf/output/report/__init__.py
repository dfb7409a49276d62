"""A report on one run: a page that opens without a network, with the map, its draws, and answers computed from them."""

from prf.output.report.live import LiveReport as LiveReport
from prf.output.report.page import page_beside as page_beside
from prf.output.report.page import write_report as write_report
from prf.output.report.truth import true_errors as true_errors
