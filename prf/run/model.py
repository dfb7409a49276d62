"""What a RUN directory holds, as arrays in memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.agreement import Agreement, agreement
from prf.coloring import Coloring, Draws
from prf.sensors.laser import unit_vectors
from prf.shell.errors import InputError

ARC_POINTS = 9
"""Points by which the arc of a sonar reading is drawn."""


class PosteriorImage(NamedTuple):
    """Occupancy image on square cells, estimated over every step after burn-in.

    Attributes
    ----------
    occupancy : (ny, nx) float32
        Share of steps in which the cell's centre is black; row 0 has the lowest y; nan where nothing is known.
    square_occupancy : (ny, nx) float32
        Share of steps in which the cell is not completely white.
    origin : (2,) float64
        Lower left corner of cell (0, 0) in metres.
    resolution : float
        Side of a cell in metres.
    seen : (ny, nx) bool
        Whether a reading of the chosen scans and beams, thinned away or not, crossed the cell or ended in it.
    disagreement : (ny, nx) float32 or None
        Largest difference between the shares of black of any two chains; nan where there is none. None of a grid.
    """

    occupancy: NDArray[np.float32]
    square_occupancy: NDArray[np.float32]
    origin: NDArray[np.float64]
    resolution: float
    seen: NDArray[np.bool_]
    disagreement: NDArray[np.float32] | None = None

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the image in metres."""
        n_rows, n_columns = self.occupancy.shape
        x, y = float(self.origin[0]), float(self.origin[1])
        return x, x + n_columns * self.resolution, y, y + n_rows * self.resolution

    def agreement(self) -> Agreement | None:
        """Return where the chains agree; None of a grid."""
        if self.disagreement is None:
            return None
        return agreement(self.disagreement, self.seen, self.origin, self.resolution)

    def seen_at(self, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each of the points (n, 2), metres, lies in a cell that was seen; False outside the image."""
        column, row = np.floor((xy - self.origin) / self.resolution).T
        inside = (column >= 0) & (row >= 0) & (column < self.seen.shape[1]) & (row < self.seen.shape[0])
        found = np.zeros(len(xy), np.bool_)
        found[inside] = self.seen[row[inside].astype(np.int64), column[inside].astype(np.int64)]
        return found


class Beams(NamedTuple):
    """The beams that a run used, one row a beam."""

    origin: NDArray[np.float64]  # (n, 2): sensor position in metres
    angle: NDArray[np.float64]  # (n,): direction in the world frame, radians counter-clockwise from +x
    range: NDArray[np.float64]  # (n,): measured distance in metres; inf for no return
    scan: NDArray[np.int64]  # (n,): number of the scan in its log; beams of one scan have one origin
    max_range: float  # distance in metres from which on a reading counts as no return

    def select(self, mask: NDArray[np.bool_] | NDArray[np.int64]) -> Beams:
        """Return the beams that a boolean mask (n,) or an array of indices picks."""
        return Beams(self.origin[mask], self.angle[mask], self.range[mask], self.scan[mask], self.max_range)

    @property
    def returned(self) -> NDArray[np.bool_]:
        """Which beams (n,) have a return below the maximum range."""
        return np.isfinite(self.range) & (self.range < self.max_range)

    def impacts(self) -> NDArray[np.float64]:
        """Return the end points of the beams with a return, (n_returns, 2) in metres."""
        hit = self.returned
        impacts: NDArray[np.float64] = self.origin[hit] + self.range[hit, None] * unit_vectors(self.angle[hit])
        return impacts

    def sensor_path(self) -> NDArray[np.float64]:
        """Return the sensor's position scan by scan, (n_scans, 2), in the order of the scan numbers."""
        _, first = np.unique(self.scan, return_index=True)
        return self.origin[first]


class Cones(NamedTuple):
    """The sonar readings that a run used, one row a reading."""

    origin: NDArray[np.float64]  # (n, 2): position of the transducer in metres
    angle: NDArray[np.float64]  # (n,): direction of its axis in the world frame, radians counter-clockwise from +x
    cone: NDArray[np.float64]  # (n,): full field of view, radians
    range: NDArray[np.float64]  # (n,): measured distance in metres; inf for no return
    scan: NDArray[np.int64]  # (n,): number of the scan in its log
    max_range: float  # distance in metres from which on a reading counts as no return

    def select(self, mask: NDArray[np.bool_]) -> Cones:
        """Return the readings that `mask` (n,) picks."""
        origin, angle, cone, ranges = (array[mask] for array in (self.origin, self.angle, self.cone, self.range))
        return Cones(origin, angle, cone, ranges, self.scan[mask], self.max_range)

    @property
    def returned(self) -> NDArray[np.bool_]:
        """Which readings (n,) have a return below the maximum range."""
        return np.isfinite(self.range) & (self.range < self.max_range)

    def arcs(self) -> NDArray[np.float64]:
        """Return the arcs across the field of view of readings with a return, (n_returns, ARC_POINTS, 2) in metres."""
        hit = self.returned
        turn = self.angle[hit, None] + self.cone[hit, None] * np.linspace(-0.5, 0.5, ARC_POINTS)
        away = self.range[hit, None, None] * np.stack((np.cos(turn), np.sin(turn)), axis=-1)
        arcs: NDArray[np.float64] = self.origin[hit, None] + away
        return arcs

    def sensor_path(self) -> NDArray[np.float64]:
        """Return the position of the first transducer of every scan, (n_scans, 2), in the order of the scans."""
        _, first = np.unique(self.scan, return_index=True)
        return self.origin[first]


class Points(NamedTuple):
    """The point observations that a run used, one row an observation."""

    xy: NDArray[np.float64]  # (n, 2): places in metres
    value: NDArray[np.float64]  # (n,): what was observed there


@dataclass(frozen=True, eq=False)
class Run:
    """A run of the sampler: draws from the posterior and what was estimated on the way.

    A run may have been interrupted at any time, so it may have no draws; the other parts are None where the run
    wrote none, or where the reader did not ask for them.

    Attributes
    ----------
    manifest : dict
        Content of manifest.json: schema, versions, configuration, seed, inputs, status, created.
    draws : Draws
        n recorded colorings, ragged.
    chain : (n,) int32
        Chain that recorded each draw.
    step : (n,) int64
        Step of its chain at which it was recorded, burn-in included.
    functionals : dict of str to (n,) float64
        Such as n_edges, total_length (m), log_prior, log_likelihood, one value a draw.
    probe_xy : (n_probes, 2) float64
        Points in metres whose colour is watched for convergence.
    probe_black : (n, n_probes) bool
        Colour of each probe point in each draw.
    image : PosteriorImage or None
    beams : Beams or None
        None too where the run used no laser.
    cones : Cones or None
        None too where the run used no sonar.
    points : Points or None
        None too where the run used no point observations.
    way : (k, 4) float64
        Pieces of the way driven that was held free: ends x0, y0, x1, y1 in metres.
    best : Coloring or None
        The map of highest log posterior among the states that any chain recorded.
    best_log_posterior : float
        Its log posterior, up to a constant; nan if unknown.
    diagnostics : dict or None
        Content of diagnostics.json.
    path : Path or None
        Where the run was read from.
    """

    manifest: dict[str, Any]
    draws: Draws
    chain: NDArray[np.int32]
    step: NDArray[np.int64]
    functionals: dict[str, NDArray[np.float64]]
    probe_xy: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    probe_black: NDArray[np.bool_] = field(default_factory=lambda: np.empty((0, 0), dtype=np.bool_))
    image: PosteriorImage | None = None
    beams: Beams | None = None
    cones: Cones | None = None
    points: Points | None = None
    way: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 4)))
    best: Coloring | None = None
    best_log_posterior: float = float("nan")
    diagnostics: dict[str, Any] | None = None
    path: Path | None = None

    @property
    def n_chains(self) -> int:
        """Number of chains that recorded a draw."""
        return len(np.unique(self.chain))

    @property
    def sensors(self) -> Beams | Cones | None:
        """The readings that show the sensor's path: the laser's if there are any."""
        return self.beams if self.beams is not None else self.cones

    @property
    def name(self) -> str:
        """Name of the run's folder, for messages and titles."""
        return "run" if self.path is None else self.path.resolve().name

    def missing(self, file: str) -> InputError:
        """Return the error that says that `file` is not in this run."""
        where = file if self.path is None else str(self.path / file)
        return InputError(
            f"{where}: no such file: the run ended before it was written. Go on with prf sample --resume."
        )
