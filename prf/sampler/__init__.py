"""Metropolis-Hastings over polygonal maps: chains in threads, when to stop, checkpoints. Prints nothing."""

from prf.sampler.chain import ChainSampler
from prf.sampler.chains import Sampler
from prf.sampler.driver import StopRule, drive, rounds
from prf.sampler.prior import mcmc_draws

__all__ = ["ChainSampler", "Sampler", "StopRule", "drive", "mcmc_draws", "rounds"]
