"""What a chain leaves behind: draws, thinned more as they grow in number, and times of the image by epochs."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.image import Image, settle_all
from prf.model.coloring import Coloring
from prf.model.layout import read_coloring
from prf.sampler.poses import PoseTurns

FIRST_THIN = 2000
"""Steps between two draws at the start."""
MOST_DRAWS = 1024
"""Draws a chain keeps at most; on reaching it, every other is dropped and the spacing doubles."""
FIRST_EPOCH = FIRST_THIN
"""Steps before the first epoch of the image begins; each begins at twice the step of the one before."""

FUNCTIONALS = ("n_edges", "total_length", "log_prior", "log_likelihood", "log_posterior")
EDGES_ANYWHERE = ("n_edges", "total_length", "log_prior")
"""Those that count edges wherever they are, most of them where no reading saw the ground."""


@dataclasses.dataclass(frozen=True)
class Draw:
    """One recorded state of a chain."""

    step: int
    coloring: Coloring
    functionals: NDArray[np.float64]
    probe_black: NDArray[np.bool_]  # (n_probes,)
    poses: NDArray[np.float32] | None = None  # (n_poses, 3) less the given ones; None where poses are certain


def functionals(chain: Chain, log_pose_prior: float = 0.0) -> NDArray[np.float64]:
    """Return the values (len(FUNCTIONALS),) of the present state of a chain."""
    counts, sums = chain.graph.counts, chain.graph.sums
    log_posterior = sums[c.LOG_PRIOR] + sums[c.LOG_LIKELIHOOD] + log_pose_prior
    return np.array(
        [counts[c.EDGES], sums[c.TOTAL_LENGTH], sums[c.LOG_PRIOR], sums[c.LOG_LIKELIHOOD], log_posterior], np.float64
    )


class Record:
    """Draws of one chain, with the best map that it met at a draw; `probes` (n_probes,)."""

    def __init__(self, probes: NDArray[np.int64]) -> None:
        self.probes = probes
        self.thin = FIRST_THIN
        self.draws: list[Draw] = []
        self.best: Draw | None = None

    def take(self, chain: Chain, poses: PoseTurns | None = None) -> None:
        """Record the chain's state if its step is one of those to record."""
        step = int(chain.graph.counts[c.STEP])
        if self.is_due(step):
            black = chain.image.black[self.probes].astype(np.bool_)
            values = functionals(chain, 0.0 if poses is None else poses.log_prior)
            self.add(Draw(step, read_coloring(chain.graph), values, black, None if poses is None else poses.offsets()))

    def is_due(self, step: int) -> bool:
        """Return whether the state at `step` is one to record."""
        return step % self.thin == 0

    def add(self, draw: Draw) -> None:
        """Keep a draw; thin all when they are too many."""
        if self.best is None or draw.functionals[-1] > self.best.functionals[-1]:
            self.best = draw
        self.draws.append(draw)
        if len(self.draws) >= MOST_DRAWS:
            self.thin *= 2
            self.draws = [kept for kept in self.draws if kept.step % self.thin == 0]

    def since(self, step: int) -> list[Draw]:
        """Return the draws after `step`."""
        return [draw for draw in self.draws if draw.step > step]


class ImageTimes:
    """Black and mixed times of the pixels in the present epoch and in the one before.

    What has been averaged since the start of an epoch cannot be taken back; with epochs that begin at steps
    ``FIRST_EPOCH * 2**k``, the present one and the one before always leave out a burn-in of a quarter to a half of
    the run, whenever it stops, and the image is the same whether or not the run was interrupted on the way.
    """

    def __init__(self, n_pixels: int) -> None:
        self.start = 0
        self.previous_start = 0
        self.previous_black = np.zeros(n_pixels, np.int64)
        self.previous_mixed = np.zeros(n_pixels, np.int64)

    @property
    def next_start(self) -> int:
        """Step at which the next epoch begins."""
        return max(FIRST_EPOCH, 2 * self.start)

    def rotate(self, image: Image, step: int) -> None:
        """Begin a new epoch at `step`."""
        settle_all(image, step)
        self.previous_black = image.black_time.copy()
        self.previous_mixed = image.mixed_time.copy()
        image.black_time[:] = 0
        image.mixed_time[:] = 0
        self.previous_start, self.start = self.start, step

    def forget(self, image: Image, step: int) -> None:
        """Let all times up to `step` count no more."""
        settle_all(image, step)
        for times in (self.previous_black, self.previous_mixed, image.black_time, image.mixed_time):
            times[:] = 0

    def total(self, image: Image, step: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return black and mixed time of every pixel since the burn-in ended, in steps."""
        settle_all(image, step)
        return self.previous_black + image.black_time, self.previous_mixed + image.mixed_time


def burn_in(step: int) -> int:
    """Return the burn-in of a run at `step`: a quarter to a half of it, 0 in the first two epochs."""
    if step < 2 * FIRST_EPOCH:
        return 0
    return int(FIRST_EPOCH * 2 ** (int(np.log2(step // FIRST_EPOCH)) - 1))
