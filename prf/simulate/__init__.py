"""Simulated worlds and what a robot's laser and sonar read in them: readings whose truth is known."""

from prf.simulate.laser import LaserPhysics, simulate_laser
from prf.simulate.path import Scans, Spacing, plan_drive, scans_along
from prf.simulate.plans import office
from prf.simulate.roadmap import Roadmap, roadmap
from prf.simulate.simulation import SimulateConfig, Simulation, config_of, refuse_absent_sensor, simulate
from prf.simulate.sources import draw_world, read_world
from prf.simulate.world import World
from prf.simulate.write import summary, write_simulation

__all__ = [
    "LaserPhysics",
    "Roadmap",
    "Scans",
    "SimulateConfig",
    "Simulation",
    "Spacing",
    "World",
    "config_of",
    "draw_world",
    "office",
    "plan_drive",
    "read_world",
    "refuse_absent_sensor",
    "roadmap",
    "scans_along",
    "simulate",
    "simulate_laser",
    "summary",
    "write_simulation",
]
