"""Maps of walls: rectangles round centre lines, whose union is black (docs/walls.md).

The graph of a chain holds the four sides of each wall as edges of its own: from the right of its first end to the right
of its second, round that end, back along the left, round the first end. Sides of different walls may cross. Seen from
outside of all walls, the first side that a beam meets is where it meets their union, so that beams know nothing of
walls. A wall is longer than it is thick, so that its corners tell its axis.
"""
