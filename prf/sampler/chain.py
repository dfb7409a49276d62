"""One chain: its state, how it is driven, and what it leaves behind.

Draws are thinned more as they grow in number; times of the image are kept by epochs.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Start
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.kernels.state.image import Image, settle_all
from prf.model.coloring import Coloring
from prf.model.layout import make_image, read_coloring
from prf.model.orientation import unwrapped
from prf.model.walls import cover, has_walls, united
from prf.sampler.aims import even_shares, set_shares, unexplained
from prf.sampler.continued import Earlier, continued_map
from prf.sampler.directions import redraw_directions, redraw_wall_laws
from prf.sampler.poses import PoseTurns
from prf.sampler.schedules import Ladder, LadderPlan, Plain, Regions, has_regions
from prf.sampler.starts import find_start_map, prior_ground
from prf.sampler.target import Target, copied, make_chain, one_colour_map, with_map

FIRST_THIN = 2000
"""Steps between two draws at the start."""
MOST_DRAWS = 1024
"""Draws a chain keeps at most; on reaching it, every other is dropped and the spacing doubles."""
FIRST_EPOCH = FIRST_THIN
"""Steps before the first epoch of the image begins; each begins at twice the step of the one before."""
SHORTEST_BLOCK = 5 * FIRST_THIN
LONGEST_BLOCK = 4 * SHORTEST_BLOCK
"""A round must not keep Ctrl-C, the clock and the progress waiting for long."""
BLOCKS_PER_GROUND = 8
"""Blocks between two redraws of ground that no reading concerns: finding it takes as long as thousands of steps."""
PROPOSALS_PER_LOOK = 50_000
"""Proposals of the draw of the prior between two looks at whether it is to stop."""

FUNCTIONALS = ("n_edges", "total_length", "log_prior", "log_likelihood", "log_posterior")
DIRECTIONS = ("orientation", "orientation_angle")
"""Kept beside them where they are sampled; before them in a draw."""
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

    @cached_property
    def region(self) -> Coloring:
        """Where a map of walls is black, as a valid map."""
        return united(self.coloring)


def functionals(chain: Chain, log_pose_prior: float = 0.0) -> NDArray[np.float64]:
    """Return the values of the present state of a chain: of :data:`DIRECTIONS`, then of :data:`FUNCTIONALS`."""
    counts, sums = chain.graph.counts, chain.graph.sums
    log_posterior = sums[c.LOG_PRIOR] + sums[c.LOG_LIKELIHOOD] + log_pose_prior
    likely = sums[c.LOG_PRIOR], sums[c.LOG_LIKELIHOOD], log_posterior
    directions = chain.lines[c.ORIENTATION], chain.lines[c.ANGLE]
    return np.array([*directions, counts[c.EDGES], sums[c.TOTAL_LENGTH], *likely], np.float64)


def named_values(values: NDArray[np.float64], target: Target) -> dict[str, NDArray[np.float64]]:
    """Return the values of draws (..., n) by name."""
    named = dict(zip((*DIRECTIONS, *FUNCTIONALS), np.moveaxis(values, -1, 0).copy(), strict=True))
    if not target.orientation.is_sampled:
        return {name: named[name] for name in FUNCTIONALS}
    return named | {"orientation_angle": unwrapped(named["orientation_angle"])}


def burn_in(step: int) -> int:
    """Return the burn-in of a run at `step`: a quarter to a half of it, 0 in the first two epochs."""
    if step < 2 * FIRST_EPOCH:
        return 0
    return int(FIRST_EPOCH * 2 ** (int(np.log2(step // FIRST_EPOCH)) - 1))


def block_length(n_readings: int) -> int:
    """Return the steps after which sums and lists are recomputed.

    That costs time in proportion to the readings, so the steps grow with them; they depend on nothing else, because
    they decide the order of floating-point sums.
    """
    length = SHORTEST_BLOCK
    while length < min(n_readings, LONGEST_BLOCK):
        length *= 2
    return length


class Record:
    """Draws of one chain, the best of them, and times of the pixels of its image in two epochs.

    `probes` (n_probes,) are pixels whose colour is kept with every draw.

    What has been averaged since the start of an epoch cannot be taken back; with epochs that begin at steps
    ``FIRST_EPOCH * 2**k``, the present one and the one before always leave out a burn-in of a quarter to a half of
    the run, whenever it stops, and the image is the same whether or not the run was interrupted on the way.
    """

    def __init__(self, probes: NDArray[np.int64], n_pixels: int = 0) -> None:
        self.probes = probes
        self.thin = FIRST_THIN
        self.draws: list[Draw] = []
        self.best: Draw | None = None
        self.start = 0
        self.previous_start = 0
        self.previous_black = np.zeros(n_pixels, np.int64)
        self.previous_mixed = np.zeros(n_pixels, np.int64)

    @property
    def next_start(self) -> int:
        """Step at which the next epoch begins."""
        return max(FIRST_EPOCH, 2 * self.start)

    def next_stop(self, step: int) -> int:
        """Return the next step after `step` at which there is something to record."""
        return min(self.next_start, step - step % self.thin + self.thin)

    def take(self, chain: Chain, poses: PoseTurns | None = None) -> None:
        """Record the chain's state if its step is one of those to record."""
        step = int(chain.graph.counts[c.STEP])
        if step == self.next_start:
            self.rotate(chain.image, step)
        if self.is_due(step):
            black = chain.image.black[self.probes].astype(np.bool_)
            values = functionals(chain, 0.0 if poses is None else poses.log_prior)
            self.add(Draw(step, read_coloring(chain.graph), values, black, None if poses is None else poses.offsets()))

    def is_due(self, step: int) -> bool:
        """Return whether the state at `step` is a draw; the one before the first step is none."""
        return step > 0 and step % self.thin == 0

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

    def times(self, image: Image, step: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return black and mixed time of every pixel since the burn-in ended, in steps."""
        settle_all(image, step)
        return self.previous_black + image.black_time, self.previous_mixed + image.mixed_time


def line_score(chain: Chain) -> float:
    """Return log prior and log likelihood of a map as a density over its lines, nats (:mod:`prf.sampler.anneal`)."""
    graph = chain.graph
    if has_walls(chain):
        return float(graph.sums[c.LOG_PRIOR] + graph.sums[c.LOG_LIKELIHOOD])
    edges, *vertices = (
        graph.members[kind, : graph.counts[kind]] for kind in (c.EDGES, c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES)
    )
    # From vertices to lines: the factors 1/|e| and sin(phi) are left out.
    measure = np.log(graph.edge_length[edges]).sum() - sum(np.log(graph.vertex_sine[v]).sum() for v in vertices)
    return float(graph.sums[c.LOG_PRIOR] + measure + graph.sums[c.LOG_LIKELIHOOD])


class BestMap(Record):
    """The map of highest density over its lines (:mod:`prf.sampler.anneal`) among the draws, none of which is kept."""

    def next_stop(self, step: int) -> int:
        """Return the next step after `step` at which there is something to record; there are no epochs to begin."""
        return step - step % self.thin + self.thin

    def take(self, chain: Chain, poses: PoseTurns | None = None) -> None:
        """Keep the present map if it is the best."""
        graph, score = chain.graph, np.array([line_score(chain)])
        if self.best is None or score[0] > self.best.functionals[0]:
            self.best = Draw(int(graph.counts[c.STEP]), read_coloring(graph), score, np.zeros(0, np.bool_))


class ChainRun:
    """A chain under way: its state, its generator, its schedule and what it has recorded.

    It starts from the map `start`, in which every sensor is in white, or from a map of one colour (as in the paper),
    which :meth:`find_start` may leave for a better one, or for that of an `earlier` run. `like` is another chain of the
    same target at its start, to be copied. One that is cooled keeps its best map alone, and never draws ground that no
    reading concerns from the prior (:mod:`prf.sampler.starts`).
    """

    def __init__(
        self,
        target: Target,
        rng: np.random.Generator,
        probes: NDArray[np.int64],
        start: Coloring | None = None,
        starts_from: Start = "empty",
        like: Chain | None = None,
        is_cooled: bool = False,
        earlier: Earlier | None = None,
    ) -> None:
        self.target, self.rng, self.starts_from, self.earlier = target, rng, starts_from, earlier
        fresh = one_colour_map(target) if start is None else start
        self.chain: Chain = make_chain(target, fresh) if like is None else copied(like)
        self.record = (BestMap if is_cooled else Record)(probes, self.chain.image.black.size)
        self.block = block_length(len(self.chain.beams.ray) + len(self.chain.cones.pose))
        self.recorded_from = 0
        self.ground = None if is_cooled else prior_ground(target, self.chain)
        self.n_unexplained = np.zeros(len(self.chain.beams.ray))  # looks at which a return was left unexplained
        self.n_looks = 0.0
        goes_on = target.tuning.first_new_log > 0
        if goes_on and len(self.chain.targets.cell) > 0:
            set_shares([self], even_shares(target, self.chain))
        self.schedule: Plain = Regions(self.chain, goes_on) if has_regions(target, self.chain) else Plain()
        if target.poses is not None:
            self.schedule = PoseTurns(target, self.chain, self.schedule)

    @property
    def step(self) -> int:
        """Steps made."""
        return int(self.chain.graph.counts[c.STEP])

    @property
    def burn_in(self) -> int:
        """Steps at the start that are left out."""
        return max(burn_in(self.step), self.recorded_from)

    @property
    def poses(self) -> PoseTurns | None:
        """The schedule if poses are uncertain."""
        return self.schedule if isinstance(self.schedule, PoseTurns) else None

    @property
    def ladder(self) -> Ladder | None:
        """The schedule if the chain is tempered."""
        return self.schedule if isinstance(self.schedule, Ladder) else None

    def temper(self, plan: LadderPlan) -> None:
        """Put a temperature ladder on this chain; rounds are then the shortest, since every hot chain makes one.

        What was recorded before counts no more.
        """
        self.schedule = Ladder(self.target, self.chain, self.rng, plan)
        self.block = SHORTEST_BLOCK
        self.forget()

    def forget(self) -> None:
        """Let the burn-in end here at the earliest."""
        self.recorded_from = self.step
        self.record.forget(self.chain.image, self.step)

    def advance(self) -> Self:
        """Make one round, recording on the way; at its end the state is a function of map and impacts alone."""
        if self.schedule.adapt(self.step):
            self.forget()
        begun = self.step
        end = begun + self.schedule.round_length(begun, self.block)
        while self.step < end:
            move, until = self.schedule.turn(self.step, min(end, self.record.next_stop(self.step)), end)
            self.chain = move(self.chain, self.rng, until)
            if self.target.walls is not None:
                redraw_wall_laws(self.chain, self.target.walls, self.target.orientation, self.rng)
            else:
                redraw_directions(self.chain, self.target.orientation, self.rng)
            self.record.take(self.chain, self.poses)
        period = BLOCKS_PER_GROUND * self.block
        due = self.step // period - begun // period
        if due:
            self.redraw_ground(due * period)
        self.settle()
        return self

    def redraw_ground(self, steps: int) -> None:
        """Redraw ground that no reading concerns, in proportion to `steps`; :meth:`settle` afterwards."""
        if self.ground is not None:
            guards = self.ground.closed(self.chain)
            self.chain = self.ground.refresh(self.chain, guards, self.rng, self.ground.proposals(steps))

    def settle(self) -> None:
        """Recompute sums and lists, and look which returns no edge explains, as at the end of every round."""
        if self.ground is not None:
            self.chain = self.ground.settle(self.chain)
        recompute_sums(self.chain)
        self.n_unexplained += unexplained(self.chain)
        self.n_looks += 1.0
        self.schedule.settle()

    def find_start(self, latest: float, stop_requested: Callable[[], bool]) -> Self:
        """Before the first step: take the map, and the poses, that the chain shall start from.

        `latest`: when the search ends, by the clock that all chains share, also on other machines (``time.time``).
        """

        def is_over() -> bool:
            return stop_requested() or time.time() > latest

        if self.poses is not None:
            self.chain = self.poses.start(self.chain)
        if self.earlier is not None or self.starts_from != "empty":
            if self.earlier is not None:
                start = continued_map(self.earlier, self.target)
            else:
                start = find_start_map(self.starts_from, self.target, self.rng, is_over)
            chain = with_map(self.chain, self.target, start)
            if chain.graph.counts[c.OCCUPIED] > 0:
                start = one_colour_map(self.target)
                chain = with_map(self.chain, self.target, start)
            self.chain = chain._replace(image=make_image(start, chain.graph, self.target.execution.resolution))
            cover(self.chain)
        if self.ground is not None:
            guards = self.ground.closed(self.chain)
            for _ in range(0, self.ground.first_proposals, PROPOSALS_PER_LOOK):
                if is_over():
                    break
                self.chain = self.ground.refresh(self.chain, guards, self.rng, PROPOSALS_PER_LOOK)
            self.settle()
        self.schedule.begin(self.chain)
        self.record.take(self.chain, self.poses)
        return self
