"""One chain in Python's hands: advanced block by block, its draws and image recorded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from prf.coloring import Coloring
from prf.configuration import Start
from prf.kernels import constants as c
from prf.kernels.build import recompute_sums
from prf.kernels.chain import Chain
from prf.layout import make_image, read_coloring, run_chain
from prf.posterior import Settings, make_chain, one_colour_map
from prf.sampler.doubts import Doubts
from prf.sampler.focus import focus_of
from prf.sampler.prior_ground import prior_ground
from prf.sampler.record import FIRST_THIN, ImageTimes, Record, burn_in
from prf.sampler.starts import find_start_map, needs_search
from prf.sampler.tempering import Tempering
from prf.sampler.tempering_ladder import LadderPlan
from prf.sampler.tempering_state import copied, with_map

SHORTEST_BLOCK = 5 * FIRST_THIN
LONGEST_BLOCK = 4 * SHORTEST_BLOCK
"""A round must not keep Ctrl-C, the clock and the progress waiting for long."""

FIRST_LOOK = 50_000
"""Proposals of the draw of the prior between two looks at whether it is to stop."""


def block_length(n_readings: int) -> int:
    """Return the steps after which sums and lists are laid out anew.

    That costs time in proportion to the readings, so the steps grow with them; they depend on nothing else, because
    they decide the order of floating-point sums.
    """
    length = SHORTEST_BLOCK
    while length < min(n_readings, LONGEST_BLOCK):
        length *= 2
    return length


class ChainSampler:
    """A chain, its generator and what it has recorded; `probes` (n_probes,)."""

    def __init__(
        self,
        settings: Settings,
        rng: np.random.Generator,
        probes: NDArray[np.int64],
        start: Coloring | None = None,
        starts_from: Start = "empty",
        like: Chain | None = None,
        refreshes: bool = True,
    ) -> None:
        self.settings = settings
        self.rng = rng
        self.starts_from = starts_from
        fresh = start if start is not None else one_colour_map(settings)
        self.chain: Chain = make_chain(settings, fresh) if like is None else copied(like)
        self.record = Record(probes)
        self.times = ImageTimes(self.chain.image.black.size)
        self.block = block_length(len(self.chain.beams.ray) + len(self.chain.cones.pose))
        self.recorded_from = 0
        self.tempering: Tempering | None = None
        self.ground = prior_ground(settings, self.chain) if refreshes else None
        self.doubts = Doubts(self.chain)
        self.focus = focus_of(settings, self.chain)

    @property
    def step(self) -> int:
        """Steps made."""
        return int(self.chain.graph.counts[c.STEP])

    @property
    def burn_in(self) -> int:
        """Steps at the start that are left out."""
        return max(burn_in(self.step), self.recorded_from)

    @property
    def rungs(self) -> int:
        """Rungs of this chain, itself among them; 1 without parallel tempering."""
        return 1 if self.tempering is None else self.tempering.ladder.rungs

    def temper(self, plan: LadderPlan) -> None:
        """Put hot rungs below this chain from now on; rounds are then the shortest, since every rung makes one."""
        self.tempering = Tempering(self.settings, self.chain, self.rng, plan)
        self.block = SHORTEST_BLOCK

    def forget(self) -> None:
        """Let the burn-in end here at the earliest: what was recorded before counts no more."""
        self.recorded_from = self.step
        self.times.forget(self.chain.image, self.step)

    def advance(self, latest: int | None = None) -> None:
        """Run one block, recording on the way; at its end the state is a function of map and impacts alone.

        It ends at the step `latest` if that comes before.
        """
        if self.tempering is not None and self.tempering.adapt(self.step):
            self.forget()
        end = self.step + self.block if latest is None else min(self.step + self.block, latest)
        steps = end - self.step
        while self.step < end:
            spacing = self.record.thin
            self.run_to(min(end, self.times.next_start, self.step - self.step % spacing + spacing))
            if self.step == self.times.next_start:
                self.times.rotate(self.chain.image, self.step)
            self.record.take(self.chain)
        self.refresh(steps)
        self.settle()

    def find_start(self, stop_requested: Callable[[], bool]) -> None:
        """Before the first step: go to the map that the chain shall start from."""
        if needs_search(self.starts_from, self.settings):
            start = find_start_map(self.starts_from, self.settings, self.rng, stop_requested)
            chain = with_map(self.chain, self.settings, start)
            if chain.graph.counts[c.OCCUPIED] > 0:
                start = one_colour_map(self.settings)
                chain = with_map(self.chain, self.settings, start)
            self.chain = chain._replace(image=make_image(start, chain.graph, self.settings.resolution))
        self.draw_ground(stop_requested)
        if self.tempering is not None:
            self.tempering.start_at(read_coloring(self.chain.graph))

    def draw_ground(self, stop_requested: Callable[[], bool]) -> None:
        """Before the first step: draw what no reading concerns about as the prior has it, given the rest of the map."""
        if self.ground is None:
            return
        for _ in range(0, self.ground.first_proposals, FIRST_LOOK):
            if stop_requested():
                break
            self.chain = self.ground.refresh(self.chain, self.rng, FIRST_LOOK)
        self.settle()

    def refresh(self, steps: int) -> None:
        """Draw anew in ground that no reading concerns, as much as goes with so many `steps`; settle the chain then."""
        if self.ground is not None:
            self.chain = self.ground.refresh(self.chain, self.rng, int(self.ground.rate * steps))

    def finish_block(self, end: int, steps: int) -> None:
        """Run up to the step `end` of a block of `steps` without a record on the way, record there, and settle."""
        self.run_to(end)
        if self.step == self.times.next_start:
            self.times.rotate(self.chain.image, self.step)
        self.record.take(self.chain)
        self.refresh(steps)
        self.settle()

    def settle(self) -> None:
        """Lay out sums and lists anew, as at the end of every block."""
        if self.ground is not None:
            self.chain = self.ground.settle(self.chain)
        recompute_sums(self.chain)
        self.doubts.look(self.chain)
        if self.tempering is not None:
            self.tempering.settle()

    def run_to(self, step: int) -> None:
        """Run up to `step`, with the hot rungs if there are any."""
        if self.tempering is None and self.focus is not None:
            self.chain = self.focus.run_to(self.chain, self.rng, step)
        elif self.tempering is None:
            self.chain = run_chain(self.chain, self.rng, step)
        else:
            self.chain = self.tempering.run_to(self.chain, self.rng, step)
