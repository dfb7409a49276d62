"""How many tiles, and how many steps between two partitions: of the readings and the window alone."""

from __future__ import annotations

import math

from prf.posterior import Settings
from prf.sampler.record import FIRST_THIN
from prf.window import Window

LEAST_SIDE = 60.0
"""Metres: windows that are not longer have no tiles unless these are asked for."""
LEAST_READINGS = 10_000
"""Likewise with fewer readings: chains side by side use the threads as well, and better."""
TILE_SIDE = 40.0
"""Metres: about the side of a tile, if the readings lay evenly."""
MOST_TILES = 32
NARROWEST = 0.35
"""Least width of a tile, as a share of the side of a square tile."""
STEPS_PER_READING = 4
"""Steps of a round: to begin and to end it costs time in proportion to the readings."""
ROUND_LENGTHS = (64 * FIRST_THIN, 1024 * FIRST_THIN)
"""Steps of the shortest and of the longest round; a longer one would keep Ctrl-C and the clock waiting."""
LOOK_STEPS = 4 * FIRST_THIN
"""Steps between two looks at the tiles of a round, where draws are recorded: each costs some milliseconds."""
PLAIN_SHARE = 1.0 / 64.0
"""Share of a round's steps that the chain makes on the whole window, where nothing stays because of a border.

They cannot be shared out, and each takes longer: memory for all readings does not fit a processor's caches.
"""


def chosen_tiles(window: Window, n_readings: int) -> int:
    """Return the number of tiles that is used unless one is given; 0: none."""
    if max(window.width, window.height) <= LEAST_SIDE or n_readings < LEAST_READINGS:
        return 0
    return min(MOST_TILES, max(4, round(window.area / TILE_SIDE**2)))


def narrowest(window: Window, n_tiles: int) -> float:
    """Return the least width of a tile, metres."""
    return NARROWEST * math.sqrt(window.area / n_tiles)


def looks_of(length: int) -> int:
    """Return the number of looks in a round of `length` steps."""
    return max(1, length // LOOK_STEPS)


def round_length(settings: Settings) -> int:
    """Return the steps of a round: `FIRST_THIN` times a power of two, so that epochs and draws fall on its end."""
    readings = (settings.laser, settings.sonar)
    wanted = STEPS_PER_READING * sum(len(sensor.readings) for sensor in readings if sensor is not None)
    length, longest = ROUND_LENGTHS
    while length < min(wanted, longest):
        length *= 2
    return length
