"""Metropolis-Hastings over polygonal maps. Prints nothing.

A `Target` is what is sampled, with how it proposes (`Tuning`) and how its work is laid out (`Execution`). `ChainRun` is
one chain: its state, its generator, what it recorded, and its schedule, a value that is asked turn by turn which steps
come next: `Plain`, `Regions`, `PoseTurns` round one of these, `Ladder`, `Tiles`. An `Ensemble` is several chains of one
target. `drive` is the only loop: each round of a chain is a task, done in threads or by the workers of a Dask
scheduler; annealing, and runs in a folder (`Session`), watch it from outside.
"""

from prf.sampler.chain import ChainRun
from prf.sampler.ensemble import Ensemble
from prf.sampler.prior import mcmc_draws
from prf.sampler.session import StopRule, drive

__all__ = ["ChainRun", "Ensemble", "StopRule", "drive", "mcmc_draws"]
