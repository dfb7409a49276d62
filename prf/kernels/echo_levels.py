"""How loud an echo is: directivity, Fresnel zones, absorption, and the list in which a receiver collects echoes."""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels._jit import core
from prf.kernels.echo_scene import Ear

MOST_ZONES = 8.0
"""Fresnel integrals are tabulated up to this argument."""


class Acoustics(NamedTuple):
    """Constants of the sound and of the detector, lengths in metres.

    `wavelength`; `loss` nepers a metre of path; `level` amplitude at the detector of an on-axis echo after 1 m of
    path; `max_range` longest range listened to; `faint` amplitudes below this share of the threshold are dropped;
    `detour` amplitude of the beam below which two walls in turn are not followed; `edge_radius` rounding of edges;
    `directivity` amplitude by angle off the axis, from 0 to pi/2 in equal steps;
    `fresnel_re`, `fresnel_im` integrals of exp(i pi t^2 / 2) from 0 to -MOST_ZONES .. MOST_ZONES in equal steps;
    `bin` length of a bin of range; `gain` amplification in each bin, in units of the threshold.
    """

    wavelength: float
    loss: float
    level: float
    max_range: float
    faint: float
    detour: float
    edge_radius: float
    directivity: np.ndarray
    fresnel_re: np.ndarray
    fresnel_im: np.ndarray
    bin: float
    gain: np.ndarray


class Echoes(NamedTuple):
    """Echoes by receiver: `length` (r, most) of path to the first, complex amplitude, how many `n_heard`."""

    length: np.ndarray
    re: np.ndarray
    im: np.ndarray
    n_heard: np.ndarray


@core
def off_axis(sound: Acoustics, cosine: float) -> float:
    """Amplitude of the transducer in a direction of that cosine to its axis; none behind it."""
    if cosine <= 0.0:
        return 0.0
    position = math.acos(min(cosine, 1.0)) * (2.0 / math.pi) * (sound.directivity.size - 1)
    k = min(int(position), sound.directivity.size - 2)
    return sound.directivity[k] + (position - k) * (sound.directivity[k + 1] - sound.directivity[k])


@core
def toward(sound: Acoustics, ear: Ear, x: float, y: float) -> float:
    """Amplitude of the transducer in the direction of a point."""
    dx = x - ear.x
    dy = y - ear.y
    return off_axis(sound, (dx * ear.ux + dy * ear.uy) / math.sqrt(dx * dx + dy * dy))


@core
def fresnel_to(sound: Acoustics, v: float) -> tuple[float, float]:
    """Integrals of cos and sin of pi t^2 / 2 from 0 to v: tabulated, beyond the table by their asymptotic form."""
    if abs(v) >= MOST_ZONES:
        half = math.copysign(0.5, v)
        return half + math.sin(0.5 * math.pi * v * v) / (math.pi * v), half - math.cos(0.5 * math.pi * v * v) / (
            math.pi * v
        )
    at = 0.5 * (v / MOST_ZONES + 1.0) * (sound.fresnel_re.size - 1)
    k = min(int(at), sound.fresnel_re.size - 2)
    part = at - k
    re = sound.fresnel_re[k] + part * (sound.fresnel_re[k + 1] - sound.fresnel_re[k])
    return re, sound.fresnel_im[k] + part * (sound.fresnel_im[k + 1] - sound.fresnel_im[k])


@core
def zones(sound: Acoustics, first: float, last: float) -> tuple[float, float]:
    """Share of a wave that the Fresnel zones between two arguments carry: 1 for the whole line, complex.

    The integral of exp(i pi t^2 / 2) from `first` to `last` over 1 + i, that of the whole line.
    """
    re0, im0 = fresnel_to(sound, first)
    re1, im1 = fresnel_to(sound, last)
    re, im = re1 - re0, im1 - im0
    return 0.5 * (re + im), 0.5 * (im - re)


@core
def is_audible(sound: Acoustics, amplitude: float, length: float) -> bool:
    """Whether an echo of this amplitude, after a path of this length, is worth a place in the list."""
    if length >= 2.0 * sound.max_range:
        return False
    heard = amplitude * sound.level * math.exp(-sound.loss * length)
    return heard * sound.gain[int(0.5 * length / sound.bin)] >= sound.faint


@core
def collect(
    sound: Acoustics, echoes: Echoes, receiver: int, delay: float, arrival: float, length: float, re: float, im: float
) -> None:
    """List an echo: amplitude after spreading (re, im), absorbed and turned by the phase of `length`.

    `arrival` is the length of the path that comes first, `delay` what the emitter fired later, in metres.
    """
    k = echoes.n_heard[receiver]
    if k >= echoes.length.shape[1] or arrival + delay <= 0.0:
        return
    heard = sound.level * math.exp(-sound.loss * arrival)
    phase = -2.0 * math.pi * length / sound.wavelength
    c = heard * math.cos(phase)
    s = heard * math.sin(phase)
    echoes.length[receiver, k] = arrival + delay
    echoes.re[receiver, k] = c * re - s * im
    echoes.im[receiver, k] = c * im + s * re
    echoes.n_heard[receiver] = k + 1
