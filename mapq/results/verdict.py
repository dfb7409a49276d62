"""From the labels of a map to whether it passes, and the tolerance at which it is judged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mapq.features.table import PatchFeatures
from mapq.model import Model
from mapq.results.content import cause_row, share_of
from prf.shell.errors import ArgumentError

if TYPE_CHECKING:
    from mapq.results.result import Result

MIN_COVERAGE = 0.2
"""Share of the points on planes that a map needs in judged patches to pass, unless another is given."""
LEAST_TOLERANCE, LEAST_ALONE = 0.1, 0.3
"""Metres of the tolerance that is chosen for a map at least, where scans are known and where points alone are."""


def verdict_of(
    result: Result, fail_over: float | None, min_coverage: float, fail_apart: float | None
) -> dict[str, Any]:
    """Return whether a map passes: :meth:`mapq.results.result.Result.verdict`."""
    for name, limit in (("fail_over", fail_over), ("min_coverage", min_coverage)):
        if limit is not None and not 0.0 <= limit <= 1.0:
            raise ArgumentError(f"{name} {limit}: must be a share between 0 and 1, such as 0.05.")
    if fail_apart is not None and not 0.0 < fail_apart < np.inf:
        raise ArgumentError(f"fail_apart {fail_apart}: must be metres above 0, such as 0.1.")
    share, coverage, apart = result.counts["share_of_area"], result.coverage, result.scans_apart
    is_good = bool(len(result.patches)) and not coverage < min_coverage
    is_good &= fail_over is None or not share > fail_over
    is_good &= fail_apart is None or apart <= fail_apart
    return {
        "share_of_area": share,
        "share_of_area_by_surface": {name: each["share_of_area"] for name, each in result.counts["by_surface"].items()},
        "coverage": coverage,
        "flat_share": flat_share_of(result),
        "fail_over": fail_over,
        "min_coverage": min_coverage,
        "fail_apart": fail_apart,
        "passed": None if fail_over is None and fail_apart is None else is_good,
        "tolerance_m": result.tolerance,
        "resolution_m": result.resolution,
        "unresolved_share_of_area": _unresolved(result),
        **cause_row(result),
        "disagreement_m": result.disagreement,
        "scans_apart_m": apart,
        "scans_apart_surface": result.scans_apart_surface,
    }


def flat_share_of(result: Result) -> float:
    """Return the share of neighbourhoods of points that show a plane where the map was cut; nan: not cut here."""
    share = result.patches.parameters.get("flat_share")
    return float(share) if isinstance(share, int | float) else float("nan")


def _unresolved(result: Result) -> float:
    """Return the share of the area of which scans do not tell on which side of the tolerance it is; nan without scans.

    One scan alone saw it, or its bounds reach farther than the tolerance to both sides.
    """
    low, metres, high = result.features.disagreement.T
    known = np.isfinite(metres)
    if not known.any():
        return float("nan")
    area = np.nan_to_num(result.area)
    is_open = ~known | (np.nan_to_num(high - low) > 2.0 * result.tolerance)
    return share_of(float(area @ is_open), float(area.sum()))


def tolerance_of(features: PatchFeatures, model: Model, asked: float | None) -> float:
    """Return the tolerance in metres: that which is asked for, or one that the map allows.

    Without one it is 0.1 m where scans are known, 0.3 m where points alone are, and at least twice what scans resolve;
    of those that the model learnt.

    Raises
    ------
    ArgumentError
        If it is asked for one that the model did not learn.
    """
    least, most = model.tolerances[0], model.tolerances[-1]
    if asked is None:
        resolution = resolution_of(features)
        chosen = LEAST_ALONE if resolution != resolution else max(LEAST_TOLERANCE, 2.0 * resolution)
        return float(np.clip(chosen, least, most))
    if not least <= asked <= most:
        learnt = f"{least:g} m alone" if least == most else f"{least:g} to {most:g} m"
        raise ArgumentError(f"tolerance {asked:g}: the model learnt {learnt}. Ask for that, or train on metres apart.")
    return asked


def resolution_of(features: PatchFeatures) -> float:
    """Return what scans resolve in metres: the median half width of the bounds of what they disagree by."""
    low, _, high = features.disagreement.T
    half = 0.5 * (high - low)[np.isfinite(high)]
    return float(np.median(half)) if len(half) else float("nan")
