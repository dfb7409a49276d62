"""Which points are suspicious: passes over one cell of a true surface that disagree along its normal in the map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from mapq.configuration import SimulateSettings
from mapq.simulate.scene import NO_SURFACE

Floats = NDArray[np.float64]


class Truth(NamedTuple):
    """Whether each point (n,) is suspicious, by how many metres visits disagree there, and its cell, -1 for none.

    The disagreement is that of the point's visit with the one that disagrees most, in the point's cell or, where one
    visit alone saw that, in those that it touches; 0 where there is no other.
    """

    suspicious: NDArray[np.bool_]
    disagreement: Floats
    cell: NDArray[np.int64]


class Observed(NamedTuple):
    """Points with all that the rule needs: where beams met the world (n, 3), and at what times (n,).

    `moved` (n, 2) is the horizontal displacement by drift. Each point is of a true planar surface (n,), whose normal
    (n, 3) counts, or of a thing (n,) without planes; both are -1 for what moves and for mixed ranges.
    """

    hits: Floats
    moved: Floats
    time: Floats
    surface: NDArray[np.int32]
    thing: NDArray[np.int32]
    normal: Floats


def judge(seen: Observed, settings: SimulateSettings) -> Truth:
    """Return the truth of every point.

    In a cell, points of which no two neighbours in time lie more than `settings.visit_gap` apart are one visit; a
    visit with `settings.visit_points` points or more counts. A point is suspicious if its visit is displaced from
    one that counts by more than `settings.disagreement`: along the normal for planar surfaces, horizontally for
    things without planes. Where one visit alone counts in a planar cell it is compared with those of the parallel
    cells that it touches: a pane that the second pass missed is as wrong as the doubled facade round it. What drift
    moved together with all that it touches, or what was seen once, is plausible.
    """
    cell = cells_of(seen, settings.cell)
    some = np.flatnonzero(cell >= 0)
    order = some[np.lexsort((seen.time[some], cell[some]))]
    is_new_cell = np.diff(cell[order], prepend=-1) != 0
    is_new = is_new_cell | (np.diff(seen.time[order], prepend=0.0) > settings.visit_gap)
    visit = np.cumsum(is_new) - 1
    n_visits = int(visit[-1]) + 1 if len(visit) else 0
    counts = np.bincount(visit, minlength=n_visits)
    planar = seen.surface[order] != NO_SURFACE
    along = np.einsum("ij,ij->i", seen.moved[order], seen.normal[order, :2])
    # A displacement along the normal is a number; one without a normal a vector.
    moved = np.where(planar[:, None], np.stack([along, np.zeros(len(order))], axis=1), seen.moved[order])
    mean = np.stack([np.bincount(visit, moved[:, k], n_visits) for k in (0, 1)], axis=1) / counts[:, None]
    worst = _worst(cell[order][is_new], mean, counts >= settings.visit_points)
    visits = CellVisits.gathered(seen, order, visit, cell[order][is_new], counts >= settings.visit_points)
    alone = visits.alone()
    worst[alone] = np.maximum(worst[alone], disagreement_of_touching(visits, alone, settings))
    disagreement = np.zeros(len(cell))
    disagreement[order] = worst[visit]
    return Truth(disagreement > settings.disagreement, disagreement, cell)


class CellVisits(NamedTuple):
    """Visits (k,) of cells: mean place, normal and horizontal displacement by drift, first and last time (seconds).

    `counted`: whether the visit has enough points; `planar`: whether its cell is of a planar surface.
    """

    cell: NDArray[np.int64]
    hits: Floats
    normal: Floats
    moved: Floats
    begin: Floats
    end: Floats
    counted: NDArray[np.bool_]
    planar: NDArray[np.bool_]

    @classmethod
    def gathered(
        cls,
        seen: Observed,
        order: NDArray[np.intp],
        visit: NDArray[np.int64],
        cell: NDArray[np.int64],
        counted: NDArray[np.bool_],
    ) -> CellVisits:
        """Return the means over each visit; `visit` numbers the points `order` in ascending order."""
        n_visits = len(cell)
        counts = np.maximum(np.bincount(visit, minlength=n_visits), 1)[:, None]

        def mean(values: Floats) -> Floats:
            sums = [np.bincount(visit, column, n_visits) for column in values[order].T]
            return np.asarray(np.stack(sums, axis=1) / counts)

        rows = order[np.searchsorted(visit, np.arange(n_visits))]
        last = order[np.searchsorted(visit, np.arange(n_visits), side="right") - 1]
        planar = seen.surface[rows] != NO_SURFACE
        times = seen.time[rows], seen.time[last]
        return cls(cell, mean(seen.hits), seen.normal[rows], mean(seen.moved), *times, counted, planar)

    def alone(self) -> NDArray[np.intp]:
        """Return the counted visits of planar cells that no other counted visit saw."""
        n_counted = np.bincount(self.cell, self.counted, int(self.cell.max(initial=-1)) + 1)
        return np.flatnonzero(self.planar & self.counted & (n_counted[self.cell] == 1))


def disagreement_of_touching(visits: CellVisits, some: NDArray[np.intp], settings: SimulateSettings) -> Floats:
    """Return for `some` visits (k,) the largest displacement along their normal from an earlier or later visit near by.

    Near by is a parallel cell (within 30 degrees) whose points lie in the mean not farther than a cell and a half. From
    the end of one visit to the begin of the other more than `settings.visit_gap` must pass: else they are one.
    """
    worst = np.zeros(len(some))
    counted = np.flatnonzero(visits.counted & visits.planar)
    if len(some) == 0 or len(counted) == 0:
        return worst
    near = KDTree(visits.hits[counted]).query_ball_point(visits.hits[some], 1.5 * settings.cell)
    row = np.repeat(np.arange(len(some)), [len(each) for each in near])
    one, other = some[row], counted[np.concatenate([*near, []]).astype(np.intp)]
    parallel = np.abs(np.einsum("ij,ij->i", visits.normal[one], visits.normal[other])) > np.cos(np.radians(30.0))
    between = np.maximum(visits.begin[one] - visits.end[other], visits.begin[other] - visits.end[one])
    along = np.einsum("ij,ij->i", visits.moved[one] - visits.moved[other], visits.normal[one, :2])
    np.maximum.at(worst, row, np.where(parallel & (between > settings.visit_gap), np.abs(along), 0.0))
    return worst


def cells_of(seen: Observed, side: float) -> NDArray[np.int64]:
    """Return the cell (n,) of each point: squares of a planar surface, cubes of a thing without planes, else -1.

    Cells are numbered from 0 in the order of surfaces, then of things, and of their place.
    """
    n = seen.normal
    flat = np.abs(n[:, 2]) > 0.999
    level = np.where(flat[:, None], [1.0, 0.0], np.stack([-n[:, 1], n[:, 0]], axis=1))
    level = level / np.maximum(np.hypot(level[:, 0], level[:, 1]), 1e-12)[:, None]
    across = np.column_stack([level, np.zeros(len(n))])
    upward = np.cross(n, across)
    planar = seen.surface != NO_SURFACE
    place = np.where(
        planar[:, None],
        np.column_stack(
            [np.einsum("ij,ij->i", seen.hits, across), np.einsum("ij,ij->i", seen.hits, upward), np.zeros(len(n))]
        ),
        seen.hits,
    )
    index = np.floor(place / side).astype(np.int64)
    key = np.column_stack([~planar, np.where(planar, seen.surface, seen.thing), index])
    cell = np.full(len(n), -1, np.int64)
    some = planar | (seen.thing >= 0)
    if some.any():
        cell[some] = np.unique(key[some], axis=0, return_inverse=True)[1].ravel()
    return cell


def _worst(cell: NDArray[np.int64], mean: Floats, counted: NDArray[np.bool_]) -> Floats:
    """Return for each visit the largest distance to another visit of its cell that counts."""
    worst = np.zeros(len(cell))
    lag = 1
    while True:
        same = np.flatnonzero(cell[lag:] == cell[: len(cell) - lag]) if lag < len(cell) else np.zeros(0, np.int64)
        if len(same) == 0:
            return worst
        apart = np.hypot(*(mean[same + lag] - mean[same]).T)
        for one, other in ((same, same + lag), (same + lag, same)):
            worst[one] = np.maximum(worst[one], np.where(counted[other], apart, 0.0))
        lag += 1
