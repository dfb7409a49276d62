"""Command-line plumbing that `prf` and `mapq` share; it knows nothing of maps, logs or kernels."""
