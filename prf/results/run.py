"""What a run of the sampler leaves, as data: draws of maps, the occupancy image, and where chains agree."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring, Draws
from prf.model.orientation import wall_direction
from prf.model.sensors import LaserModel
from prf.model.walls import WallDraws
from prf.poses.posterior import Trajectory
from prf.readings import PointTable, Readings
from prf.readings.counts import BeamCounts
from prf.results.convergence import Diagnosis, is_early
from prf.results.estimate import by_chain, nearby_ess, probe_ess, smallest_ess
from prf.shell.errors import InputError

Part = TypeVar("Part")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RunData:
    """A run of the sampler, as data: what a RUN directory holds. People hold :class:`prf.output.run.Run` over it.

    A run may have been interrupted at any time, so it may have no draws; the other parts are None where the run
    wrote none, or where they were not read.

    Attributes
    ----------
    manifest : dict
        Content of manifest.json: schema, versions, configuration, seed, inputs, status, created.
    draws : Draws
        n recorded colorings, ragged.
    chain : (n,) int32
        Chain that recorded each draw.
    walls : WallDraws or None
        The walls of each draw, whose map is the region that they cover; None of maps of polygons.
    step : (n,) int64
        Step of its chain at which it was recorded, burn-in included.
    functionals : dict of str to (n,) float64
        Such as n_edges, total_length (m), log_prior, log_likelihood, one value a draw.
    probe_xy : (n_probes, 2) float64
        Points in metres whose colour is watched for convergence.
    probe_black : (n, n_probes) bool
        Colour of each probe point in each draw.
    image : PosteriorImage or None
    laser, sonar : Readings or None
        Those that the run used; None too where it used no laser, or no sonar.
    points : PointTable or None
        None too where the run used no point observations.
    way : (k, 4) float64
        Pieces of the way driven that was held free: ends x0, y0, x1, y1 in metres.
    counts : BeamCounts or None
        How many beams of the chosen scans, thinned away or not, reach each place, and how many return from it; None
        where there is no laser or poses were sampled, and of runs of earlier releases.
    trajectory : Trajectory or None
        The poses that were sampled with the map; None where they were fixed. Readings are at the given ones.
    best : Coloring or None
        The map of highest log posterior among the states that any chain recorded.
    best_log_posterior : float
        Its log posterior, up to a constant; nan if unknown.
    diagnostics : dict or None
        Content of diagnostics.json.
    path : Path or None
        Where the run was read from.
    progress : Progress or None
        How the sampling of this call ended; None of a run that was read.
    """

    manifest: dict[str, Any]
    draws: Draws
    chain: NDArray[np.int32]
    step: NDArray[np.int64]
    functionals: dict[str, NDArray[np.float64]]
    probe_xy: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.empty((0, 2)))
    probe_black: NDArray[np.bool_] = dataclasses.field(default_factory=lambda: np.empty((0, 0), dtype=np.bool_))
    image: PosteriorImage | None = None
    laser: Readings | None = None
    sonar: Readings | None = None
    points: PointTable | None = None
    way: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.empty((0, 4)))
    counts: BeamCounts | None = None
    trajectory: Trajectory | None = None
    walls: WallDraws | None = None
    best: Coloring | None = None
    best_log_posterior: float = float("nan")
    diagnostics: dict[str, Any] | None = None
    path: Path | None = None
    progress: Progress | None = None

    @property
    def n_chains(self) -> int:
        """Number of chains that recorded a draw."""
        return len(np.unique(self.chain))

    @property
    def is_early(self) -> bool:
        """Whether the run is too short to say where its chains agree (docs/convergence.md)."""
        draws_per_chain = int(np.unique(self.chain, return_counts=True)[1].min(initial=len(self.chain)))
        return is_early((self.diagnostics or {}).get("functionals") or {}, draws_per_chain)

    @cached_property
    def smallest_ess(self) -> float:
        """Smallest effective sample size of the run's colours: what it knows least."""
        functionals = np.column_stack([np.empty((len(self.chain), 0)), *self.functionals.values()])
        return smallest_ess(by_chain(self.probe_black, self.chain), by_chain(functionals, self.chain))

    @cached_property
    def probe_ess(self) -> NDArray[np.float64]:
        """Effective sample size (n_probes,) of the colour of each probe point, nan of one that is constant."""
        return probe_ess(by_chain(self.probe_black, self.chain))

    def ess_near(self, places: NDArray[Any], reach: float) -> NDArray[np.float64]:
        """Return what draws that are all equal count for (n,) within `reach` metres of geometries (n,)."""
        return nearby_ess(places, reach, self.probe_xy, self.probe_ess, self.smallest_ess)

    @property
    def building(self) -> dict[str, float] | None:
        """Direction of the walls (radians, up to a right angle) and the strength of their preference, where sampled.

        The direction is that in which most metres of edges run (:func:`prf.model.orientation.wall_direction`), over all
        draws, and how far that of each is off: the angle of the prior counts a splinter as much as a corridor. Of the
        strength, mean and standard deviation.
        """
        strength = self.functionals.get("orientation")
        if strength is None or len(strength) == 0:
            return None
        step = np.diff(self.draws.xy[self.draws.global_edges()], axis=1)[:, 0]
        owner = self.draws.draw_of_edge()
        angle = float(wall_direction(step, np.zeros_like(owner), 1)[0])
        off = np.angle(np.exp(4j * (wall_direction(step, owner, len(strength)) - angle))) / 4.0
        return {
            "angle": angle,
            "angle_sd": float(np.sqrt(np.mean(off**2))),
            "orientation": float(strength.mean()),
            "orientation_sd": float(strength.std()),
        }

    @property
    def sensors(self) -> Readings | None:
        """The readings that show the sensor's path: the laser's if there are any."""
        return self.laser if self.laser is not None else self.sonar

    @property
    def path_xy(self) -> NDArray[np.float64]:
        """The way of the robot (n, 2), metres: posterior means of sampled poses, or else the sensor's path."""
        if self.trajectory is not None:
            return self.trajectory.mean[:, :2]
        return np.zeros((0, 2)) if self.sensors is None else self.sensors.sensor_path()

    def placed(self) -> RunData:
        """Return the run with its readings at the posterior means of their poses, for pictures of them."""
        found = self.trajectory
        if found is None:
            return self
        laser = self.laser if self.laser is None or found.laser is None else found.moved(self.laser, found.laser)
        sonar = self.sonar if self.sonar is None or found.sonar is None else found.moved(self.sonar, found.sonar)
        return dataclasses.replace(self, laser=laser, sonar=sonar)

    def laser_model(self) -> LaserModel:
        """Return the sensor that the run took its laser for."""
        kept, laser = self.manifest["configuration"], self.laser
        settings = {name: kept[name] for name in LaserModel.model_fields if name in kept}
        return LaserModel(**settings | ({} if laser is None else {"max_range": laser.max_range}))

    @property
    def name(self) -> str:
        """Name of the run's folder, for messages and titles."""
        return "run" if self.path is None else self.path.resolve().name

    def missing(self, file: str) -> InputError:
        """Return the error that `file` is not in this run."""
        where = file if self.path is None else str(self.path / file)
        return InputError(
            f"{where}: no such file: the run ended before it was written. Resume it with prf sample --resume."
        )


LEAST_DIFFERENCE = 0.2
"""Two chains differ at a cell if their shares of black do by more than this."""
MOST_PLACES = 3


class Agreement(NamedTuple):
    """Where chains agree."""

    # share of the ground that readings saw at which no two chains differ by more than `LEAST_DIFFERENCE`;
    # nan where there is no such ground, or nothing to compare
    seen: float
    unseen: float  # the same of the ground that no reading saw
    # sets of connected cells of seen ground at which chains differ, largest first, at most three: x and y of the cell
    # nearest to the middle in metres, area in square metres, largest difference of shares of black
    places: list[tuple[float, float, float, float]]

    def words(self) -> str:
        """Return the share of seen ground on which chains agree and where they differ most; empty if not known."""
        if math.isnan(self.seen):
            return ""
        share = f"chains agree on {math.floor(100.0 * self.seen)} % of the seen ground"
        where = ", ".join(f"({x:.1f}, {y:.1f})" for x, y, *_ in self.places)
        return f"{share}; they differ most round {where}" if where else share

    def document(self) -> dict[str, Any]:
        """Return it as JSON; an unknown share is null."""
        shares = {"seen": self.seen, "unseen": self.unseen}
        known = {name: None if math.isnan(share) else round(share, 4) for name, share in shares.items()}
        return {**known, "places": [[round(value, 3) for value in place] for place in self.places]}

    @classmethod
    def of_document(cls, content: Mapping[str, Any]) -> Agreement:
        """Return what :meth:`document` wrote."""
        seen, unseen = (math.nan if content[name] is None else float(content[name]) for name in ("seen", "unseen"))
        return cls(seen, unseen, [tuple(place) for place in content["places"]])


def agreement(
    disagreement: NDArray[np.float32], seen: NDArray[np.bool_], origin: NDArray[np.float64], resolution: float
) -> Agreement:
    """Return where chains agree; `disagreement` (ny, nx), `seen` (ny, nx), `origin` (2,)."""
    known, differs = np.isfinite(disagreement), disagreement > LEAST_DIFFERENCE
    seen_share, unseen_share = (
        float(1.0 - differs[part].mean()) if part.any() else math.nan for part in (known & seen, known & ~seen)
    )
    return Agreement(seen_share, unseen_share, _places(disagreement, differs & seen, origin, resolution))


def _places(
    disagreement: NDArray[np.float32], differs: NDArray[np.bool_], origin: NDArray[np.float64], resolution: float
) -> list[tuple[float, float, float, float]]:
    """Return the largest sets of cells connected along their sides."""
    from scipy import ndimage  # noqa: PLC0415 - a fifth of a second

    label, _ = ndimage.label(differs)
    size = np.bincount(label.ravel())
    largest = 1 + np.argsort(-size[1:], kind="stable")[:MOST_PLACES]
    places = []
    for number in largest.tolist():
        cells = np.argwhere(label == number)
        middle = cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))]
        x, y = origin + (middle[::-1] + 0.5) * resolution
        most = float(disagreement[label == number].max())
        places.append((float(x), float(y), float(size[number] * resolution**2), most))
    return places


Status = Literal["running", "converged", "not converged", "finished", "interrupted"]


class Progress(NamedTuple):
    """State of a run after a round."""

    step: int  # steps that each chain has made
    seconds: float  # since the start of sampling, in this process
    steps_per_second: float  # over all chains
    share: float  # of the goal that is reached, in [0, 1]; of the time limit when agreement is the goal
    diagnoses: dict[str, Diagnosis] | None  # the latest check of agreement
    status: Status  # "running" until the last round


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

    def sees(self, lines: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each line (n, 2, 2), metres, touches ground that was seen."""
        along = lines[:, :1] + np.linspace(0.0, 1.0, 9)[:, None] * (lines[:, 1:] - lines[:, :1])
        return np.asarray(self.seen_at(along.reshape(-1, 2)).reshape(-1, 9).any(axis=1))

    def near_seen(self, lines: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the parts (m, 2, 2) of lines (n, 2, 2), metres, in cells that were seen or have a neighbour that was.

        Lines are cut where one of their half cells begins.
        """
        from scipy import ndimage  # noqa: PLC0415 - a fifth of a second

        known = self._replace(seen=ndimage.binary_dilation(self.seen, np.ones((3, 3))))
        along = lines[:, 1] - lines[:, 0]
        n = np.maximum(1, np.ceil(2.0 * np.hypot(*along.T) / self.resolution)).astype(np.int64)
        line = np.repeat(np.arange(len(lines)), n)
        rank = np.arange(len(line)) - np.repeat(np.cumsum(n) - n, n)
        share = (rank + np.array([[0.0], [0.5], [1.0]])) / n[line]
        begin, middle, end = lines[line, 0] + share[..., None] * along[line]
        kept = np.flatnonzero(known.seen_at(middle))
        goes_on = (np.diff(kept) == 1) & (np.diff(line[kept]) == 0)
        first, last = np.append(True, ~goes_on)[: len(kept)], np.append(~goes_on, True)[: len(kept)]
        return np.stack([begin[kept[first]], end[kept[last]]], axis=1)
