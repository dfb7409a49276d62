"""How much a scan from a place would settle: the expected drop of the summed entropies of cells, from draws of maps.

Each draw in turn is taken as the truth: a scan is simulated in it, the other draws are weighed by how well they explain
that scan, and what the weighted draws say of every cell is scored by the truth's own colour. In the mean over truths,
what this log score gains is at most the drop of the entropy, so that chance likenesses among few draws cost and do not
pay: no draw identifies itself, nor do its neighbours in its chain, which are half copies of it.

A scan shows many things that have nothing to do with each other, and no number of draws has all their combinations.
Hence cells are asked by the beams of their own direction as well as by the whole scan, and by tempered weights. Which
of these ways serves the cells of a direction is chosen on one half of the truths and scored on the other
(python -m benchmarks.explore).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.results.explore.scanner import Scanner

N_SECTORS = 36
BEAMS_A_SECTOR = 3
N_BEAMS = N_SECTORS * BEAMS_A_SECTOR
"""Of a whole turn, simulated."""
LOCAL_WAYS = ((0, 1.0), (1, 1.0), (1, 0.3))
"""Sectors on either side of a cell's own whose beams weigh draws for it, and the power of their likelihood."""
PATH_WAYS = (*LOCAL_WAYS, (4, 1.0), (4, 0.3))
"""The same for one question, for which every direction is tried."""
WHOLE_POWERS = (0.1, 1.0)
"""Of the likelihood of the whole scan."""
SPREAD = 0.2
"""Metres by which a wall may lie elsewhere in another draw and yet count as the same: a cell."""
PRIOR_DRAWS = 0.5
"""Draws of the unweighted share that are added to the weighted ones."""
BLOCK = 0.125
"""Share of its chain on either side of a truth that is left out with it."""
SILENT = np.float32(-1e9)
"""Log weight of a draw that has no say."""
LEAST_MISS = 1e-3
"""Share of walls that return nothing, at least: no single beam settles anything."""

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Jury(NamedTuple):
    """Draws that are asked, each in turn the truth: n, chain by chain in equal numbers; of c cells, or one answer."""

    black: Floats  # (n, c) 0 or 1
    silence: Floats  # (n, n) SILENT where the second may not speak when the first is the truth, else 0
    prior: Floats  # (n, c) probability of black by those others
    n_chains: int

    @property
    def first_half(self) -> Bools:
        """Which draws (n,) are of the first half of their chain."""
        n_draws = len(self.black) // self.n_chains
        return np.asarray(np.arange(len(self.black)) % n_draws < n_draws // 2)


def make_jury(black: Bools, n_chains: int) -> Jury:
    """Return draws to be asked, chain by chain in equal numbers; `black` (n, c): colours of the cells."""
    n, n_draws = len(black), len(black) // n_chains
    chain, step = np.divmod(np.arange(n), n_draws)
    apart = np.abs(step[:, None] - step) > int(BLOCK * n_draws)
    others = ((chain[:, None] != chain) | apart).astype(np.float32)
    colour = black.astype(np.float32)
    prior = (others @ colour + 0.5) / (others.sum(axis=1, keepdims=True) + 1.0)
    return Jury(colour, SILENT * (1.0 - others), prior, n_chains)


def sector_of(offset: NDArray[np.float64]) -> Ints:
    """Return the sector (n,) of directions (n, 2) from a place; sector s has its middle at s / N_SECTORS of a turn."""
    turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2.0 * math.pi)
    return np.asarray(np.rint(turn * N_SECTORS).astype(np.int64) % N_SECTORS)


def misfits(distance: Floats, scanner: Scanner, rng: np.random.Generator) -> Floats:
    """Return how badly each draw explains the beams of a sector of a scan in each draw, (N_SECTORS, n, n).

    In nats of log likelihood that it falls short of the best. `distance` (n, N_BEAMS): from the place to the first
    wall, metres; inf: none. The second axis is the truth, in which the scan is simulated, errors included.
    """
    met = np.isfinite(distance)
    near = np.where(met, distance, 0.0)
    noise = np.maximum(scanner.noise, scanner.noise_relative * near)
    kind = rng.random(distance.shape)
    odd = kind > 1.0 - scanner.outlier_probability
    silent = ~odd & (~met | (kind < scanner.miss_probability))
    reading = near + noise * rng.standard_normal(distance.shape)
    reading = np.where(odd, scanner.max_range * rng.random(distance.shape), reading)
    width = np.hypot(noise, SPREAD)
    hit = 1.0 - scanner.outlier_probability - scanner.miss_probability
    peak = hit * scanner.max_range / (math.sqrt(2.0 * math.pi) * width * scanner.outlier_probability)
    unseen = math.log(1.0 + hit / max(scanner.miss_probability, LEAST_MISS))
    worst = np.where(silent, unseen, np.log1p(peak))
    nothing = 10.0 * scanner.max_range  # as a distance: what is farther than any wall by more than all noise
    scale = 1.0 / (math.sqrt(2.0) * width)
    drawn = (scale * np.where(silent, nothing, reading)).astype(np.float32)
    seen, scale, worst = np.where(met, distance, nothing), scale.astype(np.float32), worst.astype(np.float32)
    found = np.zeros((N_SECTORS, len(distance), len(distance)), np.float32)
    for beam in range(N_BEAMS):
        off = scale[:, beam, None] * seen[:, beam] - drawn[:, beam, None]
        np.square(off, out=off)
        found[(beam + BEAMS_A_SECTOR // 2) // BEAMS_A_SECTOR % N_SECTORS] += np.minimum(off, worst[:, beam, None])
    # Beams that the sensor does not have say nothing: those simulated share what it has.
    found *= np.float32(min(1.0, scanner.beams_a_turn / N_BEAMS))
    return found


def log_gain(jury: Jury, misfit: Floats, power: float, cells: Ints | slice) -> Floats:
    """Return by how much draws so weighted raise the log probability of each truth's colours, (n, n_cells).

    `misfit` (n, n): of each draw, the second axis, with the scan of each truth.
    """
    weight = -power * misfit + jury.silence
    weight -= np.maximum(weight.max(axis=1, keepdims=True), SILENT)
    np.exp(weight, out=weight)
    total = np.maximum(weight.sum(axis=1, keepdims=True), np.float32(1e-30))
    size = total**2 / np.maximum(np.square(weight).sum(axis=1, keepdims=True), np.float32(1e-30))
    prior, black = jury.prior[:, cells], jury.black[:, cells]
    said = size * (weight @ black) / total + PRIOR_DRAWS * prior
    said /= size + PRIOR_DRAWS
    return np.asarray(np.log(np.where(black > 0.5, said / prior, (1.0 - said) / (1.0 - prior))))


def chosen(jury: Jury, ways: Floats) -> Floats:
    """Return the gain of each truth (n,) by the way that is best for the other half of truths, or by none: 0.

    `ways` (n_ways, n).
    """
    found = np.zeros(ways.shape[1], np.float32)
    for half in (jury.first_half, ~jury.first_half):
        if len(ways) and half.any() and not half.all():
            mean = ways[:, ~half].mean(axis=1)
            best = int(mean.argmax())
            found[half] = ways[best, half] if mean[best] > 0.0 else 0.0
    return found


def beside(misfit: Floats, sector: int, width: int) -> Floats:
    """Return the misfits (n, n) of a sector and so many on either side."""
    return np.asarray(misfit[np.arange(sector - width, sector + width + 1) % N_SECTORS].sum(axis=0))


def in_view(view: float) -> int:
    """Return how many sectors a field of view (radians) has."""
    return max(1, min(N_SECTORS, round(view / (2.0 * math.pi) * N_SECTORS)))


def best_view(gain: NDArray[np.floating], view: float) -> tuple[float, Ints]:
    """Return the heading (radians) from which a field of view has most of the gain by sector, and its sectors."""
    n = in_view(view)
    sums = [gain[np.arange(first, first + n) % N_SECTORS].sum() for first in range(N_SECTORS if n < N_SECTORS else 1)]
    first = int(np.argmax(sums))
    seen = np.arange(first, first + n) % N_SECTORS
    towards = int(gain.argmax()) if n == N_SECTORS else first + 0.5 * (n - 1)
    return float(math.remainder(2.0 * math.pi * towards / N_SECTORS, 2.0 * math.pi)), seen


def cells_gain(jury: Jury, misfit: Floats, sector: Ints, view: float) -> tuple[Floats, float]:
    """Return the gain of each truth (n,), nats, and the best heading, radians.

    `sector` (c,): of each cell, -1 out of reach. `view`: field of view, radians.
    """
    members = [np.flatnonzero(sector == number) for number in range(N_SECTORS)]
    local = np.zeros((N_SECTORS, len(LOCAL_WAYS), len(jury.black)), np.float32)
    for number in range(N_SECTORS):
        for way, (width, power) in enumerate(LOCAL_WAYS if len(members[number]) else ()):
            beams = beside(misfit, number, width)
            local[number, way] = log_gain(jury, beams, power, members[number]).sum(axis=1)
    heading, seen = best_view(np.maximum(local.mean(axis=2).max(axis=1), 0.0), view)
    scan = misfit[seen].sum(axis=0)
    whole = [log_gain(jury, scan, power, slice(None)) for power in WHOLE_POWERS]
    total = chosen(jury, np.array([gain[:, sector < 0].sum(axis=1) for gain in whole]))
    for number in range(N_SECTORS):
        ways = [gain[:, members[number]].sum(axis=1) for gain in whole]
        total += chosen(jury, np.array([*ways, *(local[number] if number in seen else ())]))
    return total, heading


def answer_gain(jury: Jury, misfit: Floats, view: float) -> tuple[Floats, float]:
    """Return the gain about one answer of each truth (n,), nats, and the best heading, radians."""
    ways = [(number, width, power) for number in range(N_SECTORS) for width, power in PATH_WAYS]
    gains = [log_gain(jury, beside(misfit, number, width), power, slice(None))[:, 0] for number, width, power in ways]
    local = np.array(gains).reshape(N_SECTORS, len(PATH_WAYS), len(jury.black))
    heading, seen = best_view(np.maximum(local.mean(axis=2).max(axis=1), 0.0), view)
    scan = misfit[seen].sum(axis=0)
    whole = [log_gain(jury, scan, power, slice(None))[:, 0] for power in WHOLE_POWERS]
    return chosen(jury, np.array([*whole, *local[seen].reshape(-1, len(scan))])), heading


def outcome_gain(black: Bools, outcome: NDArray[np.int8]) -> NDArray[np.float64]:
    """Return the information (c,) of a beam's outcome at each cell about its colour, nats, bias taken off.

    `black`, `outcome` (n, c): whether the beam stops before the cell (0), in it (1) or beyond (2). Cheap: no scan as a
    whole is weighed, so that places can be ranked by it.
    """
    counts = np.empty((2, 3, black.shape[1]))
    for kind in (0, 1):
        such = outcome == kind
        counts[1, kind] = (such & black).sum(axis=0, dtype=np.uint16)
        counts[0, kind] = such.sum(axis=0, dtype=np.uint16) - counts[1, kind]
    n_black = black.sum(axis=0, dtype=np.uint16).astype(np.float64)
    counts[1, 2] = n_black - counts[1, :2].sum(axis=0)
    counts[0, 2] = len(black) - n_black - counts[0, :2].sum(axis=0)
    share = counts / len(black)
    with np.errstate(divide="ignore", invalid="ignore"):
        term = share * np.log(share / (share.sum(axis=0) * share.sum(axis=1, keepdims=True)))
    return np.asarray(np.nansum(term, axis=(0, 1)) - 1.0 / len(black))
