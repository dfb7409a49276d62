"""The same readings in another frame, another unit, another order; and what chains on them say, frame taken back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring
from prf.model.layout import image_grid, pixel_centres, read_coloring
from prf.model.window import Window
from prf.sampler.chain import ChainRun
from prf.sampler.target import Execution, Target, laser_data
from tests.reference.beams import Sensor
from tests.reference.worlds import draw_world

Floats = NDArray[np.float64]
SCALE = 0.1
ROOM = Window(0.0, 0.0, 16.0, 12.0)
PLACES = np.array([(x, y) for x in (2.25, 6.25, 9.75, 13.75) for y in (2.25, 5.75, 9.75)])
"""Metres: whose colours are watched, in the middle of pixels of half a metre."""


class Case(NamedTuple):
    """Settings, and how places of the first frame are found in theirs."""

    target: Target
    there: Callable[[Floats], Floats]
    unit: float = 1.0


def first() -> Case:
    """Return a room with 360 beams as it is."""
    data = draw_world(SCALE, ROOM, Sensor(12.0, 0.05), 6, 60, np.random.default_rng(5)).data
    return Case(Target(ROOM, SCALE, data, execution=Execution(resolution=0.5)), lambda xy: xy)


def moved(case: Case, there: Callable[[Floats], Floats], turned: Callable[[Floats], Floats], unit: float = 1.0) -> Case:
    """Return a case with places and directions moved; lengths are `unit` times as long."""
    target, data = case.target, case.target.laser
    assert data is not None
    assert target.execution.resolution is not None
    corners = there(np.array([target.window[:2], target.window[2:]]))
    window = Window(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    model = data.model.replace(max_range=unit * data.model.max_range, noise=unit * data.model.noise)
    laser = laser_data(there(data.readings.origin), turned(data.readings.angle), unit * data.readings.range, model)
    resolution = unit * target.execution.resolution
    return Case(
        replace(target, window=window, scale=SCALE / unit, laser=laser).with_execution(resolution=resolution),
        there,
        unit,
    )


def shifted(case: Case, x: float, y: float) -> Case:
    """Return a case at another place."""
    return moved(case, lambda xy: xy + np.array([x, y]), lambda angle: angle)


def turned(case: Case) -> Case:
    """Return a case turned by 90 degrees."""
    return moved(case, lambda xy: np.stack([-xy[:, 1], xy[:, 0]], axis=1), lambda angle: angle + 0.5 * np.pi)


def mirrored(case: Case) -> Case:
    """Return a case seen from below."""
    return moved(case, lambda xy: xy * np.array([1.0, -1.0]), lambda angle: -angle)


def scaled(case: Case, factor: float) -> Case:
    """Return a case with all lengths so many times as long, the prior's too."""
    return moved(case, lambda xy: factor * xy, lambda angle: angle, factor)


def reordered(case: Case, seed: int = 0) -> Case:
    """Return a case with its beams in another order."""
    data = case.target.laser
    assert data is not None
    order = np.random.default_rng(seed).permutation(len(data.readings.angle))
    laser = laser_data(data.readings.origin[order], data.readings.angle[order], data.readings.range[order], data.model)
    return case._replace(target=replace(case.target, laser=laser))


def maps_of(case: Case, n_blocks: int, seed: int = 1) -> list[tuple[Coloring, Floats]]:
    """Return the map of a chain and its sums at the end of every block."""
    chain = ChainRun(case.target, np.random.default_rng(seed), np.zeros(1, np.int64))
    found = []
    for _ in range(n_blocks):
        chain.advance()
        found.append((read_coloring(chain.chain.graph), chain.chain.graph.sums.copy()))
    return found


def means_of(case: Case, n_chains: int, n_steps: int) -> Floats:
    """Return for each chain the means of edges, of length in units of 1 / p, and of the colours at `PLACES`."""
    target = case.target
    assert target.execution.resolution is not None
    centres = pixel_centres(image_grid(target.window, target.execution.resolution))
    away = np.linalg.norm(centres[:, None, :] - case.there(PLACES)[None], axis=2)
    assert away.min(axis=0).max() < 1e-6 * case.unit
    found = []
    for seed in np.random.SeedSequence(7).spawn(n_chains):
        chain = ChainRun(target, np.random.default_rng(seed), away.argmin(axis=0))
        while chain.step < n_steps:
            chain.advance()
        draws = chain.record.since(n_steps // 2)
        edges, length = np.array([draw.functionals[:2] for draw in draws]).T
        black = np.array([draw.probe_black for draw in draws])
        found.append([edges.mean(), target.scale * length.mean(), *black.mean(axis=0)])
    return np.array(found)
