"""Where to look next: places to which a robot can go, and what one scan from there is expected to settle."""

from prf.results.explore.search import Exploration, explore

__all__ = ["Exploration", "explore"]
