"""Between which bounds parameters of sensors lie: beyond them doubles overflow, or a density has no logarithm."""

from __future__ import annotations

from prf.shell.errors import ConfigError
from prf.window import LARGEST_RANGE

LEAST_LENGTH = 1e-9
"""Metres, far below what any sensor resolves."""
LARGEST_FACTOR = 1e6
"""Of log odds, of their slopes and of noise as a share of the distance."""
LEAST_PROBABILITY = 1e-100


def check_length(name: str, value: float) -> None:
    """Raise ConfigError if parameter `name` is no length that a sensor may have."""
    if not LEAST_LENGTH <= value <= LARGEST_RANGE:
        raise ConfigError(
            f"{name} {value}: must be a positive number of metres, from {LEAST_LENGTH:g} to {LARGEST_RANGE:g}"
        )


def check_factor(name: str, value: float, least: float = -LARGEST_FACTOR) -> None:
    """Raise ConfigError if parameter `name` is not within `least` and `LARGEST_FACTOR`."""
    if not least <= value <= LARGEST_FACTOR:
        raise ConfigError(f"{name} {value}: must be a number from {least:g} to {LARGEST_FACTOR:g}")
