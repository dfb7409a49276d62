"""What a user states about a cloud where the file itself does not."""

from __future__ import annotations

import math
from dataclasses import dataclass

from prf.shell.errors import UsageError

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200.0 / 3937.0}
"""Metres in each; the US survey foot is two millionths longer than the foot, which is metres on a grid."""


@dataclass(frozen=True)
class ReadOptions:
    """How to read a cloud; UsageError for a value outside its domain.

    Attributes
    ----------
    bin_columns : {3, 4}
        Columns of a KITTI .bin; other formats state them.
    unit : float or None
        Metres in a unit of the coordinates; None: as the file states (LAS), else metres.
    topic : str or None
        Topic of a bag's point clouds; None: the only one.
    frame : str or None
        Frame of the map, into which tf takes the clouds of a bag; None: ``map``.
    """

    bin_columns: int = 4
    unit: float | None = None
    topic: str | None = None
    frame: str | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        if self.bin_columns not in (3, 4):
            raise UsageError(f"bin_columns {self.bin_columns}: must be 3 or 4.")
        if self.unit is not None and not 1e-9 <= self.unit <= 1e6:
            raise UsageError(f"unit {self.unit:g}: must be from 1e-09 to 1e+06 m.")

    def refuse_given(self, path: str) -> None:
        """Raise UsageError if anything is given for the PATCHES file `path`, which holds its unit."""
        given = [name for name, value in vars(self).items() if value != getattr(AS_IT_IS, name)]
        if given:
            raise UsageError(
                f"{path} is segmented already, and holds its unit: leave the {given[0]} out, or segment anew."
            )


AS_IT_IS = ReadOptions()
"""No option given."""


def parse_unit(text: str) -> float:
    """Return the metres in a unit: a name of `UNITS`, or a number of metres such as 0.01; ValueError for others."""
    name = text.strip().lower()
    try:
        metres = UNITS[name] if name in UNITS else float(name)
    except ValueError:
        metres = math.nan
    if not 0.0 < metres < math.inf:
        raise ValueError(f"'{text}': must be one of {', '.join(UNITS)}, or its length in metres such as 0.01")
    return metres
