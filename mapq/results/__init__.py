"""From a cloud or its patches to a result: labels, probabilities, reasons in words, regions, and maps compared."""

from __future__ import annotations

from mapq.results.inputs import Origin, feature_settings, read_input
from mapq.results.regions import Region
from mapq.results.result import MIN_COVERAGE, Result, assess

__all__ = ["MIN_COVERAGE", "Origin", "Region", "Result", "assess", "feature_settings", "read_input"]
