"""Constants of a sonar ring and of the surfaces round it, and what follows from them without a world."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import j1

from prf.sensors.domain import LARGEST_FACTOR
from prf.shell.errors import ConfigError

Floats = NDArray[np.float64]

FIRST_ZERO = 3.8317059702075125
"""Of J1 after 0."""
LONGEST_RANGE = 1000.0
"""Metres. Sound in air that any transducer hears again has come from far nearer."""
BEAM_HEIGHT = 0.16
"""Height of a rough wall that the beam lights both ways, as a share of the distance: 9 degrees."""


@dataclasses.dataclass(frozen=True)
class SonarPhysics:
    """Constants of the sound, the transducers, the world's surfaces and the receivers, and which effects there are.

    The defaults are those of the Polaroid transducers of a Pioneer robot indoors. Levels in decibels are of
    amplitudes, 20 log10.

    Parameters
    ----------
    frequency : float
        Of the pulse, hertz.
    aperture : float
        Radius of the piston that makes the beam, metres.
    pulse : float
        Duration of the pulse, seconds.
    swing : float
        Time constant of the receiver's resonant circuit, seconds: a weak echo crosses the threshold late.
    sound_speed, assumed_sound_speed : float
        Metres a second in the air, and in the robot's conversion of times to ranges.
    absorption_db : float
        Of the air, decibels a metre of path.
    level_db : float
        Amplitude of the echo of a perfect mirror after 1 m of path on the axis, decibels over the threshold at
        the gain with which listening begins.
    gain_step_db, gain_step, n_gain_steps : float, float, int
        The gain grows by so many decibels each so many metres of range, so many times.
    noise_db : float
        Standard deviation of either component of the noise at the last gain, decibels below the threshold.
    blanking, max_range : float
        Metres of range between which a reading can lie; without a crossing it is "no return".
    mirror : float
        Share of the amplitude that a smooth wall reflects.
    rough_share : float
        Share of the walls that are rough.
    rough_loss_db : float
        What roughness takes from the mirror reflection, decibels.
    backscatter : float
        Share of the power that a rough wall scatters in all directions (Lambert).
    edge_radius : float
        Rounding of edges, metres.
    flutter_db : float
        Standard deviation of the level of a reading by moving air and by aim, decibels.
    stretch : float
        Standard deviation of a reading as a share of it, by the temperature of the air on the way.
    quantum : float
        Step of the readings, metres.
    fired_together : int
        Transducers that fire at the same time, evenly spread round the ring: 2 is one in front, one behind.
    firing_spread : float
        Longest delay between those, seconds.
    burst_probability : float
        Of a reading from noise that is none of the robot's, at any range.
    walls, corners, edges, rough, detours, side_lobes, cross_talk, noise : bool
        Whether there are: mirror reflections from walls, from corners of the room, echoes of edges, of rough walls,
        paths by two or more walls, side lobes of the beam, hearing of transducers that fire together, noise.
    """

    frequency: float = 49.4e3
    aperture: float = 0.018
    pulse: float = 0.324e-3
    swing: float = 0.1e-3
    sound_speed: float = 343.0
    assumed_sound_speed: float = 343.0
    absorption_db: float = 1.6
    level_db: float = 36.0
    gain_step_db: float = 3.5
    gain_step: float = 0.45
    n_gain_steps: int = 12
    noise_db: float = 15.0
    blanking: float = 0.15
    max_range: float = 8.0
    mirror: float = 0.95
    rough_share: float = 0.15
    rough_loss_db: float = 6.0
    backscatter: float = 0.1
    edge_radius: float = 0.005
    flutter_db: float = 1.5
    stretch: float = 0.002
    quantum: float = 0.001
    fired_together: int = 2
    firing_spread: float = 0.002
    burst_probability: float = 0.002
    walls: bool = True
    corners: bool = True
    edges: bool = True
    rough: bool = True
    detours: bool = True
    side_lobes: bool = True
    cross_talk: bool = True
    noise: bool = True

    def __post_init__(self) -> None:
        """Refuse constants that no device has."""
        positive = ("frequency", "aperture", "pulse", "swing", "sound_speed", "assumed_sound_speed", "gain_step",
                    "max_range", "quantum", "edge_radius")  # fmt: skip
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not abs(value) <= LARGEST_FACTOR:
                raise ConfigError(f"sonar {field.name} {value}: must be a number, at most {LARGEST_FACTOR:g}")
            if field.name in positive and value <= 0.0:
                raise ConfigError(f"sonar {field.name} {value}: must be positive")
            if field.name != "level_db" and value < 0.0:
                raise ConfigError(f"sonar {field.name} {value}: must not be negative")
        if self.max_range > LONGEST_RANGE:
            raise ConfigError(f"sonar-max-range {self.max_range}: in air at most {LONGEST_RANGE:g} m")
        for name in ("mirror", "rough_share", "backscatter", "burst_probability"):
            if getattr(self, name) > 1.0:
                raise ConfigError(f"sonar {name} {getattr(self, name)}: is a share, at most 1")
        if self.blanking >= self.max_range:
            raise ConfigError(f"sonar blanking {self.blanking}: must be less than the maximum range {self.max_range}")
        if self.fired_together < 1:
            raise ConfigError(f"sonar fired_together {self.fired_together}: must be at least 1")

    @property
    def wavelength(self) -> float:
        """Metres."""
        return self.sound_speed / self.frequency

    def directivity(self, angle: ArrayLike) -> Floats:
        """Return the amplitude of a transducer `angle` radians off its axis, by that on the axis.

        2 J1(x) / x with x = k a sin(angle), the far field of a piston in a baffle, without what lies beyond its first
        zero if there are no side lobes.
        """
        x = 2.0 * np.pi / self.wavelength * self.aperture * np.sin(np.abs(np.asarray(angle, dtype=np.float64)))
        lobes = np.where(x > 1e-9, 2.0 * j1(x) / np.maximum(x, 1e-9), 1.0)
        if not self.side_lobes:
            lobes = np.where(x < FIRST_ZERO, lobes, 0.0)
        return np.abs(lobes)

    def gain_db(self, distance: ArrayLike) -> Floats:
        """Return the gain for echoes from `distance` metres, decibels over that with which listening begins."""
        steps = np.floor(np.asarray(distance, dtype=np.float64) / self.gain_step)
        return self.gain_step_db * np.minimum(steps, self.n_gain_steps)

    @property
    def rough_mirror(self) -> float:
        """Share of the amplitude that a rough wall reflects as a mirror."""
        return self.mirror * math.pow(10.0, -self.rough_loss_db / 20.0)

    @property
    def patch_gain(self) -> float:
        """Amplitude that a rough wall 1 m wide scatters, 1 m away and face on; 1: of a mirror after a path of 1 m."""
        return math.sqrt(self.backscatter * BEAM_HEIGHT / math.pi)
