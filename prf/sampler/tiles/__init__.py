"""Tiles: one chain updated in many places at once, exact in law (docs/large-jobs.md).

A round cuts the window into rectangles by chance. In each a chain of its own changes what lies strictly inside, while
all that crosses a border stays; then the parts are put together again. The spatial Markov property of the Arak process
makes what lies inside a tile independent of what lies outside given what stays. Readings are dealt out so that each is
decided by one tile, whatever the others do.
"""
