"""Simulated worlds and what a robot's laser and sonar read in them: readings whose truth is known."""

from prf.simulate.path import Scans, Spacing, plan_drive, scans_along
from prf.simulate.plans import OfficePlan, office
from prf.simulate.roadmap import Roadmap, roadmap
from prf.simulate.world import World

__all__ = [
    "OfficePlan",
    "Roadmap",
    "Scans",
    "Spacing",
    "World",
    "office",
    "plan_drive",
    "roadmap",
    "scans_along",
]
