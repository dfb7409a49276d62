"""Second layers over patches, and the one small motion that explains those of a neighbourhood."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part
from mapq.kernels.planes import Planes, chart
from mapq.kernels.sheets import Sheets
from mapq.kernels.voxels import EMPTY, Nearby, cell_over, voxels_about

DOUBT = 0.3
"""Share of the weight about a patch that counts as moved and not covered, whatever a motion moves."""
CLEARLY = 1e-6
"""Support by which a longer motion must be better than a shorter one: less is rounding."""
RIM = 3
"""Cells round the occupied ones of a patch, and in its holes, in which the copy of it has no points."""


@part
def is_rim(sheets: Sheets, i: int, column: int, row: int) -> bool:
    """Whether a place of the raster of patch i, which is not occupied, has an occupied cell near."""
    for r in range(max(row - RIM, 0), min(row + RIM + 1, sheets.size[i, 1])):
        for c in range(max(column - RIM, 0), min(column + RIM + 1, sheets.size[i, 0])):
            at = sheets.base[i] + r * sheets.size[i, 0] + c
            if sheets.first[at + 1] > sheets.first[at]:
                return True
    return False


@part
def measure_raster(sheets: Sheets, i: int) -> tuple[int, int]:
    """Occupied cells of patch i, and those of its rim."""
    n_cells, n_rim = 0, 0
    for cell in range(sheets.base[i], sheets.base[i + 1]):
        n_cells += sheets.first[cell + 1] > sheets.first[cell]
    for row in range(-RIM, sheets.size[i, 1] + RIM):
        for column in range(-RIM, sheets.size[i, 0] + RIM):
            n_rim += is_rim(sheets, i, column, row)
    return n_cells, n_rim - n_cells


@part
def sort_over(
    near: Nearby,
    sheets: Sheets,
    planes: Planes,
    i: int,
    step: float,
    places: Ints,
    first: Ints,
    found: Ints,
    out: Ints,
    rim: Floats,
) -> None:
    """Write the cells of the points over patch i, slice after slice; where each slice begins to `first` (slices + 1,).

    Slices are `step` thick, half of them on either side of the plane. `found` has room for two numbers a point. `rim`
    (slices,): points over the rim.
    """
    n, n_slices = 0, len(first) - 1
    first[:], rim[:] = 0, 0.0
    for place in places:
        for k in range(near.first[place], near.first[place + 1]):
            if near.patch[k] == i:
                continue
            u, v, height = chart(planes, i, near.points[k])
            slice_ = int(np.floor(height / step)) + n_slices // 2
            if slice_ < 0 or slice_ >= n_slices:
                continue
            cell = cell_over(sheets, i, u, v)
            if cell != EMPTY:
                found[2 * n], found[2 * n + 1] = slice_, cell
                first[slice_ + 1] += 1
                n += 1
            else:
                column = int(np.floor((u - sheets.low[i, 0]) / sheets.cell[i]))
                rim[slice_] += is_rim(sheets, i, column, int(np.floor((v - sheets.low[i, 1]) / sheets.cell[i])))
    for slice_ in range(n_slices):
        first[slice_ + 1] += first[slice_]
    at = first[:-1].copy()
    for k in range(n):
        out[at[found[2 * k]]] = found[2 * k + 1]
        at[found[2 * k]] += 1


class LayersOver(NamedTuple):
    """Layers over patches (m, layers), from behind to before each."""

    cover: Floats  # share of the patch's occupied cells in which the layer has points
    n_points: Floats  # its points over these
    rim: Floats  # and over the rim
    n_cells: Floats  # (m,) occupied cells
    n_rim: Floats  # (m,) and those of the rim


@jit
def layers_over(
    near: Nearby, sheets: Sheets, planes: Planes, points: Floats, start: Ints, step: float, n_slices: int
) -> LayersOver:
    """Return the layers over patches, of points of other patches or of none.

    A layer is two slices, each `step` metres thick; n_slices is even, and half of them lie on either side of the plane.
    """
    n_patches = len(start) - 1
    cover, count = np.zeros((n_patches, n_slices - 1)), np.zeros((n_patches, n_slices - 1))
    rim, of_slice = np.zeros((n_patches, n_slices - 1)), np.zeros(n_slices)
    n_cells, n_rim = np.zeros(n_patches), np.zeros(n_patches)
    marks, places = np.full(len(near.key), EMPTY, np.int64), np.zeros(len(near.key), np.int64)
    found, cells = np.zeros(2 * len(near.points), np.int64), np.zeros(len(near.points), np.int64)
    first, seen = np.zeros(n_slices + 1, np.int64), np.zeros(0, np.int64)
    for i in range(n_patches):
        n_places = voxels_about(near, points, start[i], start[i + 1], i, marks, places)
        sort_over(near, sheets, planes, i, step, places[:n_places], first, found, cells, of_slice)
        n_cells[i], n_rim[i] = measure_raster(sheets, i)
        size = sheets.base[i + 1] - sheets.base[i]
        if size > len(seen):
            seen = np.zeros(2 * size, np.int64)
        seen[:size] = -2
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
            rim[i, layer] = of_slice[layer] + of_slice[layer + 1]
            cover[i, layer] /= max(n_cells[i], 1.0)
    return LayersOver(cover, count, rim, n_cells, n_rim)


@jit
def self_shifts(
    profile: Floats, step: float, motion: Floats, flat: Floats, weight: Floats, begin: Ints, other: Ints, least: float
) -> Floats:
    """Return how well one motion explains the layers about each patch (m, 6).

    Columns: support of the best motion, its length, and how far it moves along the patch's normal, in metres; its
    support by the other patches alone; by how much its support is above that of the median motion; and how much of a
    copy this patch has where the motion puts it. All are nan where no patch about is a witness. Of the weight of what
    a motion moves along its normal, support is the share that is a copy, with `DOUBT` of all as what is moved and no
    copy: few patches that it moves are little evidence.

    `profile` (m, n): how much a patch has of a copy at each distance from its plane, a `step` apart from 0. `motion`
    (k, 2): along the normal of the patch in question, and across; the shortest first. `flat` (m, 2): normals in the
    plane of the motions. `weight` (m,): of patches as witnesses. Neighbours of patch i, itself
    among them, are ``other[begin[i]:begin[i + 1]]``. `least`: metres from which a motion parts a surface from its copy.
    """
    out = np.full((len(weight), 6), np.nan)
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
        own = weight[i] if out[i, 2] >= least else 0.0
        out[i, 5] = profile[i, min(int(out[i, 2] / step + 0.5), profile.shape[1] - 1)] if own > 0.0 else 0.0
        others = moved[best] - own + DOUBT * (total - weight[i])
        out[i, 3] = (explained[best] - own * out[i, 5]) / others if others > 0.0 else 0.0
        out[i, 4] = support[best] - np.median(support)
    return out
