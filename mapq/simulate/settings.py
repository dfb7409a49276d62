"""What a simulated map is made of: sizes of the world, the robot's laser, its drift, and the rule of truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Annotated, Any, get_type_hints

from prf.shell.errors import UsageError


@dataclass(frozen=True)
class Settings:
    """Everything but the seed.

    Attributes
    ----------
    n_points : int
        Points of the map, about: beams are left out at random until so many return.
    blocks, loops : int
        Blocks that the robot rounds one after the other, and how often it rounds each.
    street_length : float
        Metres of the street lined with offices before each block (region A of figure 4).
    block_length, block_depth : float
        Sides of a block in metres; each block varies by a tenth.
    street_width : float
        Metres from facade to facade.
    path_length : float
        Metres of the pathway after each block, with the archway (region F).
    frontage : (2,) float
        Shortest and longest facade in metres.
    height : (2,) float
        Lowest and highest building in metres.
    look_alikes : float
        How much true geometry looks like an error of the map: gaps between neighbours, fences along facades,
        free-standing walls seen from both sides. 0 none, 1 default, at most 3.
    variety : float
        How much there is beside offices: yards with lorries side by side, sheds, balconies, hedges, tanks. 0 none,
        the default; at most 3.
    clutter : float
        How many cars, trees, lamp posts and people; 0 none, 1 default, at most 3.
    speed : float
        Of the robot, in m/s.
    all_round : bool
        Whether the laser looks all round, as on cars; else half a turn ahead.
    max_range, noise : float
        Of the laser: longest range, and standard deviation of a range, both in metres.
    drift : float
        Factor on the three errors of odometry below; 0 gives a clean map.
    yaw_bias, yaw_walk : float
        Heading error in degrees per 100 m: size of the constant part (its sign varies), and standard deviation of
        the random walk after 100 m.
    scale_walk : float
        Standard deviation of the wandering error of driven length, in per cent.
    disagreement : float
        Metres along the normal by which passes over a surface must disagree for it to be suspicious.
    cell : float
        Side in metres of the cells of each true surface in which passes are compared.
    visit_gap : float
        Seconds without seeing a cell after which seeing it again is another pass.
    visit_points : int
        Points that a pass must have in a cell to count.
    """

    n_points: Annotated[int, 100, 50_000_000] = 560_000
    blocks: Annotated[int, 1, 8] = 1
    loops: Annotated[int, 1, 5] = 2
    street_length: Annotated[float, 20.0, 1000.0] = 340.0
    block_length: Annotated[float, 18.0, 500.0] = 44.0
    block_depth: Annotated[float, 16.0, 500.0] = 37.0
    street_width: Annotated[float, 9.0, 40.0] = 14.0
    path_length: Annotated[float, 22.0, 1000.0] = 240.0
    frontage: Annotated[tuple[float, float], 5.0, 100.0] = (8.0, 30.0)
    height: Annotated[tuple[float, float], 4.0, 60.0] = (6.0, 15.0)
    look_alikes: Annotated[float, 0.0, 3.0] = 1.0
    variety: Annotated[float, 0.0, 3.0] = 0.0
    clutter: Annotated[float, 0.0, 3.0] = 1.0
    speed: Annotated[float, 0.1, 10.0] = 1.0
    all_round: bool = False
    max_range: Annotated[float, 5.0, 200.0] = 35.0
    noise: Annotated[float, 0.0, 0.2] = 0.015
    drift: Annotated[float, 0.0, 10.0] = 1.0
    yaw_bias: Annotated[float, 0.0, 20.0] = 0.6
    yaw_walk: Annotated[float, 0.0, 20.0] = 0.2
    scale_walk: Annotated[float, 0.0, 20.0] = 0.4
    disagreement: Annotated[float, 0.02, 10.0] = 0.05
    cell: Annotated[float, 0.2, 10.0] = 1.0
    visit_gap: Annotated[float, 2.0, 1000.0] = 25.0
    visit_points: Annotated[int, 1, 1000] = 3

    def __post_init__(self) -> None:
        """Refuse values outside the domain that the annotation states."""
        for name, hint in get_type_hints(type(self), include_extras=True).items():
            value, (low, high) = getattr(self, name), getattr(hint, "__metadata__", (0.0, 1.0))
            for number in value if isinstance(value, tuple) else (value,):
                if not low <= number <= high:
                    raise UsageError(f"{name} {number} is outside [{low:g}, {high:g}]. Choose a value inside.")

    @classmethod
    def of_size(cls, size: str, changes: Mapping[str, Any] = MappingProxyType({})) -> Settings:
        """Return the settings of a named size, with the values of `changes` that are not None.

        Raises
        ------
        UsageError
            If there is no such size, or a value is outside its domain.
        """
        if size not in SIZES:
            raise UsageError(f"--size {size} is none of {', '.join(SIZES)}, nor city.")
        known = {field.name for field in fields(cls)}
        given = {name: value for name, value in changes.items() if value is not None and name in known}
        return cls(**{**SIZES[size], **given})

    def as_dict(self) -> dict[str, Any]:
        """Return every setting by its name."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


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
