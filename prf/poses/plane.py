"""Poses of the plane (n, 3): x and y in metres, heading in radians counter-clockwise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def wrapped(angle: Floats) -> Floats:
    """Return angles in [-pi, pi)."""
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)


def compose(pose: Floats, local: Floats) -> Floats:
    """Return in the world what is given (n, 3) in the frames of poses (n, 3); headings are not wrapped."""
    cosine, sine = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = local[..., 0], local[..., 1]
    turned = (pose[..., 0] + cosine * x - sine * y, pose[..., 1] + sine * x + cosine * y)
    return np.stack([*turned, pose[..., 2] + local[..., 2]], axis=-1)


def seen_from(pose: Floats, world: Floats) -> Floats:
    """Return what is given (n, 3) in the world in the frames of poses (n, 3); headings in [-pi, pi)."""
    cosine, sine = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = world[..., 0] - pose[..., 0], world[..., 1] - pose[..., 1]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, wrapped(world[..., 2] - pose[..., 2])], axis=-1)


def in_words(metres: float, radians: float) -> str:
    """Return a length and an angle for a person, in centimetres below a metre, and degrees."""
    degrees = math.degrees(radians)
    return f"{length_in_words(metres)} and {degrees:.{2 if degrees < 99.5 else 3}g} degrees"


def length_in_words(metres: float) -> str:
    """Return a length for a person, in centimetres below a metre."""
    return f"{100.0 * metres:.2g} cm" if metres < 0.995 else f"{metres:.3g} m"
