"""Displacements of scans that make their layers agree: a search over shifts, then robust least squares.

Layers are heights over planes, so all is point to plane: a motion (shift 3, turn 3) displaces a layer by the product
with its row of the Jacobian. What the cells themselves have as relief is common to all scans and drops out.
"""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part

BIN = 0.05
"""Metres: bins of heights in which layers of scans meet."""
TALLEST = 1.8
"""Metres off the plane up to which layers are entered."""
BESIDE = 0.6
"""What a layer counts that lies in the bin beside one of another scan."""
STEP, TURN, NEAR_STEPS = 0.1, 0.0175, 3
"""Metres between shifts that are tried, radians between turns; shifts to either side of the best that are turned."""
RISE = 3
"""Last entry of a motion that is searched, after shifts along two level axes and the turn about the vertical."""
SHOWS = 0.5
"""How far along its normal a layer is displaced by a metre of a shift, from which on it can show that shift."""
FINEST = 0.02
"""Metres at which the search ends."""
GOOD = 0.9
"""Share of a scan's layers that meet others where it lies, from which no shift is searched.

Ground and walls along a shift meet whether the scan is shifted or not: a few walls across it may be all that does not.
"""
GAIN, FIXED_GAIN = 0.08, 1.0
"""Of its layers, and in layers, that a shift must bring together more than none does."""
PRICE = 0.05
"""Of its layers that a shift by a metre, or a turn by ten steps, must bring more."""
MOST_SEARCHED = 200
"""Layers of a scan by which shifts are searched; of more every n-th."""
FEWEST = 5
"""Layers in cells that other scans see as well, below which a scan stays where it is."""
ROUNDS = 5
WIDEST = 0.2
"""Metres of residual that still count a quarter in the first round; halved from round to round."""


class Layers(NamedTuple):
    """Layers of all scans, and the heights at which those of the scans entered so far lie."""

    bins: Floats  # (cells, heights) worth of a layer that lies there
    cell: Ints  # (r,)
    along: Floats  # (r, 4) how shifts along the level axes, a turn about the third and a rise displace each
    height: Floats  # (r,) metres
    weight: Floats  # (r,)


@part
def dot4(along: Floats, x: Floats) -> float:
    """By how much a motion x (4) displaces a layer along its normal."""
    return along[0] * x[0] + along[1] * x[1] + along[2] * x[2] + along[RISE] * x[RISE]


@part
def show(along: Floats, rises: bool) -> bool:
    """Whether a layer shows rises, or level shifts."""
    return bool(abs(along[RISE]) >= SHOWS) if rises else bool(along[0] ** 2 + along[1] ** 2 >= SHOWS**2)


@part
def meeting(layers: Layers, rows: Ints, x: Floats) -> float:
    """Weight of the layers that meet those of other scans once the motion x (4) is taken away."""
    bins, cell, along, height, weight = layers
    total = 0.0
    for p in rows:
        moved = height[p] - dot4(along[p], x)
        at = int(np.floor((moved + TALLEST) / BIN))
        if 0 <= at < bins.shape[1]:
            total += weight[p] * bins[cell[p], at]
    return total


@part
def enter(layers: Layers, begin: int, end: int, x: Floats) -> None:
    """Enter the layers of a scan, its motion x (4) taken away."""
    bins, cell, along, height, _ = layers
    for p in range(begin, end):
        moved = height[p] - dot4(along[p], x)
        at = int(np.floor((moved + TALLEST) / BIN))
        for beside in range(-1, 2):
            if 0 <= at + beside < bins.shape[1]:
                worth = 1.0 if beside == 0 else BESIDE
                bins[cell[p], at + beside] = max(bins[cell[p], at + beside], worth)


@part
def best_motion(layers: Layers, rows: Ints, reach: float, start: Floats, first: int, last: int) -> Floats:
    """The motion (4) that brings most layers together, of which the entries from `first` to `last` are searched.

    Shifts are up to `reach` metres. The search begins where the scan lies, or at the motion `start` of another if that
    brings more together; all motions are tried where neither does well.
    """
    found = np.zeros(4)
    tried = found.copy()
    tried[first:last] = start[first:last]
    top, other = meeting(layers, rows, found), meeting(layers, rows, tried)
    if other > top:
        top = other
        found[:] = tried
    if top < GOOD * layers.weight[rows].sum():
        if first == RISE:
            search_rise(layers, rows, reach, found)
        else:
            search(layers, rows, reach, found)
        top = meeting(layers, rows, found)
    step = 0.5 * STEP
    while step > FINEST:
        climbed = False
        for axis in range(first, last):
            for sign in (-1.0, 1.0):
                tried[:] = found
                tried[axis] += sign * step * (0.1 if axis == 2 else 1.0)
                value = meeting(layers, rows, tried)
                if value > top + 1e-9:
                    top, climbed = value, True
                    found[:] = tried
        if not climbed:
            step *= 0.5
    return found


@part
def search_rise(layers: Layers, rows: Ints, reach: float, found: Floats) -> None:
    """Try all rises of up to `reach` metres; that of `found` (4) becomes the best if it is clear."""
    rows = rows[:: 1 + len(rows) // MOST_SEARCHED]
    before, possible = meeting(layers, rows, found), layers.weight[rows].sum()
    top, x, best = before, found.copy(), found[RISE]
    n_steps = int(reach / BIN)
    for k in range(-n_steps, n_steps + 1):
        x[RISE] = BIN * k
        value = meeting(layers, rows, x) - PRICE * possible * abs(x[RISE])
        if value > top:
            top, best = value, x[RISE]
    if top >= before + GAIN * possible + FIXED_GAIN:
        found[RISE] = best


@part
def search(layers: Layers, rows: Ints, reach: float, found: Floats) -> None:
    """Try all level shifts of up to `reach` metres, turned near the best; `found` (4) becomes that if it is clear."""
    rows = rows[:: 1 + len(rows) // MOST_SEARCHED]
    before = meeting(layers, rows, found)
    possible, n_steps = layers.weight[rows].sum(), reach / STEP
    top, x, best = before, found.copy(), found.copy()
    for turn in (0, 1, -1, 2, -2):
        about, width = best / STEP, int(n_steps) if turn == 0 else NEAR_STEPS
        for i in range(-width, width + 1):
            for j in range(-width, width + 1):
                one, other = about[0] + i, about[1] + j
                if turn == 0:
                    one, other = float(i), float(j)
                far = np.sqrt(one * one + other * other)
                if far > n_steps:
                    continue
                x[0], x[1], x[2] = STEP * one, STEP * other, TURN * turn
                price = PRICE * possible * (STEP * far + 0.1 * abs(turn))
                value = meeting(layers, rows, x) - price
                if value > top:
                    top = value
                    best[:] = x
    if top >= before + GAIN * possible + FIXED_GAIN:
        found[:] = best


@jit
def match_scans(
    cell: Ints,
    first: Ints,
    jacobian: Floats,
    height: Floats,
    weight: Floats,
    n_cells: int,
    axes: Floats,
    reach: float,
    rises: bool,
) -> Floats:
    """Motions (s, 6) of scans, each matched to those before: the scan with most layers first, then what shares most.

    Level shifts and turns about the vertical, by walls, or with `rises` shifts along it, by level surfaces.

    Of layers (r), scan after scan: their `cell`, rows of the `jacobian` (r, 6), `height` off the plane in metres, and
    `weight`, the share of the scan's points; ``first`` (s + 1,) is where each scan begins. `axes` (3, 3): two level
    directions and up. `reach`: longest shift that is tried, metres.
    """
    n_scans = len(first) - 1
    motion, last, shows = np.zeros((n_scans, 6)), np.zeros(4), np.zeros(len(cell), np.bool_)
    layers = Layers(np.zeros((n_cells, int(2.0 * TALLEST / BIN))), cell, np.empty((len(cell), 4)), height, weight)
    for p in range(len(cell)):
        for axis in range(3):
            part_of = jacobian[p, :3] if axis < 2 else jacobian[p, 3:]
            layers.along[p, axis] = (part_of * axes[axis]).sum()
        layers.along[p, RISE] = (jacobian[p, :3] * axes[2]).sum()
        shows[p] = show(layers.along[p], rises)
    begin, end = (RISE, RISE + 1) if rises else (0, RISE)
    seen, waiting = np.zeros(n_cells, np.bool_), np.ones(n_scans, np.bool_)
    shared = 1e-6 * (first[1:] - first[:-1])
    for _ in range(n_scans):
        chosen, x = np.argmax(np.where(waiting, shared, -1.0)), np.zeros(4)
        rows = np.arange(first[chosen], first[chosen + 1])
        common = rows[seen[cell[rows]] & shows[rows]]
        if len(common) >= FEWEST:
            last = best_motion(layers, common, reach, last, begin, end)
            x[:] = last
            motion[chosen, :3] = last[0] * axes[0] + last[1] * axes[1] + last[RISE] * axes[2]
            motion[chosen, 3:] = last[2] * axes[2]
        waiting[chosen] = False
        enter(layers, first[chosen], first[chosen + 1], x)
        is_new = np.zeros(n_cells, np.bool_)
        is_new[cell[rows]] = True
        is_new &= ~seen
        for s in np.flatnonzero(waiting):
            for p in range(first[s], first[s + 1]):
                if is_new[cell[p]]:
                    shared[s] += weight[p]
        seen |= is_new
    return motion


@part
def add_cell(
    scan: Ints, jacobian: Floats, height: Floats, weight: Floats, begin: int, end: int, left: Floats, right: Floats
) -> None:
    """Add the normal equations of one cell, whose relief is eliminated; to `left` what with its transpose adds up."""
    whole, mean = 0.0, 0.0
    for p in range(begin, end):
        whole += weight[p]
        mean += weight[p] * height[p]
    if end - begin < 2 or whole <= 0.0:
        return
    mean /= whole
    for p in range(begin, end):
        at = 6 * scan[p]
        for a in range(6):
            pull = weight[p] * jacobian[p, a]
            right[at + a] += pull * (height[p] - mean)
            own = 0.5 * pull * (1.0 - weight[p] / whole)
            for b in range(6):
                left[at + a, at + b] += own * jacobian[p, b]
            for q in range(p + 1, end):
                share = pull * weight[q] / whole
                for b in range(6):
                    left[at + a, 6 * scan[q] + b] -= share * jacobian[q, b]


@jit
def fit_motions(
    first: Ints,
    scan: Ints,
    jacobian: Floats,
    height: Floats,
    weight: Floats,
    n_scans: int,
    precision: Floats,
    finest: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Motions (s, 6) of least robust residuals, their normal matrix (6s, 6s), residuals (r,) and robust weights (r,).

    Geman and McClure's weights, whose scale shrinks from `WIDEST` to `finest` metres (graduated non-convexity: Yang and
    others 2020). Rows are sorted by cell, ``first`` (c + 1,) is where each begins; `height` in metres, `weight` its
    inverse variance; `precision` (6,) of the prior of each motion.
    """
    size = 6 * n_scans
    left, right = np.zeros((size, size)), np.zeros(size)
    robust, residual = np.ones(len(scan)), np.zeros(len(scan))
    motion, scale = np.zeros((n_scans, 6)), WIDEST
    for turn in range(ROUNDS):
        left[:], right[:] = 0.0, 0.0
        for k in range(size):
            left[k, k] = 0.5 * precision[k % 6]
        counted = weight * robust
        for c in range(len(first) - 1):
            add_cell(scan, jacobian, height, counted, first[c], first[c + 1], left, right)
        left += left.T.copy()
        motion[:] = np.linalg.solve(left, right).reshape((n_scans, 6))
        if turn > 0:
            scale = max(0.5 * scale, finest)
        for c in range(len(first) - 1):
            whole, mean = 0.0, 0.0
            for p in range(first[c], first[c + 1]):
                residual[p] = height[p] - (jacobian[p] * motion[scan[p]]).sum()
                whole += counted[p]
                mean += counted[p] * residual[p]
            for p in range(first[c], first[c + 1]):
                residual[p] -= mean / max(whole, 1e-300)
                robust[p] = (scale * scale / (scale * scale + residual[p] ** 2)) ** 2
    return motion, left, residual, robust
