"""The one small motion that explains the second layers of a neighbourhood."""

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part
from mapq.kernels.order_statistics import quantile

DOUBT = 0.3
"""Share of the weight about a patch that counts as moved and not covered, whatever a motion moves."""
DIRECTIONS = 60
"""In which surfaces face, in a half turn: within one, the longest motion differs by less than layers are thick."""
CLEARLY = 1e-6
"""Support by which a longer motion must be better than a shorter one: less is rounding."""
ALIKE = 0.94
"""Cosine between the normals of surfaces from which they face alike, and may be two sides of one thing."""


@part
def bearing(flat: Floats, place: Floats, i: int, j: int) -> tuple[float, float, float]:
    """Return the normal of surface j as surface i sees it, ahead and aside, and metres that j moves in a turn about i.

    The last along the normal of j, for each radian; `flat` (t, 2) and `place` (t, 2) as `self_shifts` has them.
    """
    ahead = flat[i, 0] * flat[j, 0] + flat[i, 1] * flat[j, 1]
    aside = flat[i, 0] * flat[j, 1] - flat[i, 1] * flat[j, 0]
    lever = flat[j, 1] * (place[j, 0] - place[i, 0]) - flat[j, 0] * (place[j, 1] - place[i, 1])
    return ahead, aside, lever


@part
def add_layers(total: Floats, layers: Floats, weight: float, shift: int, flip: bool) -> None:
    """Add the layers (n,) of a surface, weighted, to a total (n,) over which a shift puts them; flipped, last first."""
    n = max(len(total) - abs(shift), 0)
    above, below = max(shift, 0), max(-shift, 0)
    if flip:
        into, from_ = total[above : above + n], layers[above : above + n]
        for k in range(n):
            into[k] += weight * from_[np.uint64(n - 1 - k)]
    else:
        into, from_ = total[below : below + n], layers[above : above + n]
        for k in range(n):
            into[k] += weight * from_[k]


@part
def gather_directions(
    profile: Floats,
    row: Ints,
    step: float,
    turn: Floats,
    flat: Floats,
    place: Floats,
    weight: Floats,
    i: int,
    others: Ints,
    counts: Floats,
    found: Floats,
    used: Ints,
) -> int:
    """Add up the profiles of surfaces that face alike, weighted; how many directions there are.

    `found` (`DIRECTIONS`, 2, r, n): of directions from that of surface i on, a half turn in all, what would be a copy
    and what would be moved where a turn about surface i and a distance put it. `used`: the directions.
    """
    n_used = 0
    for j in others:
        ahead, aside, lever = bearing(flat, place, i, j)
        at = int(np.floor(np.arctan2(aside, ahead) / np.pi * DIRECTIONS + 0.5))
        # What faces the other way is moved by as much to the other side.
        flip = at < 0 or at >= DIRECTIONS
        at = (at + DIRECTIONS) % DIRECTIONS
        is_new = True
        for k in range(n_used):
            is_new &= used[k] != at
        if is_new:
            used[n_used] = at
            n_used += 1
            found[at] = 0.0
        for r in range(len(turn)):
            shift = int(np.floor(turn[r] * lever / step + 0.5))
            add_layers(found[at, 0, r], profile[min(row[j] + r, row[j + 1] - 1)], weight[j], shift, flip)
            add_layers(found[at, 1, r], counts, weight[j], shift, flip)
    return n_used


@part
def layer_at(along: float, step: float, n_layers: int) -> int:
    """Layer at a distance along the normal, or the last one; 0 is in the middle."""
    return int(min(max(along / step + n_layers // 2 + 0.5, 0.0), n_layers - 1.0))


@part
def layers_of_motions(motion: Floats, step: float, n_layers: int) -> Ints:
    """Layer (`DIRECTIONS`, k) at which each motion puts what faces in each direction."""
    layer = np.zeros((DIRECTIONS, len(motion)), np.int64)
    for at in range(DIRECTIONS):
        ahead, aside = np.cos(at * np.pi / DIRECTIONS), np.sin(at * np.pi / DIRECTIONS)
        for k in range(len(motion)):
            layer[at, k] = layer_at(ahead * motion[k, 0] + aside * motion[k, 1], step, n_layers)
    return layer


@part
def weigh_motions(found: Floats, used: Ints, layer: Ints, explained: Floats, moved: Floats) -> None:
    """Write what of `found` (see `gather_directions`) each turn and motion makes a copy, and what it moves.

    `layer`: see `layers_of_motions`.
    """
    n_motions = layer.shape[1]
    explained[:], moved[:] = 0.0, 0.0
    for at in used:
        for r in range(found.shape[2]):
            copy, all_, first = found[at, 0, r], found[at, 1, r], r * n_motions
            for k in range(n_motions):
                explained[first + k] += copy[layer[at, k]]
                moved[first + k] += all_[layer[at, k]]


@part
def support_of_others(
    profile: Floats,
    row: Ints,
    step: float,
    turn: Floats,
    motion: Floats,
    best: int,
    flat: Floats,
    place: Floats,
    weight: Floats,
    i: int,
    others: Ints,
    counts: Floats,
    sides: float,
) -> float:
    """Support (see `self_shifts`) of a turn and motion by surfaces that cannot be the other side of surface i; or nan.

    Surfaces that face alike and lie at most `sides` metres off its plane can, and any that go on in it.
    """
    n_layers, r, k = profile.shape[1], best // len(motion), best % len(motion)
    explained, moved, total = 0.0, 0.0, 0.0
    for j in others:
        ahead, aside, lever = bearing(flat, place, i, j)
        off = flat[i, 0] * (place[j, 0] - place[i, 0]) + flat[i, 1] * (place[j, 1] - place[i, 1])
        if abs(ahead) > ALIKE and abs(off) < sides:
            continue
        shift = int(np.floor(turn[r] * lever / step + 0.5))
        source = layer_at(ahead * motion[k, 0] + aside * motion[k, 1], step, n_layers) + shift
        total += weight[j]
        if 0 <= source < n_layers:
            explained += weight[j] * profile[min(row[j] + r, row[j + 1] - 1), source]
            moved += weight[j] * counts[source]
    return explained / (moved + DOUBT * total) if total > 0.0 else np.nan


@jit
def self_shifts(
    profile: Floats,
    row: Ints,
    step: float,
    motion: Floats,
    turn: Floats,
    flat: Floats,
    place: Floats,
    weight: Floats,
    begin: Ints,
    other: Ints,
    least: float,
    sides: float,
) -> Floats:
    """Return how well one motion explains the layers about each surface (t, 6).

    Columns: support of the best motion; by how much it is above that of the median motion; its support by surfaces
    that are no second side of this one; how much of a copy this surface has where the motion puts it; how far the
    motion moves along the surface's normal, and its length, in metres. Of the weight of what a motion moves along its
    normal, support is the share that is a copy, with `DOUBT` of all as what is moved and no copy: few surfaces that it
    moves are little evidence.

    `profile` (rows, n): how much a surface has of a copy at each distance along its normal; n is odd, distances are a
    `step` apart, 0 in the middle. `row` (t + 1,): of its first, for each turn or for all alike. `motion` (k, 2): along
    the normal of the surface in question, and across; the shortest first. `turn` (r,): radians about its place, 0
    first. `flat` (t, 2): normals in the plane of the motions; `place` (t, 2): there. `weight` (t,): of surfaces as
    witnesses. Neighbours of surface i, itself among them, are ``other[begin[i]:begin[i + 1]]``. `least`: metres from
    which a motion parts a surface from its copy; `sides`: up to which two sides of one thing are apart.
    """
    out = np.zeros((len(weight), 6))
    n_motions, n_layers, middle = len(motion), profile.shape[1], profile.shape[1] // 2
    explained, moved, support = np.zeros((3, len(turn) * n_motions))
    found, used = np.zeros((DIRECTIONS, 2, len(turn), n_layers)), np.zeros(DIRECTIONS, np.int64)
    # What lies farther off than the last layer but one is not known.
    counts = np.zeros(n_layers)
    for layer in range(1, n_layers - 1):
        counts[layer] = abs(layer - middle) * step >= least
    profile, layer_of = profile * counts, layers_of_motions(motion, step, n_layers)
    for i in range(len(weight)):
        others = other[begin[i] : begin[i + 1]]
        n_used = gather_directions(profile, row, step, turn, flat, place, weight, i, others, counts, found, used)
        total = weight[others].sum()
        weigh_motions(found, used[:n_used], layer_of, explained, moved)
        best = 0
        for t in range(len(support)):
            support[t] = explained[t] / (moved[t] + DOUBT * total)
            if support[t] > support[best] + CLEARLY:
                best = t
        given = profile, row, step, turn, motion, best, flat, place, weight
        out[i, 0] = support[best]
        out[i, 1] = out[i, 0] - quantile(support, len(support), 0.5)
        out[i, 2] = support_of_others(*given, i, others, counts, sides)
        along = motion[best % n_motions, 0]
        layer = layer_at(along, step, n_layers)
        out[i, 3], out[i, 4] = profile[min(row[i] + best // n_motions, row[i + 1] - 1), layer], abs(along)
        out[i, 5] = np.sqrt(motion[best % n_motions, 0] ** 2 + motion[best % n_motions, 1] ** 2)
    return out
