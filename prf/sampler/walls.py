"""Maps of walls from settings: their prior, and what they do not have."""

from __future__ import annotations

from prf.configuration import Configuration, Prior
from prf.model.orientation import Orientation
from prf.model.walls import WallPrior
from prf.shell.errors import ConfigError


def orientation_of(known: Prior) -> Orientation:
    """Return what is known of the building's directions; of walls a strength of 0 stands for one that is sampled."""
    strength = "sampled" if known.is_walls and known.orientation == 0.0 else known.orientation
    return Orientation.of(strength, known.orientation_angle)


def wall_prior(known: Prior) -> WallPrior | None:
    """Return the prior of walls; None of polygons."""
    if not known.is_walls:
        return None
    return WallPrior(known.wall_density, known.wall_length, known.wall_thickness, known.free_end, known.crossing)


def refuse_with_walls(config: Configuration) -> None:
    """Refuse what maps of walls do not have."""
    if config.sampler.tiles or config.sampler.is_tempered:
        raise ConfigError("--prior walls: its chains have neither tiles nor temperatures. Leave these out.")
    if config.sampler.start == "prior":
        raise ConfigError("sampler.start prior: walls start empty or from a grid. Choose another start.")
