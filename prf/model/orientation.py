"""The directions of a building: lines of the Arak process that prefer two directions at right angles.

Lines come with the measure p m(theta) dtheta drho, m(theta) = exp(K cos 4(theta - a)) / I0(K) with mean 1. Then

- the density of a map has a factor m for each edge, and exp(-lambda(theta) |e|) in the place of exp(-2 p |e|), where
  lambda(phi) = p int m(theta) |sin(theta - phi)| = 2 p (1 - 2 sum_n r_n cos(4 n (phi - a)) / (16 n^2 - 1)),
  r_n = I_n(K) / I0(K);
- a segment of direction phi is crossed by Poisson(lambda(phi)) edges a metre;
- edges of direction theta have the length p m(theta) an area and radian;
- in a window W x H, log Z = log 2 + pi p^2 W H (1 - 2 sum_n r_n^2 / (16 n^2 - 1)) + W lambda(0) + H lambda(pi/2).

K = 0 is the plain process. Source: Arak & Surgailis 1989 for a general measure of lines; the series is ours.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from prf.kernels import constants as c
from prf.model.sensors import MOST_ORIENTATION
from prf.model.window import Window

Floats = NDArray[np.float64]

MEAN_STRENGTH = 2.0
"""Of the exponential prior of a strength K that is sampled."""
RIGHT_ANGLE = 0.5 * math.pi
N_DIRECTIONS, SHARPNESS = 3600, 100.0
"""Of :func:`wall_direction`: steps of a fortieth of a degree, and K of the window."""
_HARMONICS = np.arange(1, c.N_TERMS + 1)
_WEIGHTS = 2.0 / (16.0 * _HARMONICS**2 - 1.0)


@dataclasses.dataclass(frozen=True)
class Orientation:
    """What is known of a building's directions.

    `strength`: K from 0, where no direction is preferred; None: sampled, its prior exponential with mean 2 up to 10.
    `angle`: one of the two directions, radians; None: sampled, its prior uniform over a right angle.
    """

    strength: float | None = 0.0
    angle: float | None = None

    @classmethod
    def of(cls, strength: float | str, angle: float | str) -> Orientation:
        """Return the orientation of settings, in which a word stands for what is sampled."""
        return cls(None if isinstance(strength, str) else strength, None if isinstance(angle, str) else angle)

    @property
    def is_plain(self) -> bool:
        """Whether no direction is preferred."""
        return self.strength == 0.0

    @property
    def is_sampled(self) -> bool:
        """Whether there is anything to sample."""
        return not self.is_plain and (self.strength is None or self.angle is None)

    def draw(self, rng: np.random.Generator) -> tuple[float, float]:
        """Return strength and angle from their prior; what is given takes no random number."""
        strength, angle = self.strength, self.angle
        if strength is None:
            strength = -MEAN_STRENGTH * math.log1p(-rng.random() * -math.expm1(-MOST_ORIENTATION / MEAN_STRENGTH))
        if angle is None:
            angle = 0.0 if self.is_plain else RIGHT_ANGLE * rng.random()
        return strength, angle

    def lines(self, strength: float, angle: float, scale: float, window: Window) -> Floats:
        """Return the law of directions as the kernels read it; the prior of a strength that is sampled is in it."""
        lines = line_law(strength, angle, scale, window)
        if self.strength is None:
            lines[c.LOG_NORMALISER] += strength / MEAN_STRENGTH
        return lines

    def mean_factors(self) -> tuple[float, float]:
        """Return how often edges cross the border, and lines each other, beside the plain process: prior means."""
        strength, angle = self.strength, self.angle
        strengths = np.array([strength]) if strength is not None else (np.arange(1000) + 0.5) * MOST_ORIENTATION / 1000
        weights = np.exp(-strengths / MEAN_STRENGTH)
        crossed = [1.0 if angle is None else float(crossing_rate(k, math.cos(4.0 * angle), 0.5)) for k in strengths]
        paired = [pair_factor(k) for k in strengths]
        return float(np.average(crossed, weights=weights)), float(np.average(paired, weights=weights))


PLAIN = Orientation()


def unwrapped(angle: Floats) -> Floats:
    """Return angles (n,) up to right angles such that none is further than half a right angle from their mean."""
    mean = np.angle(np.exp(4j * angle).mean()) / 4.0 % RIGHT_ANGLE
    found: Floats = mean + (angle - mean + 0.5 * RIGHT_ANGLE) % RIGHT_ANGLE - 0.5 * RIGHT_ANGLE
    return found


def wall_direction(step: Floats, owner: NDArray[np.int64], n_maps: int) -> Floats:
    """Return the direction (n_maps,) in which most metres of each map's edges run, radians up to a right angle.

    It is the mode of the directions, by length, seen through a window of some three degrees: edges in all directions do
    not turn it. `step` (n, 2): from end to end of each edge, metres; `owner` (n,): its map.
    """
    bins = (np.arctan2(step[:, 1], step[:, 0]) % RIGHT_ANGLE / RIGHT_ANGLE * N_DIRECTIONS).astype(int) % N_DIRECTIONS
    metres = np.zeros((n_maps, N_DIRECTIONS))
    np.add.at(metres, (owner, bins), np.hypot(*step.T))
    kernel = np.exp(SHARPNESS * (np.cos(4.0 * RIGHT_ANGLE * np.arange(N_DIRECTIONS) / N_DIRECTIONS) - 1.0))
    smooth = np.fft.irfft(np.fft.rfft(metres, axis=1) * np.fft.rfft(kernel), N_DIRECTIONS, axis=1)
    found: Floats = (smooth.argmax(axis=1) + 0.5) * RIGHT_ANGLE / N_DIRECTIONS
    return found


def line_law(strength: float, angle: float, scale: float, window: Window) -> Floats:
    """Return what the kernels read (``prf.kernels.constants``, ``Chain.lines``)."""
    lines = np.zeros(c.N_LINES)
    ratios = harmonics(strength)
    lines[c.ORIENTATION], lines[c.ANGLE] = strength, angle
    lines[c.COS_ANGLE], lines[c.SIN_ANGLE] = math.cos(4.0 * angle), math.sin(4.0 * angle)
    lines[c.LOG_MEAN] = math.log(ive(0, strength)) + strength
    lines[c.LOG_NORMALISER] = log_normaliser(strength, angle, scale, window)
    lines[c.FIRST_TERM :] = _WEIGHTS * ratios
    return lines


def harmonics(strength: float) -> Floats:
    """Return r_n = I_n(K) / I0(K), (N_TERMS,)."""
    ratios: Floats = ive(_HARMONICS, strength) / ive(0, strength)
    return ratios


def crossing_rate(strength: float, aligned: Any, scale: float) -> Any:
    """Return lambda, edges a metre that cross a line with cos 4(phi - a) = `aligned`."""
    terms = np.concatenate([[1.0], -_WEIGHTS * harmonics(strength)])
    return 2.0 * scale * np.polynomial.chebyshev.chebval(aligned, terms)


def pair_factor(strength: float) -> float:
    """Return 1 - 2 sum_n r_n^2 / (16 n^2 - 1): how often lines cross each other, beside all directions alike."""
    return float(1.0 - _WEIGHTS @ harmonics(strength) ** 2)


def log_normaliser(strength: float, angle: float, scale: float, window: Window) -> float:
    """Return log Z(K, a) less that of K = 0, in this window."""
    crossed = float(crossing_rate(strength, math.cos(4.0 * angle), scale)) - 2.0 * scale
    inside = math.pi * scale**2 * window.area * (pair_factor(strength) - 1.0)
    return inside + (window.width + window.height) * crossed
