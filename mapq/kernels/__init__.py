"""Numba only here; a kernel sees nothing but numpy and other kernels."""
