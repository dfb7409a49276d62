"""One chain: advanced block by block, its draws and its image recorded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Start
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.model.coloring import Coloring
from prf.model.layout import make_image, read_coloring, run_chain
from prf.sampler.chain_map import copied, with_map
from prf.sampler.poses import PoseTurns
from prf.sampler.posterior import Settings, make_chain, one_colour_map
from prf.sampler.prior_ground import PriorGround, prior_ground
from prf.sampler.record import FIRST_THIN, ImageTimes, Record, burn_in
from prf.sampler.starts import find_start_map
from prf.sampler.targets import Doubts, focus_of
from prf.sampler.tempering import LadderPlan, Tempering

SHORTEST_BLOCK = 5 * FIRST_THIN
LONGEST_BLOCK = 4 * SHORTEST_BLOCK
"""A round must not keep Ctrl-C, the clock and the progress waiting for long."""
PROPOSALS_PER_LOOK = 50_000
"""Proposals of the draw of the prior between two looks at whether it is to stop."""

Advance = Callable[[Chain, np.random.Generator, int], Chain]
"""How a chain gets to a step: alone, in regions round targets, or with the chains of a temperature ladder."""


def block_length(n_readings: int) -> int:
    """Return the steps after which sums and lists are recomputed.

    That costs time in proportion to the readings, so the steps grow with them; they depend on nothing else, because
    they decide the order of floating-point sums.
    """
    length = SHORTEST_BLOCK
    while length < min(n_readings, LONGEST_BLOCK):
        length *= 2
    return length


class ChainSampler:
    """A chain, its generator and what it has recorded.

    It starts from the map `start`, in which every sensor is in white, or from a map of one colour (as in the paper),
    which :meth:`find_start` may leave for a better one. `like` is another chain of the same settings at its start, to
    be copied.
    """

    REFRESHES = True
    """Whether ground that no reading concerns is drawn from the prior (:mod:`prf.sampler.prior_ground`)."""

    def __init__(
        self,
        settings: Settings,
        rng: np.random.Generator,
        probes: NDArray[np.int64],
        start: Coloring | None = None,
        starts_from: Start = "empty",
        like: Chain | None = None,
    ) -> None:
        self.settings, self.rng, self.starts_from = settings, rng, starts_from
        fresh = one_colour_map(settings) if start is None else start
        self.chain: Chain = make_chain(settings, fresh) if like is None else copied(like)
        self.record = self.make_record(probes)
        self.times = ImageTimes(self.chain.image.black.size)
        self.block = block_length(len(self.chain.beams.ray) + len(self.chain.cones.pose))
        self.recorded_from = 0
        self.ground = prior_ground(settings, self.chain) if self.REFRESHES else None
        self.doubts = Doubts(self.chain)
        self.tempering: Tempering | None = None
        focus = focus_of(settings, self.chain)
        self._advance: Advance = run_chain if focus is None else focus.run_to
        self.poses: PoseTurns | None = None
        if settings.poses is not None:
            self.poses = PoseTurns(settings, self.chain, self._advance)
            self._advance = self.poses.run_to

    def make_record(self, probes: NDArray[np.int64]) -> Record:
        """Return what keeps the draws of the chain; `probes` (n_probes,) are pixels whose colour is kept with them."""
        return Record(probes)

    @property
    def step(self) -> int:
        """Steps made."""
        return int(self.chain.graph.counts[c.STEP])

    @property
    def burn_in(self) -> int:
        """Steps at the start that are left out."""
        return max(burn_in(self.step), self.recorded_from)

    def temper(self, plan: LadderPlan) -> None:
        """Put a temperature ladder on this chain; rounds are then the shortest, since every hot chain makes one.

        What was recorded before counts no more.
        """
        self.tempering = Tempering(self.settings, self.chain, self.rng, plan)
        self._advance = self.tempering.run_to
        self.block = SHORTEST_BLOCK
        self.forget()

    def forget(self) -> None:
        """Let the burn-in end here at the earliest."""
        self.recorded_from = self.step
        self.times.forget(self.chain.image, self.step)

    def run_to(self, step: int) -> None:
        """Run up to `step`."""
        self.chain = self._advance(self.chain, self.rng, step)

    def advance(self, latest: int | None = None) -> None:
        """Run one block, or up to the step `latest` if that is before its end, recording on the way.

        At its end the state is a function of map and impacts alone.
        """
        if self.tempering is not None and self.tempering.adapt(self.step):
            self.forget()
        end = self.step + self.block if latest is None else min(self.step + self.block, latest)
        steps = end - self.step
        while self.step < end:
            spacing = self.record.thin
            self.record_at(min(end, self.times.next_start, self.step - self.step % spacing + spacing))
        self.finish_block(steps)

    def record_at(self, step: int) -> None:
        """Run up to `step`, and record there."""
        self.run_to(step)
        if self.step == self.times.next_start:
            self.times.rotate(self.chain.image, self.step)
        self.record.take(self.chain, self.poses)

    def finish_block(self, steps: int) -> None:
        """Redraw ground that no reading concerns, in proportion to the `steps` of a block, and settle."""
        if self.ground is not None and self.poses is not None:
            self.ground = PriorGround(self.settings, self.chain)
        if self.ground is not None:
            self.chain = self.ground.refresh(self.chain, self.rng, int(self.ground.rate * steps))
        self.settle()

    def settle(self) -> None:
        """Recompute sums and lists, as at the end of every block."""
        if self.ground is not None:
            self.chain = self.ground.settle(self.chain)
        recompute_sums(self.chain)
        self.doubts.look(self.chain)
        if self.tempering is not None:
            self.tempering.settle()

    def find_start(self, stop_requested: Callable[[], bool]) -> None:
        """Before the first step: take the map, and the poses, that the chain shall start from."""
        if self.poses is not None:
            self.chain = self.poses.start(self.chain, self.rng)
        if self.starts_from != "empty":
            start = find_start_map(self.starts_from, self.settings, self.rng, stop_requested)
            chain = with_map(self.chain, self.settings, start)
            if chain.graph.counts[c.OCCUPIED] > 0:
                start = one_colour_map(self.settings)
                chain = with_map(self.chain, self.settings, start)
            self.chain = chain._replace(image=make_image(start, chain.graph, self.settings.resolution))
        self._draw_ground(stop_requested)
        self.measure_poses()
        if self.tempering is not None:
            self.tempering.start_at(read_coloring(self.chain.graph))

    def measure_poses(self) -> None:
        """Scale random walks of poses by the present map, if poses are uncertain."""
        if self.poses is not None:
            self.poses.measure(self.chain)

    def _draw_ground(self, stop_requested: Callable[[], bool]) -> None:
        """Draw what no reading concerns about as the prior has it, given the rest of the map."""
        if self.ground is None:
            return
        for _ in range(0, self.ground.first_proposals, PROPOSALS_PER_LOOK):
            if stop_requested():
                break
            self.chain = self.ground.refresh(self.chain, self.rng, PROPOSALS_PER_LOOK)
        self.settle()
