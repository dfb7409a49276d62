"""Posterior over polygonal maps from localized laser and sonar readings.

All names are imported when they are first used, so that `import prf` is quick (docs/python-api.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from prf.api.sampling import resume, sample
    from prf.api.science import read_readings
    from prf.configuration import Prior
    from prf.model.sensors import LaserModel, PointModel, SonarModel
    from prf.output.run import Run, read_run
    from prf.readings import PointTable, Readings
    from prf.readings.arrays import laser, points, sonar
    from prf.sampler.session import Session
    from prf.shell.errors import PrfError

__all__ = [
    "LaserModel",
    "PointModel",
    "PointTable",
    "PrfError",
    "Prior",
    "Readings",
    "Run",
    "Session",
    "SonarModel",
    "laser",
    "points",
    "read_readings",
    "read_run",
    "resume",
    "sample",
    "sonar",
]

_HOMES = {
    "prf.api.sampling": ("resume", "sample"),
    "prf.api.science": ("read_readings",),
    "prf.configuration": ("Prior",),
    "prf.output.run": ("Run", "read_run"),
    "prf.readings": ("PointTable", "Readings"),
    "prf.readings.arrays": ("laser", "points", "sonar"),
    "prf.sampler.session": ("Session",),
    "prf.model.sensors": ("LaserModel", "PointModel", "SonarModel"),
    "prf.shell.errors": ("PrfError",),
}
"""Module to the names that it lends to this package; a test holds them to what type checkers see above."""


if not TYPE_CHECKING:  # which would take any misspelt name for one of these

    def __getattr__(name: str) -> object:
        """Import what is used for the first time."""
        from importlib import import_module  # noqa: PLC0415

        for module, names in _HOMES.items():
            if name in names:
                value = globals()[name] = getattr(import_module(module), name)
                return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names that this package offers."""
    return sorted({*globals(), *__all__})
