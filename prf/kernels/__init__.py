"""Compiled cores: numba code that sees nothing but itself, numpy and numba."""
