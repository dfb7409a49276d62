"""A ring of sonars by acoustics: pulses, beams, echoes by mirrors, corners, edges and rough walls, and a threshold.

Made to judge maps that the likelihood of :mod:`prf.sensors.sonar` led to, it shares neither code nor form with it
(docs/sonar-simulator.md).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import fresnel

from prf.kernels.echo_levels import MOST_ZONES, Acoustics, Echoes
from prf.kernels.echo_receiver import Listening
from prf.kernels.echo_ring import Effects, Nearby, Ring, sense_ring
from prf.kernels.echo_scene import EchoScene
from prf.logs.rings import PIONEER
from prf.shell.errors import InputError
from prf.simulate.reflectors import make_echo_scene
from prf.simulate.sonar_physics import SonarPhysics

Floats = NDArray[np.float64]

BIN = 0.005
"""Metres of range between samples of the received signal: a third of what the resonant circuit needs to swing up."""
FAINT = 0.1
"""Share of the threshold below which an echo is not followed: ten such in phase would make one reading."""
MOST_ECHOES = 2048
"""Echoes of one reading; later ones are dropped. Offices make some dozens."""
MIRROR_LEVEL = 10.0 ** (-30.0 / 20.0)
"""Walls in directions in which the beam is weaker than this (-30 dB, one way) send nothing on a detour."""
CHUNK = 50
"""Poses between two reports of progress: about a third of a second in an office."""
N_DIRECTIONS = 1801
"""Entries of the table of the beam: steps of a twentieth of a degree."""
N_ZONES = 4001
"""Entries of the table of Fresnel integrals, from which interpolation is right to 1e-5."""


def simulate_sonar(
    walls: Floats,
    poses: Floats,
    physics: SonarPhysics,
    rng: np.random.Generator,
    ring: Floats = PIONEER,
    advance: Callable[[int], object] | None = None,
) -> Floats:
    """Return what a ring of sonars reads at each pose, (m, r) metres, inf: no return.

    Parameters
    ----------
    walls : (n, 4) array
        Ends x1 y1 x2 y2 in metres, free space on the left; in any order, straight ones in any number of pieces.
    poses : (m, 3) array
        Robot's x and y in metres and heading in radians, in free space.
    physics : SonarPhysics
    rng : Generator
    ring : (r, 3) array
        Place (metres) and axis (radians) of each transducer on the robot; by default the 16 of a Pioneer.
    advance : callable, optional
        Called now and then with the number of poses done since the last call.

    Raises
    ------
    InputError
        If an array has another shape or holds values that are no numbers.
    """
    return _sense(walls, poses, physics, rng, ring, advance)[0]


def trace_echoes(
    walls: Floats, pose: Floats, physics: SonarPhysics, rng: np.random.Generator, ring: Floats = PIONEER
) -> list[Floats]:
    """Return the echoes that each transducer receives at one pose, before noise and threshold.

    Parameters
    ----------
    walls, physics, rng, ring
        As for :func:`simulate_sonar`; those of a group fire at the same time.
    pose : (3,) array
        Robot's x and y in metres and heading in radians.

    Returns
    -------
    list of (n, 2) arrays
        For each transducer the range (half the path, metres) and the level (decibels over the threshold at the
        gain with which listening begins; add :meth:`SonarPhysics.gain_db`) of every echo, nearest first.
    """
    at_once = dataclasses.replace(physics, firing_spread=0.0)
    echoes = _sense(walls, np.asarray(pose, dtype=np.float64)[None], at_once, rng, ring, None)[1]
    heard = []
    for r, n in enumerate(echoes.n_heard):
        size = np.hypot(echoes.re[r, :n], echoes.im[r, :n])
        order = np.argsort(echoes.length[r, :n], kind="stable")
        heard.append(np.stack([0.5 * echoes.length[r, :n], 20.0 * np.log10(size)], axis=1)[order])
    return heard


def _sense(
    walls: Floats,
    poses: Floats,
    physics: SonarPhysics,
    rng: np.random.Generator,
    ring: Floats,
    advance: Callable[[int], object] | None,
) -> tuple[Floats, Echoes]:
    """Return the readings at all poses, and the echoes at the last."""
    poses, ring = _rows_of_3("poses", poses), _rows_of_3("ring", ring)
    scene, sound, effects = _scene(walls, poses, ring, physics, rng), _acoustics(physics), _effects(physics)
    around, listening = _ring(ring, physics), _listening(physics)
    near, echoes = _nearby(scene, len(ring)), _echoes(len(ring))
    ranges = np.full((len(poses), len(ring)), np.inf)
    for first in range(0, len(poses), CHUNK):
        part = slice(first, first + CHUNK)
        sense_ring(scene, sound, effects, around, listening, near, echoes, poses[part], rng, ranges[part])
        if advance is not None:
            advance(len(poses[part]))
    return ranges, echoes


def _rows_of_3(name: str, rows: Floats) -> Floats:
    """Return (n, 3) finite numbers."""
    rows = np.ascontiguousarray(rows, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
        raise InputError(f"{name}: expected finite numbers of shape (n, 3), got {rows.shape}")
    return rows


def _scene(walls: Floats, poses: Floats, ring: Floats, physics: SonarPhysics, rng: np.random.Generator) -> EchoScene:
    """Return the reflectors round the robot."""
    size = np.abs(ring[:, :2]).sum(axis=1).max(initial=0.0)
    places = np.concatenate([poses[:, :2] - size, poses[:, :2] + size])
    return make_echo_scene(walls, places, physics, rng)


def _acoustics(physics: SonarPhysics) -> Acoustics:
    """Return the constants of the paths, with tables of directivity, Fresnel integrals and gain."""
    sine, cosine = fresnel(np.linspace(-MOST_ZONES, MOST_ZONES, N_ZONES))
    bins = int(physics.max_range / BIN) + 2
    return Acoustics(
        wavelength=physics.wavelength,
        loss=physics.absorption_db * math.log(10.0) / 20.0,
        level=10.0 ** (physics.level_db / 20.0),
        max_range=physics.max_range,
        faint=FAINT,
        detour=MIRROR_LEVEL,
        edge_radius=physics.edge_radius,
        directivity=physics.directivity(np.linspace(0.0, 0.5 * np.pi, N_DIRECTIONS)),
        fresnel_re=np.ascontiguousarray(cosine),
        fresnel_im=np.ascontiguousarray(sine),
        bin=BIN,
        gain=10.0 ** (physics.gain_db((np.arange(bins) + 1) * BIN) / 20.0),
    )


def _effects(physics: SonarPhysics) -> Effects:
    """Return which ways of the sound there are."""
    return Effects(physics.walls, physics.corners, physics.edges, physics.rough, physics.detours)


def _ring(ring: Floats, physics: SonarPhysics) -> Ring:
    """Return the transducers with their groups: those a whole number of groups apart fire together."""
    n_groups = max(len(ring) // physics.fired_together, 1)
    angle = np.linspace(0.0, 0.5 * np.pi, N_DIRECTIONS)
    heard = physics.directivity(angle) > MIRROR_LEVEL
    return Ring(
        place=ring,
        group=np.arange(len(ring)) % n_groups,
        firing=np.zeros(len(ring)),
        spread=physics.firing_spread * physics.sound_speed,
        cross_talk=physics.cross_talk,
        beam=float(angle[heard][-1]),
    )


def _listening(physics: SonarPhysics) -> Listening:
    """Return the constants of the receivers, times as metres of range."""
    last_gain = physics.gain_step_db * physics.n_gain_steps
    half_speed = 0.5 * physics.sound_speed
    return Listening(
        pulse=physics.pulse * half_speed,
        keep=math.exp(-BIN / (physics.swing * half_speed)),
        noise=10.0 ** (-(last_gain + physics.noise_db) / 20.0) if physics.noise else 0.0,
        blanking=physics.blanking,
        flutter=physics.flutter_db * math.log(10.0) / 20.0 if physics.noise else 0.0,
        stretch=physics.stretch if physics.noise else 0.0,
        burst=physics.burst_probability if physics.noise else 0.0,
        quantum=physics.quantum,
        scale=physics.assumed_sound_speed / physics.sound_speed,
        drive=np.zeros((int(physics.max_range / BIN) + 2, 2)),
    )


def _nearby(scene: EchoScene, n_transducers: int) -> Nearby:
    """Return scratch for what lies within earshot."""
    n_walls = len(scene.length)
    walls, corners, patches = (np.zeros(n, np.int64) for n in (n_walls, len(scene.turn), len(scene.patch_wall)))
    mirrors = np.zeros((n_transducers, n_walls), np.int64)
    return Nearby(walls, corners, patches, mirrors, np.zeros(3, np.int64), np.zeros(n_transducers, np.int64))


def _echoes(n_receivers: int) -> Echoes:
    """Return empty lists of echoes."""
    shape = (n_receivers, MOST_ECHOES)
    return Echoes(np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(n_receivers, np.int64))
