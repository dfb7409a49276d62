"""Fewer laser beams that say nearly the same: a step's cost no longer grows with the log (docs/thinning.md)."""

from prf.thinning.select import BEAM_DENSITY, checked_density, thin_beams

__all__ = ["BEAM_DENSITY", "checked_density", "thin_beams"]
