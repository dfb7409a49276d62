"""Kernels of answers and scores."""
