"""What the law of directions adds to the log prior of an edge (:mod:`prf.model.orientation`)."""

from prf.kernels import constants as c
from prf.kernels._jit import Array, core


@core
def alignment(lines: Array, dx: float, dy: float) -> float:
    """Cos 4(theta - a) of the direction (dx, dy): 1 along the building, -1 half way between its directions."""
    square = dx * dx + dy * dy
    cos2 = (dx * dx - dy * dy) / square
    sin2 = 2.0 * dx * dy / square
    return (cos2 * cos2 - sin2 * sin2) * lines[c.COS_ANGLE] + 2.0 * cos2 * sin2 * lines[c.SIN_ANGLE]


@core
def crossing_factor(lines: Array, aligned: float) -> float:
    """Lambda / (2 p): how often edges cross a line of this alignment, beside all directions alike (Clenshaw's sum)."""
    later = 0.0
    after = 0.0
    for n in range(c.N_TERMS - 1, -1, -1):
        now = lines[c.FIRST_TERM + n] + 2.0 * aligned * later - after
        after = later
        later = now
    return 1.0 - (aligned * later - after)


@core
def log_thinning(lines: Array, dx: float, dy: float) -> float:
    """Log of m(theta) over its largest value."""
    return lines[c.ORIENTATION] * (alignment(lines, dx, dy) - 1.0)


@core
def log_direction(lines: Array, scale: float, xy: Array, length: float) -> float:
    """Log m(theta) - (lambda(theta) - 2 p) length of the edge with ends `xy` (4,): 0 if all directions are alike."""
    aligned = alignment(lines, xy[2] - xy[0], xy[3] - xy[1])
    log_measure = lines[c.ORIENTATION] * aligned - lines[c.LOG_MEAN]
    return log_measure - 2.0 * scale * length * (crossing_factor(lines, aligned) - 1.0)
