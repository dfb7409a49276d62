"""`Run`: a run of the sampler as people hold it, who ask it, draw it, report on it and save it."""

from __future__ import annotations

import dataclasses
import io
import os
from collections.abc import Collection, Sequence
from functools import cached_property
from pathlib import Path
from typing import IO, TYPE_CHECKING, Literal, TypeVar, overload

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from prf.model.coloring import occupied_polygons
from prf.output.pictures import plot_posterior, render_posterior
from prf.output.report import write_report
from prf.readings.arrays import as_paths, checked
from prf.readings.way import lies_on_way
from prf.results import PosteriorImage, RunData, names
from prf.results.disputes import Dispute, disputes
from prf.results.estimate import (
    NEAR,
    Estimates,
    Obstruction,
    PointEstimates,
    blocking_piece,
    occupied_estimates,
    occupied_probability,
    path_estimates,
    path_free,
)
from prf.results.read import PARTS, read_run_data
from prf.results.write import remove_stale_outputs, write_run
from prf.shell.cli.console import ProgressCallback
from prf.shell.cli.outputs import exclusive, refuse_existing
from prf.shell.cli.pictures import card, counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from prf.results.explore import Exploration
    from prf.results.explore.search import By
    from prf.results.score.returns import Returns

Part = TypeVar("Part")


def read_run(path: str | os.PathLike[str], parts: Collection[str] = PARTS) -> Run:
    """Return the run in the directory `path`.

    `parts`: files to read beside the manifest and the draws (:mod:`prf.results.names`).
    """
    return Run(**vars(read_run_data(path, parts)))


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Run(RunData):
    """A run of the sampler: draws from the posterior over maps, and the answers that they give.

    The attributes are those of :class:`prf.results.RunData`. A run may have been interrupted at any time, so it may
    have no draws; other parts are None where the run wrote none.
    """

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
        (n,) float64, or :class:`prf.results.estimate.PointEstimates`
            nan outside the window.

        Raises
        ------
        ArgumentError
            If the points are not an (n, 2) array of finite numbers.
        InputError
            If there are no draws yet.
        """
        xy = checked("points", points, (None, 2))
        if not interval:
            return occupied_probability(self.draws, xy, square)
        near = self.ess_near(shapely.points(xy), NEAR + 0.5 * square)
        found = occupied_estimates(self.draws, self.chain, xy, square, self.smallest_ess, near)
        return PointEstimates(*found, self._image.seen_at(xy))

    def return_probability(self, points: ArrayLike, square: float = 0.2) -> NDArray[np.float64]:
        """Return how probably a beam that reaches the square round each point ends in it.

        What a robot's sensor will meet: a wall, with the errors of poses and readings, or what no wall explains, as
        often as the run's own readings met it there (docs/scores.md). Without a laser, of which this is not known, it
        is the answer of :meth:`query`.

        Parameters
        ----------
        points : (n, 2) array
            Metres.
        square : float
            Side of the square, metres; 0 stands for 0.2, since no beam ends in a point.

        Returns
        -------
        (n,) float64
            nan outside the window.

        Raises
        ------
        ArgumentError
            If the points are not an (n, 2) array of finite numbers.
        InputError
            If there are no draws yet.
        """
        from prf.results.score.returns import return_probability  # noqa: PLC0415 - scores are not for every run

        return return_probability(self.draws, self._returns, checked("points", points, (None, 2)), square)

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
            If a path is not a (k, 2) array of finite numbers.
        InputError
            If there are no draws yet.
        """
        asked = as_paths(paths)
        if not interval:
            return np.array([path_free(self.draws, path, radius) for path in asked], np.float64)
        lines = np.array([shapely.LineString(path if len(path) != 1 else [*path, *path]) for path in asked], object)
        near = self.ess_near(lines, NEAR + radius)
        return path_estimates(self.draws, self.chain, asked, radius, self.smallest_ess, near)

    def what_blocks(self, path: ArrayLike, radius: float) -> Obstruction:
        """Return the piece of a path that keeps it from being free, and what stands there.

        Parameters
        ----------
        path : (k, 2) array
            Corners in metres, all inside the window.
        radius : float
            Of the disc that follows it, metres.

        Returns
        -------
        :class:`prf.results.estimate.Obstruction`

        Raises
        ------
        InputError
            If there are no draws yet.
        """
        piece, p_free = blocking_piece(self.draws, path, radius)
        line = shapely.LineString(piece)
        placed = self.placed()
        ends = [part.impacts() for part in (placed.laser, placed.sonar) if part is not None]
        n_returns = sum(int(shapely.dwithin(shapely.points(end), line, radius).sum()) for end in ends)
        return Obstruction(piece, p_free, n_returns, lies_on_way(self.way, piece))

    def disputes(self) -> list[Dispute]:
        """Return where logs contradict each other, the most readings first; nothing with one log (docs/sessions.md).

        Returns
        -------
        list of :class:`prf.results.disputes.Dispute`
        """
        return disputes(self)

    def explore(
        self,
        start: ArrayLike | None = None,
        target: ArrayLike | None = None,
        *,
        radius: float = 0.25,
        by: By = "gain",
        progress: bool | ProgressCallback = True,
    ) -> Exploration:
        """Return where to look next: the places from which one scan is expected to settle most (docs/exploration.md).

        Parameters
        ----------
        start : (2,) array, optional
            Where the robot is, metres; where the sensor was last unless given.
        target : (k, 2) array, optional
            Corners in metres of a path: places from which to learn whether a disc can follow it. If the last corner is
            the first, of a region: places from which to learn of its inside. None: all of the window counts.
        radius : float
            Of the disc that drives and follows the path, metres.
        by : {"gain", "gain-per-metre"}
            What the places are ranked by.
        progress : bool or callable
            As of :func:`prf.sample`.

        Returns
        -------
        :class:`prf.results.explore.Exploration`

        Raises
        ------
        ArgumentError
            If an array has another shape or is not finite.
        InputError
            If there are no draws yet or no readings, the start is not free, no place can be reached, or a corner lies
            outside the window.
        """
        from prf.results.explore import explore  # noqa: PLC0415 - not for every run

        begin = None if start is None else checked("start", start, (2,))
        asked = None if target is None else checked("target", target, (None, 2))
        return explore(self, begin, asked, radius, by, progress=progress)

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
        refuse_existing(path, force)
        with exclusive(path):
            write_report(os.fspath(path), self)

    def draw(self, target: Path | IO[bytes]) -> None:
        """Draw the posterior and its best map as PNG: the picture of a RUN."""
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
        return plot_posterior(self, ax)

    @cached_property
    def _returns(self) -> Returns | None:
        from prf.results.score.returns import returns_of_run  # noqa: PLC0415 - likewise

        return returns_of_run(self)

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
            "draws": f"{len(self.draws):,} of {counted(self.n_chains, 'chain')}",
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
