"""`Run`: draws of the posterior, and the answers that they give."""

from __future__ import annotations

import dataclasses
import io
import os
from collections.abc import Collection, Sequence
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar, overload

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from prf import run as stored
from prf.api.arrays import as_paths, checked
from prf.coloring import occupied_polygons
from prf.estimate import occupied_estimates, occupied_probability, path_estimates, path_free
from prf.render import render_posterior
from prf.run import PosteriorImage, names, read_run, write_run
from prf.run.read import PARTS
from prf.sampler.drive import Progress
from prf.sampler.output import make_way
from prf.shell.files import refuse_standing
from prf.shell.lock import exclusive
from prf.shell.notebook import card
from prf.uncertainty import Estimates, by_chain, smallest_ess

Part = TypeVar("Part")


class PointEstimates(NamedTuple):
    """Probabilities that points are occupied, how far they are known, and whether the points were seen.

    Attributes
    ----------
    probability, low, high, ess, rhat : (n,) float64
        As :class:`prf.uncertainty.Estimates` has them.
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
class Run(stored.Run):
    """A run of the sampler: draws from the posterior over maps, and what they answer.

    Attributes
    ----------
    manifest, draws, chain, step, functionals, image, best, diagnostics, ...
        As :class:`prf.run.Run` has them.
    progress : Progress or None
        How the sampling of this call ended; None of a run that was read.
    """

    progress: Progress | None = None

    @classmethod
    def of(cls, run: stored.Run, progress: Progress | None = None) -> Run:
        """Return the run with its answers."""
        parts = {field.name: getattr(run, field.name) for field in dataclasses.fields(stored.Run)}
        return cls(**parts, progress=progress)

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
        xy = checked("points", points, (None, 2))
        if not interval:
            return occupied_probability(self.draws, xy, square)
        found = occupied_estimates(self.draws, self.chain, xy, square, self._smallest_ess)
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
        if interval:
            return path_estimates(self.draws, self.chain, as_paths(paths), radius, self._smallest_ess)
        return np.array([path_free(self.draws, path, radius).p_free for path in as_paths(paths)], np.float64)

    @property
    def best_map(self) -> shapely.MultiPolygon:
        """The occupied area of the most probable map that was recorded; for a better one: prf anneal."""
        return occupied_polygons(self._part(self.best, names.MAP))

    @property
    def occupancy(self) -> NDArray[np.float32]:
        """How probably the centre of each cell is occupied (ny, nx), row 0 lowest; :attr:`extent` says where."""
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
            Replace what stands there.

        Raises
        ------
        OutputError
            If it stands already, or cannot be written.
        """
        target = Path(folder)
        refuse_standing(target, force)
        with exclusive(target):
            make_way(target)
            write_run(target, self)
            if self.image is not None:
                render_posterior(dataclasses.replace(self, path=target), target / names.PICTURE)

    @cached_property
    def _smallest_ess(self) -> float:
        """Effective sample size that draws which are all equal count for."""
        functionals = np.column_stack([np.empty((len(self.chain), 0)), *self.functionals.values()])
        return smallest_ess(by_chain(self.probe_black, self.chain), by_chain(functionals, self.chain))

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

    @cached_property
    def _picture(self) -> bytes | None:
        if self.image is None:
            return None
        buffer = io.BytesIO()
        render_posterior(self, buffer)
        return buffer.getvalue()

    def _repr_png_(self) -> bytes | None:
        """Return the picture that a notebook shows; None without an image."""
        return self._picture

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows."""
        return card("Posterior over polygonal maps", self._facts(), self._picture)


def open_run(folder: str | os.PathLike[str], parts: Collection[str] = PARTS) -> Run:
    """Return the run in a RUN directory.

    Parameters
    ----------
    folder : path
    parts : collection of str
        Files to read beside manifest and draws.

    Raises
    ------
    InputError
        If it is no RUN directory, or a file that is read is damaged or of an unknown version.
    """
    return Run.of(read_run(folder, parts))
