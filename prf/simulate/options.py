"""From the options of a command to a configuration; options that have no effect are refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from prf.shell.errors import UsageError
from prf.simulate.laser import LaserPhysics
from prf.simulate.simulation import ARAK, OFFICE, SimulateConfig
from prf.simulate.sonar import SonarPhysics

FILE = "FILE"
WORLDS_OF = {"size": (OFFICE, ARAK), "scale": (ARAK,)}  # options for some worlds only


def config_of(options: Mapping[str, Any], laser: bool, sonar: bool) -> SimulateConfig:
    """Return the configuration that options ask for.

    `options`: name to value, None for the default: fields of :class:`SimulateConfig`, and with ``laser_`` or ``sonar_``
    before them of :class:`LaserPhysics` and :class:`SonarPhysics`. `laser`, `sonar`: whether the robot has them.
    """
    given = {name: value for name, value in options.items() if value is not None}
    for name, why in _idle(given, laser, sonar):
        raise UsageError(f"{_flag(name)} {why}. Leave it out, or change that.")
    parts = {prefix: _part(given, prefix) for prefix in ("laser_", "sonar_")}
    return SimulateConfig(
        **{name: value for name, value in given.items() if not name.startswith(tuple(parts))},
        laser=LaserPhysics(**parts["laser_"]) if laser else None,
        sonar=SonarPhysics(**parts["sonar_"]) if sonar else None,
    )


def _idle(given: Mapping[str, Any], laser: bool, sonar: bool) -> Iterator[tuple[str, str]]:
    """Yield the options without effect, and why they have none."""
    world = given.get("world", OFFICE)
    kind = world if world in (OFFICE, ARAK) else FILE
    for name in given:
        if kind not in WORLDS_OF.get(name, (kind,)):
            yield name, f"is for --world {' or '.join(WORLDS_OF[name])}"
        if name.startswith("laser_") and not laser:
            yield name, "is for a laser, and there is --no-laser"
        if name.startswith("sonar_") and not sonar:
            yield name, "is for a sonar, and there is no --sonar"


def _flag(name: str) -> str:
    return "--" + name.removeprefix("laser_").replace("_", "-")


def _part(options: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Return the options whose names begin with a prefix, without it."""
    return {name.removeprefix(prefix): value for name, value in options.items() if name.startswith(prefix)}
