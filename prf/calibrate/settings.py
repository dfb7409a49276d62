"""Fitted parameters as a settings file and as a report."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from prf.calibrate.drive import Calibrated
from prf.shell.settings import settings_text

DIGITS = 5
"""Significant digits of a parameter in the file; errors are never below 1e-4 of it."""


def fitted_text(found: Iterable[Calibrated]) -> str:
    """Return a settings file of fitted parameters, with standard errors, and what comes from the prior alone."""
    tables: dict[str, dict[str, float]] = {}
    comments = {"": "Fitted by prf calibrate."}
    for part in found:
        values = {"max_range": part.max_range}
        if part.kind == "sonar":
            values["cone"] = _rounded(part.cone)
        for name, value, error, told in zip(
            part.family.names, part.fit.value, part.fit.error, part.fit.told, strict=True
        ):
            values[name] = _rounded(value)
            comments[f"{part.kind}.{name}"] = f"+- {error:.2g}" + ("" if told else ", hardly informed by the readings")
        tables[part.kind] = values
        comments[part.kind] = (
            f"{part.n_readings} readings of {part.n_scans} scans, {part.n_in_view} with a wall in view"
        )
    return settings_text(tables, comments)


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def report_of(part: Calibrated) -> dict[str, Any]:
    """Return everything about one sensor for ``--json``."""
    default = part.family.natural(part.family.default)
    rows = zip(part.family.names, default, part.fit.value, part.fit.error, part.fit.told, strict=True)
    return {
        "n_readings": part.n_readings,
        "n_scans": part.n_scans,
        "n_outside": part.n_outside,
        "n_occupied": part.n_occupied,
        "n_in_view": part.n_in_view,
        "max_range": part.max_range,
        "cone": part.cone,
        "log_likelihood_default": -part.fit.loss_before,
        "log_likelihood": -part.fit.loss,
        "log_likelihood_no_map": -part.no_map,
        "folds": part.folds,
        "held_out_nll_default": float(part.held_out[0]),
        "held_out_nll": float(part.held_out[1]),
        "converged": part.fit.converged,
        "parameters": [
            {"name": name, "default": float(old), "value": float(new), "error": float(error), "told": bool(told)}
            for name, old, new, error, told in rows
        ],
    }


def lines_of(part: Calibrated) -> list[str]:
    """Return everything about one sensor for a person."""
    yours = report_of(part)
    per = 1.0 / part.n_readings
    rows = [f"{part.kind:22} {'default':>9} {'fitted':>9} {'+-':>9}"]
    for row in yours["parameters"]:
        note = "" if row["told"] else "   hardly told by the readings"
        rows.append(f"{row['name']:22} {row['default']:9.4g} {row['value']:9.4g} {row['error']:9.2g}{note}")
    rows += [
        f"{'readings':22} {part.n_readings} of {part.n_scans} scans, {part.n_in_view} with a wall in view",
        f"{'log likelihood':22} {-part.fit.loss_before * per:.4f} a reading before, {-part.fit.loss * per:.4f} after, "
        f"{-part.no_map * per:.4f} without the map",
    ]
    if not np.isnan(part.held_out).any():
        rows.append(
            f"{'held out':22} {-part.held_out[0]:.4f} a reading before, {-part.held_out[1]:.4f} after "
            f"({part.folds} folds)"
        )
    return rows
