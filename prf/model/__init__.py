"""What is sampled: maps, the prior over them, densities of readings, and the state of a chain."""
