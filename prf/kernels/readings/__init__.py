"""Beams, cones and values at points, and their likelihood."""
