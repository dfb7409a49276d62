"""Metropolis-Hastings over polygonal maps: chains in threads, when to stop, checkpoints. Prints nothing."""

from prf.sampler.chain import ChainSampler
from prf.sampler.drive import Progress, StopRule, drive
from prf.sampler.prior import mcmc_draws
from prf.sampler.several import Sampler

__all__ = ["ChainSampler", "Progress", "Sampler", "StopRule", "drive", "mcmc_draws"]
