"""Posterior over polygonal maps from localized laser and sonar readings."""

__version__ = "0.1.0"
