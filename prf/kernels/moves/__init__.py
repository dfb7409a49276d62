"""Moves of figure 2 of the paper, and cuts of walls: a move and its reverse stand in one file.

A move fills the proposal and returns whether it is legal, and the log of
(probability of choosing the reverse move x density of its proposal) / (the same of this move):
the part of the Hastings ratio that is not the target.
"""
