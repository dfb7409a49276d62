"""The map of a chain and its indexes."""
