"""The directions of the building, drawn given the map.

Given the map, strength K and angle a of the law of directions have the density

    prior(K, a) exp(sum_e log m(theta_e) - sum_e (lambda(theta_e) - 2 p) |e|) / Z(K, a)

(:mod:`prf.model.orientation`), in which readings have no part. With a cost of black this is the joint law as well: the
normalised law of map, K and a, times the tilt. K and a are then not distributed by their prior before any reading.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.model.layout import read_coloring
from prf.model.orientation import (
    MEAN_STRENGTH,
    RIGHT_ANGLE,
    Orientation,
    crossing_rate,
    log_normaliser,
)
from prf.model.sensors import MOST_ORIENTATION
from prf.model.walls import SPREAD, WallPrior, thickness_density, walls_of
from prf.model.window import Window

TURNS = 3
"""Proposals of each at a time, which is after every turn of a chain: so many take a twentieth of its time."""
ANYWHERE = 0.2
"""Share of them that is drawn from the prior."""
DECADES = (-3.0, 0.5)
"""Of the steps of the others (angles in radians), whose scale is drawn for each."""
THICKNESS_DECADES = (-3.5, -1.5)
"""Of the steps of a common value of the thickness, m."""
Floats = NDArray[np.float64]


class Alignment:
    """Directions and lengths of the edges of a map, and how probable strength and angle are for it."""

    def __init__(self, chain: Chain) -> None:
        graph = chain.graph
        xy = graph.edge_xy[graph.members[c.EDGES, : graph.counts[c.EDGES]]]
        step = (xy[:, 2] - xy[:, 0]) + 1j * (xy[:, 3] - xy[:, 1])
        self.length = np.abs(step)
        self.fourfold = (step / self.length) ** 4
        self.scale, self.window = float(chain.density[c.SCALE]), Window(*graph.window.tolist())

    def log_density(self, strength: float, angle: float) -> float:
        """Return the log of the density of the map, up to what does not depend on strength and angle."""
        aligned = (self.fourfold * np.exp(-4j * angle)).real
        log_measure = strength * aligned.sum() - len(aligned) * (math.log(ive(0, strength)) + strength)
        crossed = float((crossing_rate(strength, aligned, self.scale) - 2.0 * self.scale) @ self.length)
        return float(log_measure) - crossed - log_normaliser(strength, angle, self.scale, self.window)


def redraw_directions(chain: Chain, orientation: Orientation, rng: np.random.Generator) -> None:
    """Draw what is sampled of the law of directions by some Metropolis steps.

    With an inverse temperature above 1 the density is raised to it, as in :mod:`prf.sampler.anneal`.
    """
    if not orientation.is_sampled:
        return
    edges = Alignment(chain)

    def log_target(strength: float, angle: float) -> float:
        prior = -strength / MEAN_STRENGTH if orientation.strength is None else 0.0
        return edges.log_density(strength, angle) + prior

    strength, angle, gained = drawn(chain, orientation, log_target, rng)
    chain.lines[:] = orientation.lines(strength, angle, edges.scale, edges.window)
    chain.graph.sums[c.LOG_PRIOR] += gained


def drawn(
    chain: Chain, orientation: Orientation, log_target: Callable[[float, float], float], rng: np.random.Generator
) -> tuple[float, float, float]:
    """Return strength and angle after some Metropolis steps, and the change of the log of their density."""
    beta = float(chain.density[c.INVERSE_TEMPERATURE])
    strength, angle = float(chain.lines[c.ORIENTATION]), float(chain.lines[c.ANGLE])
    first = now = log_target(strength, angle)
    for turn in range(2 * TURNS):
        new_strength, new_angle, log_back = strength, angle, 0.0
        step, is_anywhere = 10.0 ** rng.uniform(*DECADES) * rng.standard_normal(), rng.random() < ANYWHERE
        if turn % 2 == 0 and orientation.angle is None:
            new_angle = (RIGHT_ANGLE * rng.random() if is_anywhere else angle + step) % RIGHT_ANGLE
        elif turn % 2 == 1 and orientation.strength is None:
            new_strength = orientation.draw(rng)[0] if is_anywhere else abs(strength + step)
            log_back = (new_strength - strength) / MEAN_STRENGTH if is_anywhere else 0.0
        if new_strength <= MOST_ORIENTATION:
            new = log_target(new_strength, new_angle)
            if math.log(1.0 - rng.random()) < beta * (new - now) + log_back:
                strength, angle, now = new_strength, new_angle, new
    return strength, angle, now - first


def redraw_wall_laws(chain: Chain, prior: WallPrior, orientation: Orientation, rng: np.random.Generator) -> None:
    """Draw what is sampled of the directions of walls, and the common values of their thickness.

    Given the walls, a direction has the density m(theta) and a thickness its mixture, each times the prior of what it
    depends on: interactions do not. The common values are stepped one by one.
    """
    walls, beta = walls_of(read_coloring(chain.graph)), float(chain.density[c.INVERSE_TEMPERATURE])
    step = (walls[:, 2] - walls[:, 0]) + 1j * (walls[:, 3] - walls[:, 1])
    fourfold = (step / np.abs(step)) ** 4

    def log_target(strength: float, angle: float) -> float:
        known = -strength / MEAN_STRENGTH if orientation.strength is None else 0.0
        aligned = strength * float((fourfold * np.exp(-4j * angle)).real.sum())
        return known + aligned - len(walls) * (math.log(ive(0, strength)) + strength)

    def log_common(common: Floats) -> float:
        known = prior.log_common(common)
        return known if known == -math.inf else known + float(np.log(thickness_density(walls[:, 4], common)).sum())

    strength, angle = float(chain.lines[c.ORIENTATION]), float(chain.lines[c.ANGLE])
    gained = 0.0
    if orientation.is_sampled:
        strength, angle, gained = drawn(chain, orientation, log_target, rng)
    common = chain.lines[c.N_LINES :].copy()
    first = now = log_common(common)
    for turn in range(TURNS * len(common)):
        k, log_back = turn % len(common), 0.0
        trial = common.copy()
        if rng.random() < ANYWHERE:
            trial[k] = prior.thickness * math.exp(SPREAD * rng.standard_normal())
            log_back = prior.log_common(common[[k]]) - prior.log_common(trial[[k]])
        else:
            trial[k] += 10.0 ** rng.uniform(*THICKNESS_DECADES) * rng.standard_normal()
        new = log_common(trial)
        if new > -math.inf and math.log(1.0 - rng.random()) < beta * (new - now) + log_back:
            common, now = trial, new
    chain.lines[:] = prior.lines(orientation, strength, angle, common)
    chain.graph.sums[c.LOG_PRIOR] += gained + now - first
