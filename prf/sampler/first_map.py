"""Where a chain on many readings starts: the map that a chain on a share of them has come to.

Most of what the readings say, few of them say as well. A step costs in proportion to the readings that it touches, so
that the way from the empty map to walls and doors is several times shorter in time on a quarter of them. What comes of
it is but a place to start from: no step of it is a step of the chain that is sampled.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np

from prf.coloring import Coloring
from prf.kernels import constants as c
from prf.kernels.build import recompute_sums
from prf.layout import make_sites, read_coloring, run_chain
from prf.posterior import LaserData, PointData, Settings, SonarData, make_chain, one_colour_map, white_places

FEWEST = 4000
"""Readings that a share must have at least."""
STRIDE = 4
"""A share has every fourth reading of the next larger one."""
LOOK = 100_000
"""Steps between two looks at the log posterior."""
LEAST_GAIN = 0.004
"""Nats a reading, from one look to the next: where the gain is less, the next share takes over."""
MOST_LOOKS = 40
"""Looks at one share at most."""
Data = TypeVar("Data", LaserData, SonarData, PointData)

ORDER = 20050726
"""Seed of the order in which readings are dealt out: the same for all chains."""


def shares(settings: Settings) -> Iterator[Settings]:
    """Yield settings with ever larger shares of readings and points, short of all; none where readings are few."""
    n = sum(len(sensor.readings) for sensor in (settings.laser, settings.sonar) if sensor is not None)
    stride = 1
    while n // (stride * STRIDE) >= FEWEST:
        stride *= STRIDE
    while stride > 1:
        yield dataclasses.replace(
            settings,
            resolution=None,
            laser=_dealt(settings.laser, stride),
            sonar=_dealt(settings.sonar, stride),
            points=_dealt(settings.points, stride),
        )
        stride //= STRIDE


def has_shares(settings: Settings) -> bool:
    """Return whether there are so many readings that a chain begins on a share of them."""
    return next(shares(settings), None) is not None


def find_first_map(settings: Settings, rng: np.random.Generator, stop_requested: Callable[[], bool]) -> Coloring:
    """Return where a chain starts: the empty map, or what chains on growing shares of the readings come to."""
    coloring = one_colour_map(settings)
    for share in shares(settings):
        if stop_requested():
            break
        coloring = _climb(share, settings, coloring, rng, stop_requested)
    return coloring


def _climb(
    share: Settings,
    settings: Settings,
    coloring: Coloring,
    rng: np.random.Generator,
    stop_requested: Callable[[], bool],
) -> Coloring:
    """Run a chain on a share until its log posterior hardly rises; every sensor of the whole stays in white."""
    chain = make_chain(share, coloring)
    chain = chain._replace(sensors=make_sites(chain.edge_index.grid, white_places(settings)))
    least = LEAST_GAIN * (len(chain.beams.ray) + len(chain.cones.pose))
    best = -np.inf
    for look in range(1, MOST_LOOKS + 1):
        chain = run_chain(chain, rng, look * LOOK)
        recompute_sums(chain)
        now = chain.graph.sums[c.LOG_PRIOR] + chain.graph.sums[c.LOG_LIKELIHOOD]
        if now < best + least or stop_requested():
            break
        best = now
    return read_coloring(chain.graph)


def _dealt(data: Data | None, stride: int) -> Data | None:
    """Return every `stride`-th row of data in an order of their own: thinned evenly, no ray of a ring preferred."""
    if data is None:
        return None
    values: dict[str, Any] = {field.name: getattr(data, field.name) for field in dataclasses.fields(data)}
    arrays: dict[str, Any] = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    n = len(next(iter(arrays.values())))
    chosen = np.sort(np.random.default_rng(ORDER).permutation(n)[::stride])
    return dataclasses.replace(data, **{name: array[chosen] for name, array in arrays.items()})
