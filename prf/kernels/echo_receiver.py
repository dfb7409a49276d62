"""A receiver: a resonant circuit, an amplifier whose gain grows with time, noise, and a threshold."""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels._jit import core
from prf.kernels.echo_levels import Acoustics, Echoes


class Listening(NamedTuple):
    """Constants of a receiver, lengths in metres of range (half a path).

    `pulse` length; `keep` what is left of the circuit's swing after a bin; `noise` standard deviation of each
    component of the noise, in the unit of the echoes; `blanking` what is not listened to; `flutter` and `stretch`
    standard deviations of the logarithm of all amplitudes and of all lengths of a reading; `burst` probability of a
    burst of noise;
    `quantum` step of the readings; `scale` read range over true range.
    `drive` (bins + 2, 2) is scratch.
    """

    pulse: float
    keep: float
    noise: float
    blanking: float
    flutter: float
    stretch: float
    burst: float
    quantum: float
    scale: float
    drive: np.ndarray


@core
def drive_circuit(
    sound: Acoustics, listening: Listening, echoes: Echoes, receiver: int, loud: float, long: float
) -> None:
    """Write how the sum of all echoes, each a pulse of constant amplitude, changes from bin to bin."""
    drive = listening.drive
    drive[:] = 0.0
    last = drive.shape[0] - 2
    for k in range(echoes.n_heard[receiver]):
        start = 0.5 * echoes.length[receiver, k] * long / sound.bin
        for sign in (1.0, -1.0):
            b = int(start)
            if b <= last:
                part = start - b
                re = sign * loud * echoes.re[receiver, k]
                im = sign * loud * echoes.im[receiver, k]
                drive[b, 0] += (1.0 - part) * re
                drive[b, 1] += (1.0 - part) * im
                drive[b + 1, 0] += part * re
                drive[b + 1, 1] += part * im
            start += listening.pulse / sound.bin


@core
def first_crossing(sound: Acoustics, listening: Listening, n_bins: int, rng: np.random.Generator) -> float:
    """Range at which the amplified swing first reaches the threshold, inf if it never does.

    All bins draw their noise, so that readings draw alike many numbers whatever they hear.
    """
    drive = listening.drive
    keep = listening.keep
    kick = listening.noise * math.sqrt(1.0 - keep * keep)
    fx = fy = sx = sy = nx = ny = level = 0.0
    found = math.inf
    for b in range(n_bins):
        fx += drive[b, 0]
        fy += drive[b, 1]
        sx += (1.0 - keep) * (fx - sx)
        sy += (1.0 - keep) * (fy - sy)
        nx = keep * nx + kick * rng.standard_normal()
        ny = keep * ny + kick * rng.standard_normal()
        before = level
        level = sound.gain[b] * math.hypot(sx + nx, sy + ny)
        if level >= 1.0 and found == math.inf and (b + 1) * sound.bin >= listening.blanking:
            share = (1.0 - before) / (level - before) if before < 1.0 else 0.0
            found = max((b + share) * sound.bin, listening.blanking)
    return found


@core
def listen(sound: Acoustics, listening: Listening, echoes: Echoes, receiver: int, rng: np.random.Generator) -> float:
    """Reading of one receiver in metres, inf if nothing crosses the threshold within the window."""
    loud = math.exp(listening.flutter * rng.standard_normal())
    long = 1.0 + listening.stretch * rng.standard_normal()
    burst = rng.random() < listening.burst
    burst_at = listening.blanking + (sound.max_range - listening.blanking) * rng.random()
    drive_circuit(sound, listening, echoes, receiver, loud, long)
    found = first_crossing(sound, listening, int(sound.max_range / sound.bin), rng)
    if burst and burst_at < found:
        found = burst_at
    if found >= sound.max_range:
        return math.inf
    return listening.quantum * math.floor(listening.scale * found / listening.quantum + 0.5)
