"""Second layers over patches, and the one small motion that explains those of a neighbourhood."""

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part
from mapq.kernels.planes import Planes, dot_from
from mapq.kernels.sheets import Sheets
from mapq.kernels.voxels import EMPTY, Nearby, cell_over, voxels_about

DOUBT = 0.3
"""Share of the weight about a patch that counts as moved and not covered, whatever a motion moves."""
CLEARLY = 1e-6
"""Support by which a longer motion must be better than a shorter one: less is rounding."""


@part
def sort_over(
    near: Nearby, sheets: Sheets, planes: Planes, i: int, step: float, places: Ints, first: Ints, found: Ints, out: Ints
) -> None:
    """Write the cells of the points over patch i, slice after slice; where each slice begins to `first` (slices + 1,).

    Slices are `step` thick, half of them on either side of the plane. `found` has room for two numbers a point.
    """
    n, n_slices = 0, len(first) - 1
    first[:] = 0
    for place in places:
        for k in range(near.first[place], near.first[place + 1]):
            if near.patch[k] == i:
                continue
            slice_ = int(np.floor(dot_from(planes.normal[i], near.points[k], planes.centre[i]) / step)) + n_slices // 2
            if slice_ < 0 or slice_ >= n_slices:
                continue
            u = dot_from(planes.across[i], near.points[k], planes.centre[i])
            cell = cell_over(sheets, i, u, dot_from(planes.along[i], near.points[k], planes.centre[i]))
            if cell != EMPTY:
                found[2 * n], found[2 * n + 1] = slice_, cell
                first[slice_ + 1] += 1
                n += 1
    for slice_ in range(n_slices):
        first[slice_ + 1] += first[slice_]
    at = first[:-1].copy()
    for k in range(n):
        out[at[found[2 * k]]] = found[2 * k + 1]
        at[found[2 * k]] += 1


@jit
def layers_over(
    near: Nearby, sheets: Sheets, planes: Planes, points: Floats, start: Ints, step: float, n_slices: int
) -> tuple[Floats, Floats, Floats]:
    """Return cover and number of points (m, n_slices - 1 each) of layers over patches, and their occupied cells (m,).

    A layer is two slices, each `step` metres thick; n_slices is even, and half of them lie on either side of the plane.
    Cover is the share of a patch's occupied cells in which the layer has points, of other patches or of none.
    """
    n_patches = len(start) - 1
    cover, count = np.zeros((n_patches, n_slices - 1)), np.zeros((n_patches, n_slices - 1))
    n_cells = np.zeros(n_patches)
    marks, places = np.full(len(near.key), EMPTY, np.int64), np.zeros(len(near.key), np.int64)
    found, cells = np.zeros(2 * len(near.points), np.int64), np.zeros(len(near.points), np.int64)
    first, seen = np.zeros(n_slices + 1, np.int64), np.zeros(0, np.int64)
    for i in range(n_patches):
        n_places = voxels_about(near, points, start[i], start[i + 1], i, marks, places)
        sort_over(near, sheets, planes, i, step, places[:n_places], first, found, cells)
        size = sheets.base[i + 1] - sheets.base[i]
        if size > len(seen):
            seen = np.zeros(2 * size, np.int64)
        seen[:size] = -2
        for cell in range(sheets.base[i], sheets.base[i + 1]):
            n_cells[i] += sheets.first[cell + 1] > sheets.first[cell]
        for slice_ in range(n_slices):
            for k in range(first[slice_], first[slice_ + 1]):
                last = seen[cells[k]]
                seen[cells[k]] = slice_
                # New to the layer that begins here, and to the one that ends here unless the slice before had it.
                if last != slice_ and slice_ < n_slices - 1:
                    cover[i, slice_] += 1.0
                if last < slice_ - 1 and slice_ > 0:
                    cover[i, slice_ - 1] += 1.0
        for layer in range(n_slices - 1):
            count[i, layer] = first[layer + 2] - first[layer]
            cover[i, layer] /= max(n_cells[i], 1.0)
    return cover, count, n_cells


@jit
def self_shifts(
    profile: Floats, step: float, motion: Floats, flat: Floats, weight: Floats, begin: Ints, other: Ints, least: float
) -> Floats:
    """Return how well one horizontal motion explains the layers about each patch (m, 3).

    Columns: support of the best motion, its length, and how far it moves along the patch's normal, in metres; nan where
    no patch about is upright. Of the weight of what it moves along its normal, support is the covered share, with
    `DOUBT` of all as what is moved and not covered: few patches that it moves are little evidence.

    `profile` (m, n): how much of a patch is covered at each distance from its plane, a `step` apart from 0. `motion`
    (k, 2): along the normal of the patch in question, and across; the shortest first. `flat` (m, 2): horizontal
    normals. `weight` (m,): of patches as witnesses, 0 for those that are not upright. Neighbours of patch i, itself
    among them, are ``other[begin[i]:begin[i + 1]]``. `least`: metres from which a motion parts a surface from its copy.
    """
    out = np.full((len(weight), 3), np.nan)
    explained, moved = np.zeros(len(motion)), np.zeros(len(motion))
    for i in range(len(weight)):
        explained[:], moved[:], total = 0.0, 0.0, 0.0
        for place in range(begin[i], begin[i + 1]):
            j = other[place]
            if weight[j] == 0.0:
                continue
            total += weight[j]
            ahead = flat[i, 0] * flat[j, 0] + flat[i, 1] * flat[j, 1]
            aside = flat[i, 0] * flat[j, 1] - flat[i, 1] * flat[j, 0]
            for t in range(len(motion)):
                along = abs(ahead * motion[t, 0] + aside * motion[t, 1])
                if along >= least:
                    moved[t] += weight[j]
                    explained[t] += weight[j] * profile[j, min(int(along / step + 0.5), profile.shape[1] - 1)]
        if total == 0.0:
            continue
        support = explained / (moved + DOUBT * total)
        best = 0
        for t in range(1, len(motion)):
            if support[t] > support[best] + CLEARLY:
                best = t
        out[i, 0] = support[best]
        out[i, 1] = np.sqrt(motion[best, 0] ** 2 + motion[best, 1] ** 2)
        out[i, 2] = abs(motion[best, 0])
    return out
