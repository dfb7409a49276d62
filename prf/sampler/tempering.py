"""Parallel tempering: hot rungs below a chain, on which the likelihood counts less, and swaps of maps between them.

Rung k has the target h exp(powers[k] (log likelihood - cost * occupied sensors)); on the cold one, of power 1, no
sensor may stand in black. A swap exchanges the maps of neighbours and is accepted with probability

    min(1, exp((powers[k] - powers[k + 1]) (E(map of k + 1) - E(map of k)))),    E = log likelihood - cost * occupied,

except that a map with an occupied sensor never comes to the cold rung. A rung of power 0 makes no steps: whenever it
is asked for a swap it has a fresh, exact draw of the prior.
"""

from __future__ import annotations

import math

import numpy as np

from prf.arak import exact_draws
from prf.coloring import Coloring
from prf.kernels import constants as c
from prf.kernels.build import recompute_sums
from prf.kernels.chain import Chain
from prf.layout import run_chain
from prf.posterior import Settings
from prf.sampler.tempering_ladder import Ladder, LadderPlan, SwapReport
from prf.sampler.tempering_state import (
    exchanged,
    occupied_cost,
    penalised_log_likelihood,
    repaint,
    settle_image,
    with_map,
    without_image,
)

SWAP_SPACING = 1000
"""Steps of every rung between two tries to swap."""
ADAPTATIONS = tuple(20_000 * 2**k for k in range(6))
"""Steps of the rungs after which the powers are moved, and the burn-in begins anew; after the last they stay."""


class Tempering:
    """The hot rungs of one chain."""

    def __init__(self, settings: Settings, cold: Chain, rng: np.random.Generator, plan: LadderPlan) -> None:
        self.settings = settings
        self.spacing = SWAP_SPACING
        self.ladder = Ladder(plan.first_powers(), finds_reach=plan.hottest is None)
        self.cost = plan.cost if plan.cost is not None else occupied_cost(settings, len(cold.sensors.xy))
        self.first_step = int(cold.graph.counts[c.STEP])
        self.swap_rng, *self.generators = rng.spawn(self.ladder.rungs)
        self.hot = [without_image(cold) for _ in self.generators]
        self.apply_powers()

    def apply_powers(self) -> None:
        """Give every hot rung its power and the cost of occupied sensors."""
        for chain, power in zip(self.hot, self.ladder.powers[1:], strict=True):
            chain.density[c.LIKELIHOOD_POWER] = power
            chain.density[c.OCCUPIED_COST] = self.cost

    def start_at(self, coloring: Coloring) -> None:
        """Before the first step: let every hot rung start from this map."""
        self.hot = [with_map(chain, self.settings, coloring) for chain in self.hot]

    def report(self) -> SwapReport:
        """Return what the ladder has come to."""
        return self.ladder.report(self.first_step)

    def adapt(self, step: int) -> bool:
        """Move the powers if it is time; return whether it was."""
        if step - self.first_step not in ADAPTATIONS or self.ladder.tried.sum() == 0:
            return False
        self.ladder.even_out()
        self.apply_powers()
        return True

    def settle(self) -> None:
        """Lay out sums and lists of all hot rungs anew."""
        for chain in self.hot:
            recompute_sums(chain)

    def run_to(self, cold: Chain, rng: np.random.Generator, step: int) -> Chain:
        """Run all rungs up to `step`, swapping on the way; return the cold one."""
        now = int(cold.graph.counts[c.STEP])
        cold = run_chain(cold, rng, now)
        while now < step:
            now = min(step, now - now % self.spacing + self.spacing)
            cold = run_chain(cold, rng, now)
            for k, power in enumerate(self.ladder.powers[1:]):
                if power > 0.0:
                    self.hot[k] = run_chain(self.hot[k], self.generators[k], now)
                else:
                    self.hot[k].graph.counts[c.STEP] = now
            if now % self.spacing == 0:
                cold = self.swap(cold, (now // self.spacing) % 2)
        return cold

    def swap(self, cold: Chain, parity: int) -> Chain:
        """Try to swap every second pair of neighbours, from the pair `parity` on; return the cold chain."""
        rungs = [cold, *self.hot]
        for pair in range(parity, len(rungs) - 1, 2):
            if self.ladder.powers[pair + 1] == 0.0:
                rungs[pair + 1] = self.drawn_from_prior()
            log_ratio = self.log_swap_ratio(pair, rungs[pair], rungs[pair + 1])
            self.ladder.note(pair, math.exp(min(0.0, log_ratio)))
            if math.log(1.0 - self.swap_rng.random()) < log_ratio:
                if pair == 0:
                    settle_image(cold)
                rungs[pair], rungs[pair + 1] = exchanged(rungs[pair], rungs[pair + 1])
                if pair == 0:
                    repaint(rungs[0])
                self.ladder.carry(pair)
        cold, *self.hot = rungs
        return cold

    def log_swap_ratio(self, pair: int, colder: Chain, hotter: Chain) -> float:
        """Return the log of the ratio with which the maps of two neighbours change places."""
        if pair == 0 and hotter.graph.counts[c.OCCUPIED] > 0:
            return -math.inf
        powers = self.ladder.powers
        gain = penalised_log_likelihood(hotter, self.cost) - penalised_log_likelihood(colder, self.cost)
        return float((powers[pair] - powers[pair + 1]) * gain)

    def drawn_from_prior(self) -> Chain:
        """Return the hottest rung at a fresh draw of the prior."""
        draw = exact_draws(self.settings.scale, self.settings.window, 1, self.generators[-1])[0]
        return with_map(self.hot[-1], self.settings, draw)
