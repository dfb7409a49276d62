"""How far scans that see a surface lie off each other along its normal, in metres and with bounds.

Each scan's layers over the planes of patches show where it has their surfaces. Within some twenty metres scans count
as rigid: the motions that make their layers agree are found by a search and robust least squares, all surfaces of the
neighbourhood together. What these motions part along a patch's normal, of the scans that see it, is its disagreement.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from mapq.axes import TO_SENSOR as TO_SENSOR
from mapq.cloud import PointCloud
from mapq.features.copies import FARTHEST
from mapq.features.scan_ranges import Disagreement, Window, jacobian_of, normals_round, write_ranges
from mapq.features.shape import PatchShapes
from mapq.kernels.scan_layers import Motions, find_layers, find_sightings
from mapq.kernels.scan_motions import SHOWS, fit_motions, match_scans
from mapq.kernels.scan_views import find_views
from mapq.kernels.voxels import Nearby, voxel_keys
from mapq.patches import Patches

SCAN, TIME, PASS = "scan", "time", "pass_id"
"""Point fields that are read, besides the way to the sensor: number of the scan, seconds, number of the pass."""
FIELDS = (SCAN, TIME, PASS, *TO_SENSOR)

MOMENT_SECONDS = 10.0
"""Seconds of a moment, where times are known but scans are not."""
MOST_MOMENTS = 1_000_000
"""Values that span more are not times: a field of that name may hold anything."""


class Span(NamedTuple):
    """What a field of a map holds, as far as it matters for what the field may be; of parts it can be added up."""

    low: float = np.inf  # of its finite values; inf and -inf where there are none
    high: float = -np.inf
    is_known: bool = True  # whether all values are finite
    is_whole: bool = True  # whether those are whole numbers

    def joined(self, other: Span) -> Span:
        """Return the span of both."""
        return Span(
            min(self.low, other.low),
            max(self.high, other.high),
            self.is_known and other.is_known,
            self.is_whole and other.is_whole,
        )


class Known(NamedTuple):
    """Which fields record where and when the points of a map were seen; decided once for a map."""

    moment: str | None  # field of the moments
    start: float  # least time, where moments are times
    has_rays: bool  # whether it is known where the sensor was

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields that count."""
        return (*((self.moment,) if self.moment is not None else ()), *(TO_SENSOR if self.has_rays else ()))


def spans_of(cloud: PointCloud, names: tuple[str, ...]) -> dict[str, Span]:
    """Return what those fields hold that are a number a point."""
    number = np.flatnonzero(cloud.finite())
    spans = {name: span_of(cloud, name, number) for name in names}
    return {name: span for name, span in spans.items() if span is not None}


def span_of(cloud: PointCloud, name: str, number: NDArray[np.int64]) -> Span | None:
    """Return what a field holds at some points (k,) of a cloud; None if it is not one number a point."""
    values = cloud.fields.get(name)
    if values is None or values.ndim != 1 or values.dtype.kind not in "fiub":
        return None
    values = np.asarray(values[number], np.float64)
    known = np.isfinite(values)
    finite = values[known]
    if len(finite) == 0:
        return Span(is_known=len(values) == 0)
    return Span(float(finite.min()), float(finite.max()), bool(known.all()), bool((finite == np.floor(finite)).all()))


def decide(spans: Mapping[str, Span]) -> Known:
    """Return which fields count, of those whose spans over a whole map are given.

    Moments are scans, else times, else passes. A scan sees all that it sees at once, but a pass may see a place twice,
    so a single pass shows nothing.
    """
    moment, start = None, 0.0
    scan, time = spans.get(SCAN, Span()), spans.get(TIME, Span())
    if _are_numbers(scan, least=1):
        moment = SCAN
    # Below a moment in all, the field is not a clock of the drive: it may be the time within one turn of the laser.
    elif time.is_known and MOMENT_SECONDS < time.high - time.low < MOST_MOMENTS * MOMENT_SECONDS:
        moment, start = TIME, time.low
    elif _are_numbers(spans.get(PASS, Span()), least=2):
        moment = PASS
    return Known(moment, start, all(name in spans for name in TO_SENSOR))


def known_of(cloud: PointCloud) -> Known:
    """Return which fields of a cloud count."""
    return decide(spans_of(cloud, FIELDS))


def _are_numbers(span: Span, least: int) -> bool:
    """Return whether a field numbers scans or passes, and has one or at least two different values."""
    return span.is_known and span.is_whole and (span.low <= span.high if least == 1 else span.low < span.high)


def moments_of(cloud: PointCloud, number: NDArray[np.int64], known: Known) -> NDArray[np.int64] | None:
    """Return the moments (k,) of some points of a cloud, numbered from 0; None if they are not known."""
    if known.moment is None or len(number) == 0:
        return None
    values = np.asarray(cloud.fields[known.moment][number], np.float64)
    if known.moment == TIME:
        return ((values - known.start) / MOMENT_SECONDS).astype(np.int64)
    return np.unique(values, return_inverse=True)[1].astype(np.int64)


def ways_of(cloud: PointCloud, number: NDArray[np.int64], known: Known) -> NDArray[np.float64] | None:
    """Return the way to the sensor (k, 3) in metres of some points (k,) of a cloud; None if no rays are known."""
    if not known.has_rays:
        return None
    return np.column_stack([np.asarray(cloud.fields[name][number], np.float64) for name in TO_SENSOR])


LONGEST_SHIFT = 1.2
"""Metres by which scans may lie off each other."""
WINDOW, OWNED = 20.0, 10.0
"""Metres: radius of the neighbourhoods in which scans are rigid, and of the part whose patches each one answers for."""
MOST_SCANS = 32
"""Of those that see a patch in the median; of more, neighbours count as one."""
MOST_IN_WINDOW = 256
"""Of those that see anything in a cube as wide as a window; likewise. The motions of all are solved for together, and
where so many see a place but few a patch, as of points a second apart, none can be compared."""
NOISE_WIDTHS, THINNEST = 3.0, 0.03
"""Width of a layer in times the noise, and at least in metres."""
PRIOR_SHIFT, PRIOR_TURN, PRIOR_TILT = 0.3, 0.03, 0.005
"""Standard deviations in metres and radians by which motions may still differ from those that were searched."""
BEND = 0.01
"""Metres by which a scan may have a surface otherwise than a rigid one would."""
INLIER = 0.25
"""Robust weight from which a sighting agrees with the motions."""
INFLATION = 4.0
"""Of the variances of motions: residuals of neighbouring cells go together."""
ROUNDS = (2.0, 1.0)
"""Widths of a layer, in times that of noise, of the rounds in which sightings are looked for and motions fitted."""
STILL = Motions(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 6)))
"""No scan is moved."""
PATCH, CELL, MOMENT, PLACE, HEIGHT, N_POINTS, SQUARES = 0, 1, 2, slice(3, 6), 6, 7, 8
"""Columns of layers (up to the height) and sightings."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def measure_disagreement(
    nearby: Nearby, shapes: PatchShapes, noise: float, centres: Floats | None = None
) -> Disagreement:
    """Return how far scans disagree on each patch (m).

    `nearby`: all finite points of the cloud, by the scans that are compared (see :func:`joined`). Faces seen from
    opposite sides are different surfaces. `noise`: of the map, metres. `centres` (w, 3): of windows: the closest one
    answers for a patch. None: as many as answer for all.
    """
    found = Disagreement.unknown(len(shapes))
    if not len(shapes.points):
        return found
    about = (nearby, shapes.sheets, shapes.planes, shapes.points, shapes.start, shapes.spacing)
    centres = window_centres(shapes.centre, shapes.size_rank) if centres is None else centres
    owner = cKDTree(centres).query(shapes.centre)[1]
    layers = find_layers(*about, STILL, np.ones(len(shapes), bool), FARTHEST)
    windows = [
        match(shapes, layers, rows, window_of(layers, rows, centre)) for rows, centre in _inside(layers, centres)
    ]
    # Level surfaces show how scans rise once these are where walls have them.
    layers = find_layers(*about, _motions(owner, windows), shapes.up_cosine >= SHOWS, FARTHEST)
    for place, (rows, _) in enumerate(_inside(layers, centres)):
        windows[place] = match(shapes, layers, rows, windows[place], rises=True)
    del layers
    width, round_about = max(NOISE_WIDTHS * noise, THINNEST), normals_round(shapes)
    for wider in ROUNDS:
        motions = _motions(owner, windows)
        sightings = find_sightings(*about, motions, wider * width)
        is_last = wider == ROUNDS[-1]
        if is_last:
            views, found.shared[:] = find_views(*about, motions, width)
            found.n_scans[:] = 0.0
            views_of = _by_window(owner[views[:, 0].astype(np.int64)], len(centres))
        # Threads cost small matrices far more than they bring.
        with threadpool_limits(1):
            for place, (rows, _) in enumerate(_inside(sightings, centres)):
                windows[place], covariance = fit(shapes, sightings, rows, windows[place], motions)
                if is_last:
                    write_ranges(found, shapes.normal, round_about, views[views_of[place]], windows[place], covariance)
    return found


def joined(patches: Patches, number: Ints, moments: Ints) -> Ints:
    """Return the moments (n,) of points, neighbouring ones as one where a patch or a window is seen at too many."""
    of_patch = np.flatnonzero(patches.patch[number] >= 0)
    if not len(of_patch):
        return moments
    some, number = moments[of_patch], number[of_patch]
    usual = int(np.median(_moments_at(patches.patch[number].astype(np.int64), some)))
    width = max(1, -(-usual // MOST_SCANS))
    if some.max() // width > MOST_IN_WINDOW:
        place = np.unique(voxel_keys(patches.cloud.xyz[number], 2.0 * WINDOW), return_inverse=True)[1]
        width *= -(-int(_moments_at(place, some // width).max()) // MOST_IN_WINDOW)
    return moments // np.int64(width)


def _moments_at(place: Ints, moments: Ints) -> Ints:
    """Return at how many moments each place was seen, of places with any: those of points (n,) are given."""
    n_moments = moments.max() + 1
    seen = np.bincount(np.unique(place * n_moments + moments) // n_moments)
    return np.asarray(seen[seen > 0])


def window_centres(middle: Floats, rank: Ints) -> Floats:
    """Return centres (w, 3) of windows that answer for patches (m), the closest one for each: middles of large patches.

    `middle` (m, 3). `rank` (m,): from the largest one on.
    """
    tree, is_owned = cKDTree(middle), np.zeros(len(middle), bool)
    centres: list[Floats] = []
    for patch in np.argsort(rank):
        if not is_owned[patch]:
            is_owned[tree.query_ball_point(middle[patch], OWNED)] = True
            centres.append(middle[patch])
    return np.array(centres).reshape(-1, 3)


def window_of(layers: Floats, rows: Ints, centre: Floats) -> Window:
    """Return a window of the scans of some layers, not yet moved."""
    scans = np.unique(layers[rows, MOMENT].astype(np.int64))
    return Window(centre, scans, np.zeros((len(scans), 6)))


def match(shapes: PatchShapes, layers: Floats, rows: Ints, window: Window, rises: bool = False) -> Window:
    """Return a window with the motions that a search finds for its scans, from its layers (rows)."""
    rows = rows[np.isin(layers[rows, MOMENT], window.scans)]
    some = layers[rows[np.argsort(layers[rows, MOMENT], kind="stable")]]
    scans, first = np.unique(some[:, MOMENT].astype(np.int64), return_index=True)
    cell, motion = _cells(some), window.motion.copy()
    if len(some):
        level = np.cross(shapes.up, np.eye(3)[int(np.argmin(np.abs(shapes.up)))])
        level /= np.linalg.norm(level)
        axes = np.array([level, np.cross(shapes.up, level), shapes.up])
        first = np.append(first, len(some)).astype(np.int64)
        height, weight = (np.ascontiguousarray(column) for column in (some[:, HEIGHT], some[:, N_POINTS]))
        jacobian = _along_normals(shapes, some, window.centre)
        found = match_scans(cell, first, jacobian, height, weight, int(cell.max()) + 1, axes, LONGEST_SHIFT, rises)
        motion[np.searchsorted(window.scans, scans)] += found
    return window._replace(motion=motion)


def fit(shapes: PatchShapes, sightings: Floats, rows: Ints, window: Window, motions: Motions) -> tuple[Window, Floats]:
    """Return a window with the motions that its sightings (rows) imply, and the covariance (6s, 6s) of these.

    Beginning with the motions it has.
    """
    turn = PRIOR_TILT + (PRIOR_TURN - PRIOR_TILT) * np.abs(shapes.up)
    precision = 1.0 / np.concatenate([np.full(3, PRIOR_SHIFT), turn]) ** 2
    rows = rows[np.isin(sightings[rows, MOMENT], window.scans)]
    if not len(rows):
        return window, np.diag(np.tile(1.0 / precision, len(window.scans)))
    cell = _cells(sightings[rows])
    order = np.argsort(cell, kind="stable")
    rows, cell = rows[order], cell[order]
    some = sightings[rows]
    scan = np.searchsorted(window.scans, some[:, MOMENT]).astype(np.int64)
    jacobian = _along_normals(shapes, some, window.centre)
    # Heights are over planes of scans that were moved as the window of each patch has it: they are put back first.
    height = some[:, HEIGHT] + _moved_by(shapes, some, motions) - np.einsum("ij,ij->i", jacobian, window.motion[scan])
    noise = some[:, SQUARES].sum() / max(float((some[:, N_POINTS] - 1.0).sum()), 1.0)
    weight = 1.0 / (BEND**2 + noise / some[:, N_POINTS])
    first = np.append(np.flatnonzero(np.diff(cell, prepend=-1)), len(cell)).astype(np.int64)
    finest = max(NOISE_WIDTHS * float(np.sqrt(noise)), THINNEST)
    more, normal, residual, robust = fit_motions(
        first, scan, jacobian, height, weight, len(window.scans), precision, finest
    )
    agree = robust > INLIER
    freedom = np.count_nonzero(agree) - (len(first) - 1) - more.size
    scatter = float(weight[agree] @ residual[agree] ** 2) / max(float(freedom), 0.1 * len(rows), 1.0)
    covariance = np.asarray(np.linalg.inv(normal) * (INFLATION * max(scatter, 1.0)), np.float64)
    return window._replace(motion=window.motion + more), covariance


def _along_normals(shapes: PatchShapes, rows: Floats, centre: Floats) -> Floats:
    """Return how motions about a centre displace layers or sightings (r) along their normals, (r, 6)."""
    return jacobian_of(shapes.normals_at(rows[:, PATCH].astype(np.int64), rows[:, PLACE]), rows[:, PLACE], centre)


def _moved_by(shapes: PatchShapes, some: Floats, motions: Motions) -> Floats:
    """Return by how much (r,) sightings were moved along their normals, by the motions of their patches' windows."""
    window = motions.owner[some[:, PATCH].astype(np.int64)]
    entry = np.zeros(len(some), np.int64)
    for each in np.unique(window):
        mine, (begin, end) = window == each, motions.first[each : each + 2]
        entry[mine] = begin + np.searchsorted(motions.moment[begin:end], some[mine, MOMENT])
    jacobian = _along_normals(shapes, some, motions.centre[window])
    return np.asarray(np.einsum("ij,ij->i", jacobian, motions.motion[entry]))


def _by_window(window: Ints, n_windows: int) -> list[Ints]:
    """Return which rows (r) are of each window (w), ascending, by the window of each."""
    return np.split(np.argsort(window, kind="stable"), np.cumsum(np.bincount(window, minlength=n_windows))[:-1])


def _cells(rows: Floats) -> Ints:
    """Return the number (r,) of the cell of each layer or sighting, from 0; cells of patches are apart."""
    key = rows[:, PATCH] * (rows[:, CELL].max(initial=0.0) + 1.0) + rows[:, CELL]
    return np.unique(key, return_inverse=True)[1].astype(np.int64)


def _inside(rows: Floats, centres: Floats) -> Iterator[tuple[Ints, Floats]]:
    """Yield for each window which of the layers or sightings (r) lie in it, ascending, and its centre."""
    tree = cKDTree(rows[:, PLACE])
    for centre in centres:
        yield np.array(tree.query_ball_point(centre, WINDOW, return_sorted=True), np.int64), centre


def _motions(owner: Ints, windows: list[Window]) -> Motions:
    first = np.cumsum([0, *(len(window.scans) for window in windows)]).astype(np.int64)
    centre = np.array([window.centre for window in windows])
    scans, motion = (np.concatenate([getattr(window, name) for window in windows]) for name in ("scans", "motion"))
    return Motions(owner, centre, first, scans.astype(np.int64), motion)
