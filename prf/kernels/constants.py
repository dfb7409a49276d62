"""Integer names of sides, sets, counters, moves and columns that the kernels share (frozen at compile time)."""

import numpy as np

INTERIOR = -1
BOTTOM = 0
RIGHT = 1
TOP = 2
LEFT = 3

NONE = -1
"""No edge, no vertex, no beam."""

# Sets that a move samples from uniformly; rows of ``Graph.members`` and ``Graph.positions``.
EDGES = 0
INTERIOR_VERTICES = 1
BOUNDARY_VERTICES = 2
TRIANGLE_VERTICES = 3  # vertices of closed 3-loops: three members a triangle
BOUNDARY_APEXES = 4  # interior vertices whose two neighbours lie on the same side
CORNER_CUTS = 5  # edges that join adjacent sides
WALLS = CORNER_CUTS  # of a map of walls, whose graph has no corner cuts: the first side of each
N_SETS = 6

# Entries of ``Graph.counts`` after the sizes of the sets.
FREE_VERTICES = 6
FREE_EDGES = 7
ANCHOR_BLACK = 8
NEEDS_ROOM = 9
STEP = 10
OCCUPIED = 11  # sensor positions in black, and pieces of the way that edges block, edge by edge
N_COUNTS = 12

# Entries of ``Graph.sums``.
TOTAL_LENGTH = 0
LOG_PRIOR = 1
LOG_LIKELIHOOD = 2
N_SUMS = 3

MOST_CHANGES = 8
"""No proposal removes or adds more edges or vertices than this."""

# Moves in the order of the table of move probabilities: those of figure 2 of the paper, then ours.
TRIANGLE_BIRTH = 0
TRIANGLE_DEATH = 1
BOUNDARY_BIRTH = 2
BOUNDARY_DEATH = 3
CORNER_BIRTH = 4
CORNER_DEATH = 5
SPLIT = 6
MERGE = 7
MOVE_INTERIOR = 8
MOVE_BOUNDARY = 9
PAST_CORNER = 10
RECOLOR = 11
LOCAL_RECOLOR = 12
SLIDE = 13
CUT_WALL = 14
MEND_WALL = 15
JOIN_WALL = 16
PART_WALL = 17
DOCK = 18
UNDOCK = 19
NOTCH = 20
FILL = 21
BEND = 22
UNBEND = 23
BOX_BIRTH = 24
BOX_DEATH = 25

MOVES = (
    ("triangle birth", 0.25),
    ("triangle death", 0.1),
    ("boundary triangle birth", 0.02),
    ("boundary triangle death", 0.02),
    ("corner cut birth", 0.005),
    ("corner cut death", 0.005),
    ("split edge", 0.08),
    ("merge edges", 0.08),
    ("move interior vertex", 0.12),
    ("move boundary vertex", 0.04),
    ("move vertex past corner", 0.01),
    ("recolor quadrilateral", 0.02),
    ("recolor local quadrilateral", 0.06),
    ("slide vertex", 0.12),
    ("cut wall", 0.02),
    ("mend wall", 0.02),
    ("join to wall", 0.04),
    ("part from wall", 0.04),
    ("join to window side", 0.02),
    ("part from window side", 0.02),
    ("notch wall", 0.06),
    ("fill notch", 0.05),
    ("bend to return", 0.08),
    ("unbend", 0.08),
    ("box birth", 0.15),
    ("box death", 0.06),
)
"""Name and weight of each, in that order. Births are refused so often that they are tried more often than deaths."""

N_MOVES = len(MOVES)

PAIRS = {
    TRIANGLE_BIRTH: TRIANGLE_DEATH,
    BOUNDARY_BIRTH: BOUNDARY_DEATH,
    CORNER_BIRTH: CORNER_DEATH,
    SPLIT: MERGE,
    CUT_WALL: MEND_WALL,
    JOIN_WALL: PART_WALL,
    DOCK: UNDOCK,
    NOTCH: FILL,
    BEND: UNBEND,
    BOX_BIRTH: BOX_DEATH,
}
REVERSE = np.array([(PAIRS | {back: move for move, back in PAIRS.items()}).get(move, move) for move in range(N_MOVES)])
"""The move that undoes each: the other one of its pair, else itself."""

# Moves of walls, likewise.
WALL_BIRTH = 0
WALL_DEATH = 1
SHIFT_WALL = 2
TURN_WALL = 3
EXTEND_WALL = 4
MOVE_END = 5
THICKNESS = 6
GAP = 7
MERGE_WALLS = 8
HOLLOW = 9
FILL_WALLS = 10

WALL_MOVES = (
    ("wall birth", 0.26),
    ("wall death", 0.1),
    ("shift wall", 0.12),
    ("turn wall", 0.1),
    ("extend wall", 0.1),
    ("move end to joint", 0.1),
    ("thickness of wall", 0.12),
    ("gap in wall", 0.04),
    ("merge walls", 0.04),
    ("hollow wall", 0.02),
    ("fill walls", 0.02),
)
N_WALL_MOVES = len(WALL_MOVES)
WALL_PAIRS = {WALL_BIRTH: WALL_DEATH, GAP: MERGE_WALLS, HOLLOW: FILL_WALLS}
WALL_REVERSE = np.array(
    [(WALL_PAIRS | {b: a for a, b in WALL_PAIRS.items()}).get(move, move) for move in range(N_WALL_MOVES)]
)

BORDER_MOVES = (BOUNDARY_BIRTH, BOUNDARY_DEATH, CORNER_BIRTH, CORNER_DEATH, MOVE_BOUNDARY, PAST_CORNER, DOCK, UNDOCK)
"""Those that change vertices on the border of the window."""

# Columns of the table of outcomes.
PROPOSED = 0
VALID = 1  # passed legality and the crossing check
ACCEPTED = 2
N_OUTCOMES = 3

# Entries of ``Chain.density``: the density that a chain samples.
SCALE = 0  # p of the prior, 1/m
INVERSE_TEMPERATURE = 1  # 1 samples the posterior, more prefers its mode over lines
LIKELIHOOD_POWER = 2  # exponent of the likelihood: 1 the posterior, 0 the prior; leaves the prior alone
OCCUPIED_COST = 3  # log likelihood that each occupied sensor or blocked piece takes, nats; inf: there may be none
FREE_SPACE = 4  # nats that each square metre of black takes
EDGE_COST = 5  # nats that each edge takes where the mode is sought, beside the prior
WALL_DENSITY = 6  # walls a square metre of the Poisson process of walls (kernels.walls.law); 0: the Arak process
WALL_LENGTH = 7  # median length of a wall, m
FREE_END = 8  # nats that an end of a wall takes that lies in no other wall
CROSSING = 9  # nats that two walls take that cross without a joint
N_DENSITY = 10

# Entries of ``Chain.lines``: the directions that edges prefer (:mod:`prf.model.orientation`).
ORIENTATION = 0  # K, how much; 0: all alike
ANGLE = 1  # a, one of the two directions of the building, radians
COS_ANGLE = 2  # of 4 a
SIN_ANGLE = 3
LOG_MEAN = 4  # log I0(K), which m = exp(K cos 4(theta - a)) / I0(K) needs for its mean of 1
LOG_NORMALISER = 5  # log Z(K, a) less that of K = 0
FIRST_TERM = 6  # the first of the coefficients of the rate at which edges cross a line, by harmonics of 4 (theta - a)
N_TERMS = 16
N_LINES = FIRST_TERM + N_TERMS
N_COMMON = 3
"""Common values of the thickness of walls, m, which follow in a map of walls."""

# Entries of ``Chain.tuning``: scales of the proposals. A reach is the median of a random distance, m.
LOCAL_SHARE = 0  # share of births whose further vertices lie near the first
BIRTH_REACH = 1  # of those
SPLIT_REACH = 2  # of a split's new vertex from the edge
MOVE_REACH = 3  # of a vertex move
CUT_REACH = 4  # of the corners of a cut from the lines of the wall
JOIN_REACH = 5  # of new corners from the feet of the vertices that are joined to them
DOCK_REACH = 6  # no median: edges whose middles are nearer than this to a side are joined to it
AIM_REACH = 7  # of the vertices of an aimed birth
AIMED_SHARE = 8  # share of interior births that are aimed at returns; 0 without targets
REGION = 9  # the first of four: x_min, y_min, x_max, y_max of the region to which moves are confined
REGION_TARGET = 13  # target in the middle of it, near which births are aimed; NONE: moves are not confined
N_TUNING = 14

# Columns of ``Beams.ray``.
ORIGIN_X = 0
ORIGIN_Y = 1
DIRECTION_X = 2
DIRECTION_Y = 3
MAX_DISTANCE = 4  # beyond it no obstacle is met: window border or maximum range
RANGE = 5  # the reading; inf for no return, -m where it is censored at m, the border of the window
DISTANCE = 6  # to the first obstacle in the current map, inf for none
BEAM_LOG_LIKELIHOOD = 7
N_RAY = 8

# Entries of the laser model's array.
MAX_RANGE = 0
NOISE = 1
NOISE_RELATIVE = 2
HIT = 3
OUTLIER_DENSITY = 4  # w_outlier / max_range
MISS = 5
LOG_OUTLIER = 6  # log density of a return without an obstacle in reach
LOG_MISS = 7  # log probability of no return without an obstacle in reach
VANISHING = 8  # square of the deviation, in standard deviations, past which only outliers count, to the last bit
WEIGHT = 9  # independent readings that a beam counts as, which stands for no others
N_LASER_MODEL = 10
