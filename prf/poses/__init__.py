"""Uncertain poses: their prior, readings as the robot had them, and where a trajectory starts (docs/poses.md)."""
