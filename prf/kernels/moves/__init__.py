"""Moves: those of figure 2 of the paper, and ours on walls, each with its reverse in one file (docs/moves.md).

A move fills the proposal and returns whether it is legal, and two log densities of one measure: `log_forward`, with
which it makes this proposal from the present map, and `log_reverse`, with which its reverse would make the present map
from the proposed one (-inf if it cannot). A factor that both have in common may be left out. The probabilities of
picking the moves are not among them: :mod:`prf.kernels.accept` forms the acceptance ratio.
"""
