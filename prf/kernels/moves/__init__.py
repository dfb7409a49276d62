"""Moves: those of figure 2 of the paper, and ours on walls. A move and its reverse stand in one file (docs/moves.md).

A move fills the proposal and returns whether it is legal, and the log of
(probability of choosing the reverse move x density of its proposal) / (the same of this move):
the part of the Hastings ratio that is not the target. Where the way back depends on the cells that the new edges pass,
`propose_*` gives the way there alone, and `*_returns` the way back once these cells are known.
"""
