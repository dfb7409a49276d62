"""Between which bounds parameters of sensors lie: beyond them doubles overflow, or a density has no logarithm."""

from __future__ import annotations

from prf.model.window import LARGEST_RANGE
from prf.shell.errors import ConfigError

MIN_LENGTH = 1e-9  # metres, far below what any sensor resolves
MAX_FACTOR = 1e6  # of log odds, of their slopes and of noise as a share of the distance
MIN_PROBABILITY = 1e-100


def check_length(name: str, value: float) -> None:
    """Raise ConfigError if parameter `name` is no length that a sensor may have."""
    if not MIN_LENGTH <= value <= LARGEST_RANGE:
        raise ConfigError(
            f"{name} {value}: must be a positive number of metres, from {MIN_LENGTH:g} to {LARGEST_RANGE:g}"
        )


def check_factor(name: str, value: float, least: float = -MAX_FACTOR) -> None:
    """Raise ConfigError if parameter `name` is not within `least` and `MAX_FACTOR`."""
    if not least <= value <= MAX_FACTOR:
        raise ConfigError(f"{name} {value}: must be a number from {least:g} to {MAX_FACTOR:g}")
