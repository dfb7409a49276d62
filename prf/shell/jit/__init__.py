"""Compilation of kernels: the cache of machine code, progress, compiling ahead."""
