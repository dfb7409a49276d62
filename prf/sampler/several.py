"""Several chains side by side: rounds in threads, pooled estimates, agreement."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from prf.coloring import Draws
from prf.configuration import Start
from prf.diagnostics import Diagnosis, diagnose
from prf.kernels import constants as c
from prf.layout import image_grid, pixel_centres
from prf.posterior import Settings
from prf.sampler.apart import is_look, stay_apart
from prf.sampler.chain import ChainSampler
from prf.sampler.doubts import aim, is_due
from prf.sampler.probes import probe_pixels, seen_pixels
from prf.sampler.record import EDGES_ANYWHERE, FUNCTIONALS, Draw, burn_in
from prf.sampler.tempering_ladder import LadderPlan, SwapReport
from prf.sampler.tiles import advance_in_tiles, tiled_chains

if TYPE_CHECKING:
    from prf.sampler.distributed import Remote

logger = logging.getLogger(__name__)

MOVE_NAMES = tuple(name for name, _ in c.MOVES)


class Sample(NamedTuple):
    """Draws of all chains after burn-in, chain by chain."""

    draws: Draws
    chain: NDArray[np.int32]  # (n,)
    step: NDArray[np.int64]  # (n,)
    functionals: dict[str, NDArray[np.float64]]  # (n,)
    probe_black: NDArray[np.bool_]  # (n, n_probes)


class Sampler:
    """Chains of one posterior that advance in step."""

    def __init__(
        self,
        settings: Settings,
        generators: list[np.random.Generator],
        threads: int,
        remote: Remote | None = None,
        plan: LadderPlan | None = None,
        starts_from: Start = "empty",
    ) -> None:
        self.settings = settings
        self.probe_pixels = probe_pixels(settings)
        self.chains: list[ChainSampler] = []
        for rng in generators:
            like = self.chains[0].chain if self.chains else None
            self.chains.append(ChainSampler(settings, rng, self.probe_pixels, starts_from=starts_from, like=like))
        self._awaited = plan if plan is not None and plan.rungs > 1 else None
        if self._awaited is not None and not self._awaited.waits:
            self.put_rungs()
        self._remote = remote
        self._tiled = tiled_chains(self.chains)
        self._pool = ThreadPoolExecutor(max(1, threads if self._tiled else min(threads, len(self.chains))))

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the threads go."""
        self._pool.shutdown()
        if self._remote is not None:
            self._remote.close()

    @property
    def step(self) -> int:
        """Steps that each chain has made."""
        return self.chains[0].step

    @property
    def burn_in(self) -> int:
        """Steps at the start of each chain that are left out."""
        return self.chains[0].burn_in

    @property
    def block(self) -> int:
        """Steps of one round."""
        return self._tiled[0].length if self._tiled else self.chains[0].block

    @property
    def next_steps(self) -> int:
        """Steps of the next round."""
        return self._tiled[0].next_length if self._tiled and self._tiled[0].is_due else self.chains[0].block

    @property
    def probe_xy(self) -> NDArray[np.float64]:
        """Points (n_probes, 2) in metres whose colour is followed."""
        assert self.settings.resolution is not None
        return pixel_centres(image_grid(self.settings.window, self.settings.resolution))[self.probe_pixels]

    def compile(self) -> None:
        """Have the kernels compiled, or read from their cache, without making a step."""
        self.chains[0].run_to(self.step)
        if self._tiled:
            self._tiled[0].compile()

    def find_starts(self, stop_requested: Callable[[], bool]) -> None:
        """Before the first step: let every chain find where it starts (:mod:`prf.sampler.starts`)."""
        for future in [self._pool.submit(chain.find_start, stop_requested) for chain in self.chains]:
            future.result()

    def advance(self, blocks: int = 1) -> None:
        """Run one block in every chain, or one round of tiles; on workers of a scheduler so many `blocks` at most.

        Chains that wait for rungs get them first, if they stay apart here.
        """
        if self._awaited is not None and is_look(self.step) and self.stays_apart():
            self.put_rungs()
            logger.info(f"the chains stay apart: {self.chains[0].rungs} rungs each from step {self.step:,} on")
        before = self.step // self.chains[0].block
        self._advance(min(blocks, (1 << before.bit_length()) - before))
        if is_due(before, self.step // self.chains[0].block):
            aim([chain.chain for chain in self.chains], [chain.doubts for chain in self.chains])

    def _advance(self, blocks: int) -> None:
        """Run one block, one round of tiles, or so many `blocks` on workers."""
        if self._tiled and self._tiled[0].is_due:
            advance_in_tiles(self._tiled, self._pool, self._remote)
            return
        latest = self._tiled[0].first if self._tiled else None
        if self._remote is not None:
            self._remote.advance(self.chains, latest, blocks)
            return
        for future in [self._pool.submit(chain.advance, latest) for chain in self.chains]:
            future.result()

    def put_rungs(self) -> None:
        """Put the rungs below every chain that were waited for; burn-in begins anew. Without effect if there are."""
        if self._awaited is None:
            return
        for chain in self.chains:
            chain.temper(self._awaited)
            chain.forget()
        self._awaited = None

    def stays_apart(self) -> bool:
        """Return whether chains disagree and came no nearer since half of the steps (:mod:`prf.sampler.apart`)."""
        return stay_apart(self.diagnose_half().values(), self.diagnose().values())

    def diagnose_half(self) -> dict[str, Diagnosis]:
        """Return what :meth:`diagnose` was after half of the steps."""
        half = self.step // 2
        since = [chain.record.since(burn_in(half)) for chain in self.chains]
        return self.diagnose([[draw for draw in draws if draw.step <= half] for draws in since])

    def climbs(self) -> bool:
        """Return whether the log posterior of every chain is higher in the second half of its draws, on average."""
        values = np.array([[draw.functionals[-1] for draw in draws] for draws in self.recorded()])
        half = values.shape[1] // 2
        return half > 0 and bool((values[:, -half:].mean(axis=1) > values[:, :half].mean(axis=1)).all())

    def recorded(self) -> list[list[Draw]]:
        """Return the draws of each chain after burn-in."""
        return [chain.record.since(self.burn_in) for chain in self.chains]

    def diagnose(self, recorded: list[list[Draw]] | None = None) -> dict[str, Diagnosis]:
        """Return R-hat and ESS of every functional and of the colour at every probe point.

        Of the draws `recorded`, as many from each chain, or of all after burn-in.
        """
        recorded = self.recorded() if recorded is None else recorded
        values = np.array([[draw.functionals for draw in draws] for draws in recorded])
        colours = np.array([[draw.probe_black for draw in draws] for draws in recorded])
        if values.size == 0:
            return diagnose({name: np.zeros((len(recorded), 0)) for name in FUNCTIONALS}, unseen=self.unseen)
        named: dict[str, NDArray[Any]] = {name: values[:, :, i] for i, name in enumerate(FUNCTIONALS)}
        for i, name in enumerate(self._probe_names):
            named[name] = colours[:, :, i]
        return diagnose(named, unseen=self.unseen)

    @cached_property
    def _probe_names(self) -> list[str]:
        """Names of the colours that are followed."""
        return [f"colour at ({x:.2f}, {y:.2f})" for x, y in self.probe_xy]

    @cached_property
    def unseen(self) -> frozenset[str]:
        """Functionals left to the prior, all or in part: colours of unseen probes, and what counts edges anywhere."""
        seen = seen_pixels(self.settings)
        if seen[self._pixels_inside].all():
            return frozenset()
        probes = zip(self._probe_names, seen[self.probe_pixels].tolist(), strict=True)
        return frozenset({*EDGES_ANYWHERE, *(name for name, is_seen in probes if not is_seen)})

    def sample(self) -> Sample:
        """Return the draws of all chains after burn-in."""
        recorded = self.recorded()
        flat = [draw for draws in recorded for draw in draws]
        colours = np.array([draw.probe_black for draw in flat], np.bool_)
        values = np.array([draw.functionals for draw in flat]).reshape(len(flat), len(FUNCTIONALS))
        return Sample(
            draws=Draws.from_colorings([draw.coloring for draw in flat], self.settings.window),
            chain=np.repeat(np.arange(len(recorded), dtype=np.int32), [len(draws) for draws in recorded]),
            step=np.array([draw.step for draw in flat], np.int64),
            functionals={name: values[:, i].copy() for i, name in enumerate(FUNCTIONALS)},
            probe_black=colours.reshape(len(flat), len(self.probe_pixels)),
        )

    def occupancy(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the shares of steps after burn-in, over all chains, in which each pixel is black and is mixed.

        Two arrays (ny, nx), the lowest row first; nan where the centre of a pixel lies outside the window, and
        everywhere before the first step after burn-in.
        """
        totals = [chain.times.total(chain.chain.image, self.step) for chain in self.chains]
        grid = self.chains[0].chain.image.grid
        steps = (self.step - self.burn_in) * len(self.chains)
        inside = self._pixels_inside & (steps > 0)
        shares = []
        for which in range(2):
            share = np.full(grid.nx * grid.ny, np.nan, np.float32)
            share[inside] = sum(total[which][inside] for total in totals) / max(steps, 1)
            shares.append(share.reshape(grid.ny, grid.nx))
        return shares[0], shares[1]

    def disagreement(self) -> NDArray[np.float32]:
        """Return the largest difference (ny, nx) between the shares of black of any two chains.

        nan as in :meth:`occupancy`, and everywhere of one chain.
        """
        grid = self.chains[0].chain.image.grid
        steps = self.step - self.burn_in
        black = np.array([chain.times.total(chain.chain.image, self.step)[0] for chain in self.chains])
        known = self._pixels_inside & (steps > 0) & (len(black) > 1)
        shares = np.where(known, np.ptp(black, axis=0) / max(steps, 1), np.nan)
        return shares.astype(np.float32).reshape(grid.ny, grid.nx)

    @cached_property
    def _pixels_inside(self) -> NDArray[np.bool_]:
        """Which pixels of the image have their centre in the window."""
        return self.settings.window.contains(pixel_centres(self.chains[0].chain.image.grid))

    def best(self) -> Draw | None:
        """Return the recorded map of highest log posterior of all chains."""
        best = [chain.record.best for chain in self.chains if chain.record.best is not None]
        return max(best, key=lambda draw: draw.functionals[-1], default=None)

    def outcomes(self) -> NDArray[np.int64]:
        """Return (n_moves, 3) counts over all chains: proposed, valid, accepted."""
        total: NDArray[np.int64] = np.sum([chain.chain.outcomes for chain in self.chains], axis=0)
        return total

    def swaps(self) -> list[SwapReport]:
        """Return what the ladder of each chain has come to; empty without parallel tempering."""
        return [chain.tempering.report() for chain in self.chains if chain.tempering is not None]

    def log_posterior(self) -> float:
        """Return the mean log posterior of the present maps, up to a constant."""
        sums = [chain.chain.graph.sums for chain in self.chains]
        return float(np.mean([s[c.LOG_PRIOR] + s[c.LOG_LIKELIHOOD] for s in sums]))
