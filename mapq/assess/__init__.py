"""From a cloud or its patches to a result: labels, probabilities, reasons in words, regions, and maps compared."""

from __future__ import annotations

from mapq.assess.inputs import feature_settings, read_input
from mapq.assess.regions import Region
from mapq.assess.result import Result, assess

__all__ = ["Region", "Result", "assess", "feature_settings", "read_input"]
