"""Sensor models: parameters, likelihood and the index of readings of one sensor kind a module."""
