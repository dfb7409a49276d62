"""Several chains of one target side by side: what they do together, pooled estimates, agreement."""

from __future__ import annotations

import copy
import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Start
from prf.kernels import constants as c
from prf.kernels.poses.state import POSE_MOVES
from prf.model.coloring import Draws
from prf.model.layout import image_grid, pixel_centres
from prf.model.walls import WallDraws, moves_of, walls_of
from prf.poses.body import BODY, apart
from prf.poses.posterior import Trajectory, pose_functionals
from prf.results import PosteriorImage
from prf.results.convergence import Diagnosis, diagnose, disagree
from prf.sampler.aims import aim, is_aimed
from prf.sampler.chain import DIRECTIONS, EDGES_ANYWHERE, FUNCTIONALS, ChainRun, Draw, burn_in, named_values
from prf.sampler.continued import Earlier
from prf.sampler.poses import start_apart
from prf.sampler.schedules import LadderPlan
from prf.sampler.target import Target, copied, run_chain
from prf.sampler.tiles.rounds import make_tile_data
from prf.sampler.tiles.schedule import Tiles

logger = logging.getLogger(__name__)

FIRST_LOOK = 640_000
"""Steps before it is first looked whether chains disagree and are to be tempered; a multiple of every block length."""
PROBE_BLOCKS = 4
"""Blocks along each axis of the window; the colour of one or two probe points is followed in each."""


class Sample(NamedTuple):
    """Draws of all chains after burn-in, chain by chain."""

    draws: Draws
    walls: WallDraws | None  # of maps of walls, whose draws are the regions that they cover
    chain: NDArray[np.int32]  # (n,)
    step: NDArray[np.int64]  # (n,)
    functionals: dict[str, NDArray[np.float64]]  # (n,)
    probe_black: NDArray[np.bool_]  # (n, n_probes)


class Ensemble:
    """Chains of one target that advance in step, one a generator.

    Chains start alike, or each from its map of an `earlier` run. With a `plan` every chain has a temperature ladder,
    from the start or once chains disagree. In `threads` poses to start from are drawn, and the tiles of all chains
    worked.
    """

    def __init__(
        self,
        target: Target,
        generators: list[np.random.Generator],
        plan: LadderPlan | None = None,
        starts_from: Start = "empty",
        threads: int = 1,
        is_cooled: bool = False,
        earlier: Sequence[Earlier] = (),
    ) -> None:
        self.target = target
        self.probe_pixels = probe_pixels(target)
        self.chains: list[ChainRun] = []
        for i, rng in enumerate(generators):
            like = self.chains[0].chain if self.chains else None
            own = earlier[i] if earlier else None
            self.chains.append(ChainRun(target, rng, self.probe_pixels, None, starts_from, like, is_cooled, own))
        start_apart([chain.poses for chain in self.chains if chain.poses is not None], generators, threads)
        self._awaited = plan if plan is not None and plan.temperatures > 1 else None
        self._blocks = 0  # whole blocks of steps at the start of the round
        if self._awaited is not None and not self._awaited.waits:
            self.temper()
        if target.execution.tiles:
            data, pool = make_tile_data(target), ThreadPoolExecutor(threads) if threads > 1 else None
            for chain in self.chains:
                chain.schedule = Tiles(data, chain.record, pool)

    @property
    def step(self) -> int:
        """Steps that each chain has made."""
        return self.chains[0].step

    @property
    def burn_in(self) -> int:
        """Steps at the start of each chain that are left out."""
        return self.chains[0].burn_in

    @property
    def n_temperatures(self) -> int:
        """Chains of each temperature ladder; 1 without parallel tempering."""
        ladder = self.chains[0].ladder
        return 1 if ladder is None else len(ladder.powers)

    @property
    def block(self) -> int:
        """Steps of one round, of the longest where their number grows."""
        schedule = self.chains[0].schedule
        return schedule.longest if isinstance(schedule, Tiles) else self.chains[0].block

    @property
    def next_steps(self) -> int:
        """Steps of the next round."""
        first = self.chains[0]
        return first.schedule.round_length(first.step, first.block)

    @property
    def probe_xy(self) -> NDArray[np.float64]:
        """Points (n_probes, 2) in metres whose colour is followed."""
        return _centres(self.target)[self.probe_pixels]

    def compile(self) -> None:
        """Have the kernels compiled, or read from their cache, without a step; those of tiles come later."""
        first = copied(self.chains[0].chain), self.chains[0].rng
        run_chain(*first, self.step)
        if self.chains[0].poses is not None:
            poses = copy.copy(self.chains[0].poses)
            poses.state = copied(poses.state)
            poses.measure(poses.move(*first, self.step))

    def begin_round(self) -> None:
        """Before a round: temper chains that disagree, if planned."""
        if self._awaited is not None and is_look(self.step) and self.disagree():
            self.temper()
            logger.info(f"the chains disagree: {self.n_temperatures} temperatures each from step {self.step:,} on")
        self._blocks = self.step // self.chains[0].block

    def end_round(self, chains: list[ChainRun]) -> None:
        """Take the chains that have made a round; after a power of two of blocks, tune their proposals alike."""
        self.chains = chains
        if is_aimed(self._blocks, self.step // self.chains[0].block):
            aim(self.chains)
            for chain in self.chains:
                if chain.poses is not None:
                    chain.poses.measure(chain.chain)

    def temper(self) -> None:
        """Put the planned temperature ladder on every chain; burn-in starts again. Without effect if it is there."""
        if self._awaited is not None:
            for chain in self.chains:
                chain.temper(self._awaited)
        self._awaited = None

    def disagree(self) -> bool:
        """Return whether chains disagree and came no nearer since half of the steps."""
        return disagree(list(self.diagnose_half().values()), list(self.diagnose().values()))

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
        named: dict[str, NDArray[Any]] = dict(named_values(values, self.target))
        named |= {name: colours[:, :, i] for i, name in enumerate(self._probe_names)}
        named |= self._pose_values(recorded)
        return diagnose(named, unseen=self.unseen)

    def _pose_values(self, recorded: list[list[Draw]]) -> dict[str, NDArray[Any]]:
        """Return what is followed of uncertain poses, each (n_chains, n_draws); nothing of certain ones."""
        if self.target.poses is None:
            return {}
        given, first = self.target.poses.prior.given, int(self.target.poses.scan[0] == BODY)
        offsets = np.array([[draw.poses for draw in draws] for draws in recorded], np.float32)
        poses = given + offsets.reshape(*offsets.shape[:2], *given.shape)
        return pose_functionals(poses[..., first:, :], given[first:])

    @cached_property
    def _probe_names(self) -> list[str]:
        """Names of the colours that are followed."""
        return [f"colour at ({x:.2f}, {y:.2f})" for x, y in self.probe_xy]

    @cached_property
    def unseen(self) -> frozenset[str]:
        """Functionals left to the prior, all or in part: colours of unseen probes, and what counts edges anywhere."""
        seen = seen_pixels(self.target)
        if seen[self._pixels_inside].all():
            return frozenset()
        probes = zip(self._probe_names, seen[self.probe_pixels].tolist(), strict=True)
        return frozenset({*EDGES_ANYWHERE, *(name for name, is_seen in probes if not is_seen)})

    def trajectory(self) -> Trajectory | None:
        """Return the poses of all draws after burn-in; None where poses are certain."""
        model = self.target.poses
        if model is None:
            return None
        recorded = self.recorded()
        flat = [draw.poses for draws in recorded for draw in draws]
        offsets = np.array(flat, np.float32).reshape(len(flat), len(model.scan), 3)
        laser, sonar = (None if part is None else part.owner for part in (model.laser, model.sonar))
        known = (model.prior, model.disputed)
        return apart(
            Trajectory(model.scan, model.time, model.prior.given, offsets, laser, sonar, _chains_of(recorded), *known)
        )

    def sample(self) -> Sample:
        """Return the draws of all chains after burn-in."""
        recorded = self.recorded()
        flat = [draw for draws in recorded for draw in draws]
        colours = np.array([draw.probe_black for draw in flat], np.bool_)
        values = np.array([draw.functionals for draw in flat]).reshape(len(flat), len(DIRECTIONS) + len(FUNCTIONALS))
        has_walls = self.target.walls is not None
        maps = [draw.region if has_walls else draw.coloring for draw in flat]
        return Sample(
            draws=Draws.from_colorings(maps, self.target.window),
            walls=WallDraws.of([walls_of(draw.coloring) for draw in flat]) if has_walls else None,
            chain=_chains_of(recorded),
            step=np.array([draw.step for draw in flat], np.int64),
            functionals=named_values(values, self.target),
            probe_black=colours.reshape(len(flat), len(self.probe_pixels)),
        )

    def occupancy(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the shares of steps after burn-in, over all chains, in which each pixel is black and is mixed.

        Two arrays (ny, nx), the lowest row first; nan where the centre of a pixel lies outside the window, and
        everywhere before the first step after burn-in.
        """
        black, mixed = (np.array(times).sum(axis=0) for times in zip(*self._times(), strict=True))
        steps = self.step - self.burn_in
        return self._shares(black, steps * len(self.chains)), self._shares(mixed, steps * len(self.chains))

    def disagreement(self) -> NDArray[np.float32]:
        """Return the largest difference (ny, nx) between the shares of black of any two chains.

        nan as in :meth:`occupancy`, and everywhere of one chain.
        """
        black = np.array([black for black, _ in self._times()])
        return self._shares(np.ptp(black, axis=0), self.step - self.burn_in if len(black) > 1 else 0)

    def image(self) -> PosteriorImage:
        """Return the occupancy image of all chains."""
        grid = self.chains[0].chain.image.grid
        occupancy, squares = self.occupancy()
        seen = seen_pixels(self.target).reshape(grid.ny, grid.nx)
        origin = np.array([grid.x0, grid.y0])
        return PosteriorImage(occupancy, squares, origin, grid.cell, seen, self.disagreement())

    def _times(self) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Return the black and mixed times of the pixels of each chain, in steps."""
        return [chain.record.times(chain.chain.image, self.step) for chain in self.chains]

    def _shares(self, times: NDArray[np.int64], steps: int) -> NDArray[np.float32]:
        """Return times (n_pixels,) as shares of `steps` (ny, nx), nan outside the window or of no steps."""
        grid = self.chains[0].chain.image.grid
        known = self._pixels_inside & (steps > 0)
        return np.where(known, times / max(steps, 1), np.nan).astype(np.float32).reshape(grid.ny, grid.nx)

    @cached_property
    def _pixels_inside(self) -> NDArray[np.bool_]:
        """Which pixels of the image have their centre in the window."""
        return self.target.window.contains(pixel_centres(self.chains[0].chain.image.grid))

    def best(self) -> Draw | None:
        """Return the recorded map of highest log posterior of all chains."""
        best = [chain.record.best for chain in self.chains if chain.record.best is not None]
        return max(best, key=lambda draw: draw.functionals[-1], default=None)

    def outcomes(self) -> NDArray[np.int64]:
        """Return (n_moves, 3) counts over all chains: proposed, valid, accepted."""
        total: NDArray[np.int64] = np.sum([chain.chain.outcomes for chain in self.chains], axis=0)
        return total

    def named_outcomes(self) -> dict[str, NDArray[np.int64]]:
        """Return the counts (3,) of each move by its name, those of poses among them where these are uncertain."""
        found = {name: counts for (name, _), counts in zip(moves_of(self.target.walls), self.outcomes(), strict=True)}
        turns = [chain.poses for chain in self.chains if chain.poses is not None]
        if turns:
            total = np.sum([turn.state.outcomes for turn in turns], axis=0)
            found |= dict(zip(POSE_MOVES, total, strict=True))
        return found

    def swaps(self) -> list[dict[str, Any]]:
        """Return the report of the temperature ladder of each chain; empty without parallel tempering."""
        return [chain.ladder.report() for chain in self.chains if chain.ladder is not None]

    def log_posterior(self) -> float:
        """Return the mean log posterior of the present maps, up to a constant."""
        sums = [chain.chain.graph.sums for chain in self.chains]
        return float(np.mean([s[c.LOG_PRIOR] + s[c.LOG_LIKELIHOOD] for s in sums]))


def _chains_of(recorded: list[list[Draw]]) -> NDArray[np.int32]:
    """Return the number of the chain of each draw."""
    return np.repeat(np.arange(len(recorded), dtype=np.int32), [len(draws) for draws in recorded])


def is_look(step: int) -> bool:
    """Return whether chains that wait for tempering are looked at: at the first look, and at every doubling of it."""
    doublings, rest = divmod(step, FIRST_LOOK)
    return rest == 0 and doublings.bit_count() == 1


def probe_pixels(target: Target) -> NDArray[np.int64]:
    """Return pixels: of each block of a 4 x 4 division of the window the seen and the unseen one next to its middle."""
    centres, seen = _centres(target), seen_pixels(target)
    inside, window = target.window.contains(centres), target.window
    place = PROBE_BLOCKS * (centres - window[:2]) / (window.width, window.height)
    block = np.clip(np.floor(place), 0, PROBE_BLOCKS - 1)
    metres = np.hypot(*((place - block - 0.5) * (window.width, window.height)).T)
    kind = (block @ (1, PROBE_BLOCKS)) * 2 + ~seen
    order = np.lexsort((metres, kind))
    order = order[inside[order]]
    _, first = np.unique(kind[order], return_index=True)
    return np.sort(order[first])


def seen_pixels(target: Target) -> NDArray[np.bool_]:
    """Return which pixels (n_pixels,) of the image readings saw, row by row from the lowest."""
    return np.ones(len(_centres(target)), np.bool_) if target.seen is None else target.seen.ravel()


def _centres(target: Target) -> NDArray[np.float64]:
    if target.execution.resolution is None:
        return np.zeros((0, 2))
    return pixel_centres(image_grid(target.window, target.execution.resolution))
