"""Curved patches: parts of cylinders, whose narrow plane slices show by their normals how they bend."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapq.kernels.cylinders import Cylinder, grow_cylinder
from mapq.kernels.planes import Tolerance
from mapq.segmentation.parameters import Parameters
from mapq.segmentation.points import Points
from mapq.segmentation.regions import LOOSE, MIN_FRAGMENT, MIN_SUPPORT, Core, fit, sure_normals

RADII = 0.05, 20.0
"""Metres."""
MIN_ARC = np.radians(30.0)
MIN_SAGITTA = 2.25
"""Times the distance limit: a plane explains arcs of up to twice it."""
MAX_RMS = 0.45
"""Times the distance limit: noise alone has a third of it, points strewn about 0.58."""
MIN_LENGTH = 0.5
"""Of the chord: a ball looks like a short cylinder."""
FAIR_SHARE = 0.5
"""Of the points of a plane region that a cylinder must take to take any; what it leaves is no region then."""
MIN_KEPT = 0.6
"""Of the points on a cylinder that are left to it where planes keep theirs: less is the edge where two walls meet."""
MIN_TURN, TURN_IN_ERRORS = np.radians(6.0), 4.0
"""Radians by which the normals of a slice turn from side to side, and in times what their noise makes of it."""
FACING = 0.5
"""Cosine of the angle between a slice and the normals that count."""
ALIKE = 8.0
"""Points that share the noise of their normals, as they share most neighbours."""
ROUNDS, STEPS = 8, 3
"""Of growing and fitting a cylinder, and steps of the fit in each."""
NEAR = 0.5
"""Times the distance limit: heights that weigh a quarter in a fit."""
WITHIN = 0.02, 0.98
"""Quantiles taken for the ends of an arc."""

BEND, PLACE, MSE = slice(0, 3), slice(3, 9), 9
"""Columns of the surfaces of regions: axis, as long as the surface is bent, in 1/m; normal and place in the middle of
the arc; mean square of the heights of points. All are 0 for planes."""

Floats = NDArray[np.float64]
Ints32 = NDArray[np.int32]


class Search(NamedTuple):
    """Points while cylinders are looked for."""

    core: Core
    sure: Core  # without the normals of thick neighbourhoods
    chosen: Parameters
    region: Ints32  # (c,) -1 for none, and where a cylinder took most of a region
    size: NDArray[np.int64]  # (r,) of regions, as planes were grown
    order: Ints32  # (c,) by region
    begin: NDArray[np.int64]  # (r + 1,) where each region begins in the order
    free: NDArray[np.bool_]  # (c,) on no cylinder yet
    mark: NDArray[np.bool_]  # (c,) scratch, false
    queue: Ints32  # (c,) scratch

    @classmethod
    def over(cls, core: Core, chosen: Parameters, region: Ints32) -> Search:
        """Begin a search."""
        n_regions = int(region.max(initial=-1)) + 1
        order = np.argsort(region, kind="stable").astype(np.int32)
        begin = np.searchsorted(region[order], np.arange(n_regions + 1))
        sure, free = core._replace(normal=sure_normals(core)), np.ones(len(region), np.bool_)
        return cls(core, sure, chosen, region.copy(), np.diff(begin), order, begin, free, ~free, np.empty_like(region))

    def of(self, regions: ArrayLike) -> Ints32:
        """Return the free points that some regions still have."""
        lists = [self.order[self.begin[r] : self.begin[r + 1]] for r in np.atleast_1d(regions)]
        some: Ints32 = np.concatenate([np.zeros(0, np.int32), *lists])
        return np.asarray(some[self.free[some] & (self.region[some] >= 0)])

    @property
    def radii(self) -> tuple[float, float]:
        """Smallest and largest radius in metres: a sagitta is no longer than the radius."""
        return max(RADII[0], MIN_SAGITTA * self.chosen.max_distance), RADII[1]

    def on(self, cylinder: Cylinder, core: Core, seeds: Ints32) -> Ints32:
        """Return the points, ascending, that neighbours with such normals connect with seeds on a cylinder."""
        cosine = float(np.cos(np.radians(min(LOOSE * self.chosen.max_angle, 90.0))))
        tolerance = Tolerance(cosine, self.chosen.max_distance)
        n = grow_cylinder(core.surface, seeds, self.free, cylinder, tolerance, self.mark, self.queue)
        return np.sort(self.queue[:n])


def find_cylinders(core: Core, chosen: Parameters, region: Ints32) -> tuple[Ints32, list[Cylinder]]:
    """Return the region (c,) of each core point with those on cylinders in regions of their own, behind all others."""
    search = Search.over(core, chosen, region)
    slices = bent_slices(search)
    found: list[tuple[Cylinder, Ints32]] = []
    for r in sorted(slices, key=lambda r: (-search.size[r], r)):
        seeds = search.of(r)
        if len(seeds) < FAIR_SHARE * search.size[r]:
            continue
        grown = grow_fairly(search, seeds, slices[r])
        if grown is not None and is_curved(search, *grown):
            found.append(grown)
            replaced = np.unique(search.region[grown[1]])
            search.region[search.of(replaced[replaced >= 0])] = -1
            search.free[grown[1]] = False
    for number, (_, members) in enumerate(found, len(search.size)):
        search.region[members] = number
    return search.region, [cylinder for cylinder, _ in found]


def grow_fairly(search: Search, seeds: Ints32, start: Cylinder) -> tuple[Cylinder, Ints32] | None:
    """Return the cylinder that a slice of it grows to, and its members; walls that it only touches keep theirs."""
    grown = grow(search, seeds, start)
    if grown is None:
        return None
    region, taken = np.unique(search.region[grown[1]], return_counts=True)
    others = search.of(region[(region >= 0) & (taken < FAIR_SHARE * search.size[region])])
    if len(others):
        search.free[others] = False
        n_all, grown = len(grown[1]), grow(search, seeds, grown[0])
        search.free[others] = True
        if grown is not None and len(grown[1]) < MIN_KEPT * n_all:
            return None
    return grown


def bent_slices(search: Search) -> dict[int, Cylinder]:
    """Return the cylinder of each plane region whose normals turn along it, by their regression on places."""
    core, region, n_regions = search.sure, search.region, len(search.size)
    of, planes = np.flatnonzero(region >= 0), fit(core.xyz, region).planes
    cosine = np.einsum("ij,ij->i", core.normal[of], planes[region[of], :3])
    of, cosine = of[np.abs(cosine) > FACING], cosine[np.abs(cosine) > FACING]
    r = region[of]
    normal, place = planes[r, :3], core.xyz[of] - planes[r, 3:]
    place -= np.einsum("ij,ij->i", place, normal)[:, None] * normal
    lean = core.normal[of] / cosine[:, None] - normal
    n = np.bincount(r, minlength=n_regions).astype(np.float64)
    spread, turn = (
        np.stack([np.bincount(r, a[:, i] * place[:, j], n_regions) for i in range(3) for j in range(3)], axis=1)
        for a in (place, lean)
    )
    noise = np.bincount(r, (lean * lean).sum(axis=1), n_regions) / np.maximum(n, 1.0)
    found = {}
    for each in np.flatnonzero(n >= MIN_FRAGMENT).tolist():
        one, p, t = planes[each, :3], spread[each].reshape(3, 3) / n[each], turn[each].reshape(3, 3) / n[each]
        # Points on a line say nothing across it.
        shape = np.linalg.solve(p + np.trace(p) * (np.outer(one, one) + 1e-9 * np.eye(3)), t.T)
        values, vectors = np.linalg.eigh(shape + shape.T)
        largest = int(np.argmax(np.abs(values)))
        bend, along = 0.5 * values[largest], vectors[:, largest]
        variance = along @ p @ along
        side = np.sqrt(12.0 * variance)
        error = np.sqrt(12.0 * max(noise[each] - bend * bend * variance, 0.0) * ALIKE / n[each])
        within = 0.5 / search.radii[1] < abs(bend) < 2.0 / search.radii[0]
        if within and abs(bend) * side > max(MIN_TURN, TURN_IN_ERRORS * error):
            axis = np.cross(one, along)
            centre = planes[each, 3:] + (0.5 * bend * variance - 1.0 / bend) * one
            found[each] = Cylinder(axis / np.linalg.norm(axis), centre, 1.0 / abs(bend))
    return found


def grow(search: Search, seeds: Ints32, start: Cylinder) -> tuple[Cylinder, Ints32] | None:
    """Return the cylinder that a slice of it grows to with its members, ascending; None if there is none."""
    cylinder, members = start, np.zeros(0, np.int32)
    for _ in range(ROUNDS):
        before, members = members, search.on(cylinder, search.sure, seeds)
        if len(members) < MIN_FRAGMENT:
            return None
        if np.array_equal(before, members):
            break
        for _ in range(STEPS):
            cylinder = improve(search.core.xyz[members], cylinder, NEAR * search.chosen.max_distance)
        if not search.radii[0] < cylinder.radius < search.radii[1]:
            return None
    return cylinder, search.on(cylinder, search.core, members)


def improve(xyz: Floats, cylinder: Cylinder, near: float) -> Cylinder:
    """Return the cylinder after one step of robust least squares (Gauss and Newton) towards points (n, 3).

    With the weights of Geman and McClure at the scale `near`, in metres: between two copies it settles on one.
    """
    one, other = axes_across(cylinder.axis)
    offset = xyz - cylinder.centre
    x, y, z = offset @ one, offset @ other, offset @ cylinder.axis
    middle = z.mean()
    away = np.hypot(x, y)
    x, y, z, off = x / away, y / away, z - middle, away - cylinder.radius
    rows = np.column_stack([x, y, z * x, z * y, np.ones(len(x))])
    weighed = rows.T * (near**2 / (near**2 + off * off)) ** 2
    step = np.linalg.lstsq(weighed @ rows, weighed @ off, rcond=1e-12)[0]
    axis = cylinder.axis + step[2] * one + step[3] * other
    centre = cylinder.centre + middle * cylinder.axis + step[0] * one + step[1] * other
    return Cylinder(axis / np.linalg.norm(axis), centre, float(cylinder.radius + step[4]))


def axes_across(axis: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors (3,) across an axis and each other."""
    one = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    one /= np.linalg.norm(one)
    return one, np.cross(axis, one)


class Arc(NamedTuple):
    """The part of a cylinder that points lie on."""

    middle: Floats  # (3,) unit vector from the axis to the middle of the arc
    angle: float  # radians from end to end
    along: Floats  # (2,) ends along the axis, from the cylinder's centre, metres


def arc_of(xyz: Floats, cylinder: Cylinder) -> Arc:
    """Return the arc of points (n, 3): all but their widest gap."""
    one, other = axes_across(cylinder.axis)
    offset = xyz - cylinder.centre
    angle = np.sort(np.arctan2(offset @ other, offset @ one))
    gaps = np.diff(angle, append=angle[0] + 2.0 * np.pi)
    widest = int(np.argmax(gaps))
    middle = angle[widest] + 0.5 * gaps[widest] + np.pi
    turned = np.mod(angle - middle + np.pi, 2.0 * np.pi)
    low, high = np.quantile(turned, WITHIN)
    middle += 0.5 * (low + high) - np.pi
    ends = np.quantile(offset @ cylinder.axis, WITHIN)
    return Arc(np.cos(middle) * one + np.sin(middle) * other, float(high - low), ends)


def heights(xyz: Floats, cylinder: Cylinder) -> Floats:
    """Return the heights (n,) of points (n, 3) over a cylinder."""
    return np.asarray(np.linalg.norm(np.cross(xyz - cylinder.centre, cylinder.axis), axis=1) - cylinder.radius)


def is_curved(search: Search, cylinder: Cylinder, members: Ints32) -> bool:
    """Return whether points are a surface, that a cylinder explains and a plane does not."""
    chosen, xyz = search.chosen, search.core.xyz[members]
    arc, off = arc_of(xyz, cylinder), heights(xyz, cylinder)
    half, length = 0.5 * min(arc.angle, np.pi), float(arc.along[1] - arc.along[0])
    chord, sagitta = 2.0 * cylinder.radius * np.sin(half), cylinder.radius * (1.0 - np.cos(half))
    if min(length, cylinder.radius * arc.angle) < chosen.min_extent or length < MIN_LENGTH * chord:
        return False
    if arc.angle < MIN_ARC or sagitta < MIN_SAGITTA * chosen.max_distance:
        return False
    if np.sqrt(np.mean(off * off)) > MAX_RMS * chosen.max_distance:
        return False
    search.mark[members] = True
    around = search.core.neighbours[members]
    around = around[around >= 0]
    own, free = search.mark[around], search.free[around] & (search.region[around] < 0)
    search.mark[members] = False
    return bool(own.sum() >= MIN_SUPPORT * (own | free).sum())


def spread_cylinders(
    points: Points, chosen: Parameters, of: Ints32, region: Ints32, cylinders: list[Cylinder]
) -> tuple[Ints32, Floats]:
    """Return the region (u,) of every point, and the surfaces (r, 10) of regions.

    `of` (c,): region of each representative, the last ones on the cylinders. `region` (u,): of points on planes.
    """
    cell = np.cumsum(points.first_level <= chosen.level) - 1
    out, n_regions = region.copy(), int(of.max(initial=-1)) + 1
    surfaces = np.zeros((n_regions, 10))
    order = np.argsort(of[cell], kind="stable")
    begin = np.searchsorted(of[cell][order], np.arange(n_regions + 1))
    for number, cylinder in enumerate(cylinders, n_regions - len(cylinders)):
        mine = order[begin[number] : begin[number + 1]]
        off = heights(points.xyz[mine], cylinder)
        near = np.abs(off) <= chosen.max_distance
        mine, arc = mine[near], arc_of(points.xyz[mine[near]], cylinder)
        out[mine] = number
        place = cylinder.centre + cylinder.radius * arc.middle + arc.along.mean() * cylinder.axis
        surfaces[number] = *(cylinder.axis / cylinder.radius), *arc.middle, *place, np.mean(off[near] ** 2)
    return out, surfaces
