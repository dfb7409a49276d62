"""Simulated maps with known truth: an urban world, a drive with a nodding laser, and a map rendered from odometry."""

from mapq.simulate.drive import Report, Simulation, simulate, simulate_with_report
from mapq.simulate.scene import Kind

__all__ = ["Kind", "Report", "Simulation", "simulate", "simulate_with_report"]
