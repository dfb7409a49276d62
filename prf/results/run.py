"""`Run`: draws of the posterior over maps, what was estimated on the way, and the answers that they give."""

from __future__ import annotations

import dataclasses
import io
import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, overload

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from prf.model.coloring import Coloring, Draws, occupied_polygons
from prf.poses.posterior import Trajectory
from prf.readings import PointTable, Readings
from prf.readings.arrays import as_paths, checked
from prf.results import names
from prf.results.model import PosteriorImage, Progress
from prf.shell.cli.notebook import card
from prf.shell.cli.outputs import exclusive, refuse_existing
from prf.shell.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from prf.results.estimate import Estimates

Part = TypeVar("Part")


class PointEstimates(NamedTuple):
    """Probabilities that points are occupied, how far they are known, and whether the points were seen.

    Attributes
    ----------
    probability, low, high, ess, rhat : (n,) float64
        As :class:`prf.results.estimate.Estimates` has them.
    seen : (n,) bool
        Whether a reading crossed the cell of the image that holds the point, or ended in it.
    """

    probability: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    ess: NDArray[np.float64]
    rhat: NDArray[np.float64]
    seen: NDArray[np.bool_]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run of the sampler: draws from the posterior over maps, and the answers that they give.

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
    trajectory: Trajectory | None = None
    best: Coloring | None = None
    best_log_posterior: float = float("nan")
    diagnostics: dict[str, Any] | None = None
    path: Path | None = None
    progress: Progress | None = None

    @property
    def n_chains(self) -> int:
        """Number of chains that recorded a draw."""
        return len(np.unique(self.chain))

    @cached_property
    def smallest_ess(self) -> float:
        """Effective sample size that draws which are all equal count for."""
        from prf.results.estimate import by_chain, smallest_ess  # noqa: PLC0415

        functionals = np.column_stack([np.empty((len(self.chain), 0)), *self.functionals.values()])
        return smallest_ess(by_chain(self.probe_black, self.chain), by_chain(functionals, self.chain))

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

    def placed(self) -> Run:
        """Return the run with its readings at the posterior means of their poses, for pictures of them."""
        found = self.trajectory
        if found is None:
            return self
        laser = self.laser if self.laser is None or found.laser is None else found.moved(self.laser, found.laser)
        sonar = self.sonar if self.sonar is None or found.sonar is None else found.moved(self.sonar, found.sonar)
        return dataclasses.replace(self, laser=laser, sonar=sonar)

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

    @overload
    def query(
        self, points: ArrayLike, square: float = 0.0, *, interval: Literal[False] = False
    ) -> NDArray[np.float64]: ...

    @overload
    def query(self, points: ArrayLike, square: float = 0.0, *, interval: Literal[True]) -> PointEstimates: ...

    def query(
        self, points: ArrayLike, square: float = 0.0, *, interval: bool = False
    ) -> NDArray[np.float64] | PointEstimates:
        """Return how probably each point is occupied.

        Parameters
        ----------
        points : (n, 2) array
            Metres.
        square : float
            Metres. 0: the share of draws that are black at the point. Else that of draws in which the square of this
            side round the point is not completely white (Paskin & Thrun 2005, section 1.3.3).
        interval : bool
            Bound the Monte Carlo error too (docs/convergence.md).

        Returns
        -------
        (n,) float64, or PointEstimates
            nan outside the window.

        Raises
        ------
        ArgumentError
            If the points are no (n, 2) array of finite numbers.
        InputError
            If there are no draws yet.
        """
        from prf.results.estimate import occupied_estimates, occupied_probability  # noqa: PLC0415 - half a second

        xy = checked("points", points, (None, 2))
        if not interval:
            return occupied_probability(self.draws, xy, square)
        found = occupied_estimates(self.draws, self.chain, xy, square, self.smallest_ess)
        return PointEstimates(*found, self._image.seen_at(xy))

    @overload
    def paths(
        self, paths: ArrayLike | Sequence[ArrayLike], radius: float, *, interval: Literal[False] = False
    ) -> NDArray[np.float64]: ...

    @overload
    def paths(self, paths: ArrayLike | Sequence[ArrayLike], radius: float, *, interval: Literal[True]) -> Estimates: ...

    def paths(
        self, paths: ArrayLike | Sequence[ArrayLike], radius: float, *, interval: bool = False
    ) -> NDArray[np.float64] | Estimates:
        """Return how probably a disc can follow each path: jointly over all of it, map by map.

        Parameters
        ----------
        paths : sequence of (k, 2) arrays
            Corners in metres; one array (k, 2) is one path.
        radius : float
            Of the disc, metres.
        interval : bool
            Bound the Monte Carlo error too (docs/convergence.md).

        Returns
        -------
        (n_paths,) float64, or Estimates
            nan for a path that leaves the window.

        Raises
        ------
        ArgumentError
            If a path is no (k, 2) array of finite numbers.
        InputError
            If there are no draws yet.
        """
        from prf.results.estimate import path_estimates, path_free  # noqa: PLC0415

        if interval:
            return path_estimates(self.draws, self.chain, as_paths(paths), radius, self.smallest_ess)
        return np.array([path_free(self.draws, path, radius) for path in as_paths(paths)], np.float64)

    @property
    def best_map(self) -> shapely.MultiPolygon:
        """The occupied area of the most probable map that was recorded; for a better one: prf anneal."""
        return occupied_polygons(self._part(self.best, names.MAP))

    @property
    def occupancy(self) -> NDArray[np.float32]:
        """How probably the centre of each cell is occupied (ny, nx), row 0 lowest; :attr:`extent` locates it."""
        return self._image.occupancy

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of :attr:`occupancy` in metres, as matplotlib's imshow takes them."""
        return self._image.extent

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the run as prf sample does, for every verb to read; without a checkpoint, so not to be resumed.

        Parameters
        ----------
        folder : path
        force : bool
            Replace what is there.

        Raises
        ------
        OutputError
            If it exists already, or cannot be written.
        """
        from prf.results.write import remove_stale_outputs, write_run  # noqa: PLC0415 - they import this module

        target = Path(folder)
        refuse_existing(target, force, is_folder=True)
        with exclusive(target):
            remove_stale_outputs(target)
            write_run(target, self)
            if self.image is not None:
                dataclasses.replace(self, path=target).draw(target / names.PICTURE)

    def report(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write a report: one page of HTML that opens without a network (docs/report.md).

        Raises
        ------
        InputError
            If there are no draws yet.
        OutputError
            If the file exists and may not be replaced (`force`), or cannot be written.
        """
        from prf.output.report import write_report  # noqa: PLC0415 - it imports this module

        refuse_existing(path, force)
        with exclusive(path):
            write_report(os.fspath(path), self)

    def draw(self, target: Path | IO[bytes]) -> None:
        """Draw the posterior and its best map as PNG: the picture of a RUN."""
        from prf.output.pictures import render_posterior  # noqa: PLC0415 - matplotlib takes a second

        render_posterior(self, target)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the posterior and the edges of its best map into axes of matplotlib, in metres.

        White is free, mid-grey unknown, black occupied, hatched what no reading saw, violet where chains differ.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            New ones unless given.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        InputError
            If the run has no image yet.
        """
        from prf.output.pictures.posterior import plot_posterior  # noqa: PLC0415

        return plot_posterior(self, ax)

    @property
    def _image(self) -> PosteriorImage:
        return self._part(self.image, names.POSTERIOR)

    def _part(self, part: Part | None, file: str) -> Part:
        if part is None:
            raise self.missing(file)
        return part

    def _facts(self) -> dict[str, str]:
        window, diagnosed = self.draws.window, self.diagnostics or {}
        facts = {
            "draws": f"{len(self.draws):,} of {self.n_chains} chains",
            "window": f"{window.width:.4g} x {window.height:.4g} m from ({window.x_min:.4g}, {window.y_min:.4g})",
            "status": str(self.manifest.get("status", "unknown")),
            "agreement": str(diagnosed.get("reason", "unknown")),
            "seed": str(self.manifest.get("seed", "unknown")),
        }
        return facts | ({} if self.path is None else {"folder": str(self.path)})

    def __repr__(self) -> str:
        """Return the run in a line."""
        window = self.draws.window
        status = self.manifest.get("status", "unknown")
        return f"<prf.Run: {len(self.draws):,} draws, window {window.width:.4g} x {window.height:.4g} m, {status}>"

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows."""
        buffer = io.BytesIO()
        if self.image is not None:
            self.draw(buffer)
        return card("Posterior over polygonal maps", self._facts(), buffer.getvalue() or None)
