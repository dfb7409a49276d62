"""Simulated worlds and what a robot's laser and sonar read in them: readings whose truth is known."""

from prf.simulate.floorplan import office
from prf.simulate.path import Scans, plan_drive, scans_along
from prf.simulate.roadmap import Roadmap, roadmap
from prf.simulate.sensors import simulate_laser
from prf.simulate.simulation import SimulateConfig, Simulation, config_of, refuse_absent_sensor, simulate
from prf.simulate.world import World, draw_world, read_world
from prf.simulate.write import summary, write_simulation

__all__ = [
    "Roadmap",
    "Scans",
    "SimulateConfig",
    "Simulation",
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
