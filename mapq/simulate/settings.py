"""Settings of a simulated map: sizes of the world, the robot's laser, its drift, and the rule of truth."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any

from pydantic import Field, ValidationError

from prf.shell.cli.settings import Table, key
from prf.shell.errors import UsageError

NONE: Mapping[str, Any] = MappingProxyType({})
Frontage = Annotated[float, Field(ge=5.0, le=100.0)]
Height = Annotated[float, Field(ge=4.0, le=60.0)]


class Settings(Table):
    """Everything but the seed."""

    n_points: int = key(560_000, "", "about: beams are left out at random until so many return", ge=100, le=50_000_000)
    blocks: int = key(1, "", "blocks that the robot drives around, one after the other", ge=1, le=8)
    loops: int = key(2, "", "how often it drives around each block", ge=1, le=5)
    street_length: float = key(340.0, "m", "street lined with offices before each block (region A)", ge=20, le=1000)
    block_length: float = key(44.0, "m", "long side of a block; each varies by a tenth", ge=18, le=500)
    block_depth: float = key(37.0, "m", "short side of a block", ge=16, le=500)
    street_width: float = key(14.0, "m", "from facade to facade", ge=9, le=40)
    path_length: float = key(240.0, "m", "pathway after each block, with the archway (region F)", ge=22, le=1000)
    frontage: tuple[Frontage, Frontage] = key((8.0, 30.0), "m", "shortest and longest facade")
    height: tuple[Height, Height] = key((6.0, 15.0), "m", "lowest and highest building")
    # Gaps between neighbours, fences along facades, free-standing walls seen from both sides.
    look_alikes: float = key(1.0, "", "true geometry that looks like an error of the map; 0: none", ge=0, le=3)
    variety: float = key(0.0, "", "yards with lorries, sheds, balconies, hedges, tanks; 0: offices alone", ge=0, le=3)
    clutter: float = key(1.0, "", "cars, trees, lamp posts and people; 0: none", ge=0, le=3)
    speed: float = key(1.0, "m/s", "of the robot", ge=0.1, le=10)
    all_round: bool = key(False, "", "the laser looks all round, as on cars; else half a turn ahead")
    max_range: float = key(35.0, "m", "longest range of the laser", ge=5, le=200)
    noise: float = key(0.015, "m", "standard deviation of a range", ge=0, le=0.2)
    drift: float = key(1.0, "", "factor on the three errors of odometry below; 0: a clean map", ge=0, le=10)
    yaw_bias: float = key(0.6, "deg", "size of the constant heading error after 100 m", ge=0, le=20)
    yaw_walk: float = key(0.2, "deg", "standard deviation of the random walk of the heading after 100 m", ge=0, le=20)
    scale_walk: float = key(0.4, "%", "standard deviation of the wandering error of driven length", ge=0, le=20)
    disagreement: float = key(0.05, "m", "passes over a suspicious surface disagree by more", ge=0.02, le=10)
    cell: float = key(1.0, "m", "side of the cells of each true surface in which passes are compared", ge=0.2, le=10)
    visit_gap: float = key(25.0, "s", "without seeing a cell, after which to see it is another pass", ge=2, le=1000)
    visit_points: int = key(3, "", "points that a pass must have in a cell to count", ge=1, le=1000)

    @classmethod
    def of_size(cls, size: str, changes: Mapping[str, Any] = NONE) -> Settings:
        """Return the settings of a named size, with the values of `changes` that are not None.

        Raises
        ------
        UsageError
            If there is no such size, or a value is outside its domain.
        """
        if size not in SIZES:
            raise UsageError(f"--size {size}: must be one of {', '.join(SIZES)}, city.")
        given = {name: value for name, value in changes.items() if value is not None}
        try:
            return cls(**{**SIZES[size], **given})
        except ValidationError as error:
            first = error.errors()[0]
            raise UsageError(f"{first['loc'][0]} {first['input']}: {first['msg']}.") from None


SIZES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "small": {
            "n_points": 55_000,
            "street_length": 170.0,
            "block_length": 20.0,
            "block_depth": 18.0,
            "street_width": 11.0,
            "path_length": 120.0,
            "frontage": (7.0, 14.0),
            "height": (5.0, 8.0),
            # A lap is shorter; the second must still end as far from the first.
            "yaw_bias": 0.8,
            "yaw_walk": 0.25,
            # Sparser, so that a pass still has its points in most cells.
            "cell": 2.0,
        },
        "medium": {},
        "large": {"blocks": 2, "n_points": 1_120_000},
    }
)
"""Named sizes; medium is the size of the map of figure 4."""
