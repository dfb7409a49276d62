"""Plans of simulated offices: walls, thickness and doors found, beside edges of polygons and lines of a grid.

``python -m benchmarks.plans [-o FOLDER] [--worlds N] [--family offices|rings]``

Floors are drawn from centre lines with a thickness, doors left open, boxes as furniture, and driven by the simulated
robot. Settings of walls were chosen on the family "offices"; "rings" (turned, other thicknesses, a corridor round a
block of rooms) was not looked at before. A place of a true edge within `SEEN` of a return is found if a segment of the
same direction (2 degrees) lies within 5 cm; a found segment on seen ground is false where none of the truth does. The
lines of the grid are those of scikit-image (probabilistic Hough transform), where it is installed.
"""

from __future__ import annotations

import importlib
import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from benchmarks import commands
from benchmarks.commands import made, say
from prf.model.coloring import Coloring
from prf.model.walls import corners_of
from prf.output.run import Run, read_run
from prf.readings import read_readings
from prf.results.occupancy import read_grid
from prf.results.plan import Plan, plan_of

Floats = NDArray[np.float64]

SECONDS = 120.0
NEAR, TILT, SEEN, STEP = 0.05, math.radians(2.0), 0.1, 0.05
DOOR, DOOR_NEAR, DOOR_WIDTH = 0.9, 0.3, 0.15
THICKNESS = 0.02


class Floor:
    """A true plan: walls (n, 5) between doors, middles of doors, furniture."""

    def __init__(self) -> None:
        self.walls: list[list[float]] = []
        self.doors: list[tuple[float, float]] = []
        self.boxes: list[shapely.Polygon] = []

    def wall(self, a: tuple[float, float], b: tuple[float, float], thickness: float, *doors: float) -> None:
        """Add a wall from a to b with doors whose middles lie at these distances from a."""
        length = math.dist(a, b)
        unit = ((b[0] - a[0]) / length, (b[1] - a[1]) / length)
        starts = [0.0, *(at + 0.5 * DOOR for at in sorted(doors))]
        ends = [*(at - 0.5 * DOOR for at in sorted(doors)), length]
        for low, high in zip(starts, ends, strict=True):
            p, q = ((a[0] + s * unit[0], a[1] + s * unit[1]) for s in (low, high))
            self.walls.append([*p, *q, thickness])
        self.doors += [(a[0] + at * unit[0], a[1] + at * unit[1]) for at in doors]

    def region(self) -> shapely.Geometry:
        """Return the occupied area."""
        parts = list(shapely.polygons(corners_of(np.array(self.walls)))) + self.boxes
        return shapely.set_precision(shapely.union_all(parts), 1e-4)


def office(rng: np.random.Generator) -> Floor:
    """Return a corridor with rooms on both sides."""
    floor, width, height, low, high = Floor(), 18.0, 11.0, 4.5, 6.5
    outer = 0.15  # half of an outer wall, by which corners are filled
    floor.wall((-outer, 0.0), (width + outer, 0.0), 0.3)
    floor.wall((-outer, height), (width + outer, height), 0.3)
    floor.wall((0.0, 0.0), (0.0, height), 0.3)
    floor.wall((width, 0.0), (width, height), 0.3)
    for y, other, n in ((low, 0.0, 4), (high, height, 3)):
        cuts = np.linspace(0.0, width, n + 1)[1:-1] + rng.uniform(-0.6, 0.6, n - 1)
        rooms = np.concatenate([[0.0], cuts, [width]])
        doors = [float(rng.uniform(a + 1.0, b - 1.0)) for a, b in itertools.pairwise(rooms)]
        floor.wall((0.0, y), (width, y), 0.2, *doors)
        for x in cuts.tolist():
            floor.wall((x, y), (x, other), float(rng.choice([0.1, 0.15])))
        for x in (rooms[:-1] + 1.2).tolist():
            at = y + 0.55 * (other - y)
            floor.boxes.append(shapely.box(x, at, x + 0.9, at + 0.5))
    return floor


def ring(rng: np.random.Generator) -> Floor:
    """Return a corridor round a block of rooms."""
    floor, side, inner = Floor(), 13.0, 2.2
    far = side - inner
    for a, b in (((-0.12, 0.0), (side + 0.12, 0.0)), ((-0.12, side), (side + 0.12, side))):
        floor.wall(a, b, 0.24)
    for x in (0.0, side):
        floor.wall((x, 0.0), (x, side), 0.24)
    middle = 0.5 * side + float(rng.uniform(-0.8, 0.8))
    for y in (inner, far):
        doors = [
            float(rng.uniform(1.0, middle - inner - 1.0)),
            float(rng.uniform(middle - inner + 1.0, far - inner - 1.0)),
        ]
        floor.wall((inner - 0.08, y), (far + 0.08, y), 0.16, *(at + 0.08 for at in doors))
    for x in (inner, far):
        floor.wall((x, inner), (x, far), 0.16)
    floor.wall((middle, inner), (middle, far), 0.12)
    floor.wall((inner, 0.5 * side), (far, 0.5 * side), 0.12)
    floor.boxes.append(shapely.box(inner + 0.6, 0.5 * side + 0.6, inner + 1.2, 0.5 * side + 1.8))
    turn = 0.3
    rotated = np.array(floor.walls)
    turned = [
        affinity.rotate(shapely.LineString(row[:4].reshape(2, 2)), turn, (0, 0), use_radians=True) for row in rotated
    ]
    floor.walls = [[*np.array(line.coords).ravel(), row[4]] for line, row in zip(turned, rotated, strict=True)]
    floor.boxes = [affinity.rotate(box, turn, (0, 0), use_radians=True) for box in floor.boxes]
    cosine, sine = math.cos(turn), math.sin(turn)
    floor.doors = [(cosine * x - sine * y, sine * x + cosine * y) for x, y in floor.doors]
    return floor


FAMILIES = {"offices": office, "rings": ring}


def places(segments: Floats) -> tuple[Floats, Floats]:
    """Return points (n, 2) every `STEP` along segments (k, 4), and the directions (n,) there."""
    xy, angle = [np.zeros((0, 2))], [np.zeros(0)]
    for ax, ay, bx, by in segments.tolist():
        length = math.hypot(bx - ax, by - ay)
        share = (np.arange(max(1, round(length / STEP))) + 0.5) / max(1, round(length / STEP))
        xy.append(np.column_stack([ax + share * (bx - ax), ay + share * (by - ay)]))
        angle.append(np.full(len(share), math.atan2(by - ay, bx - ax)))
    return np.concatenate(xy), np.concatenate(angle)


def matched(xy: Floats, angle: Floats, segments: Floats) -> NDArray[np.bool_]:
    """Return which places (n,) have a segment (k, 4) of their direction within `NEAR`."""
    if len(segments) == 0 or len(xy) == 0:
        return np.zeros(len(xy), np.bool_)
    lines = shapely.linestrings(segments.reshape(-1, 2, 2))
    point, line = shapely.STRtree(lines).query(shapely.points(xy), predicate="dwithin", distance=NEAR)
    theta = np.arctan2(segments[:, 3] - segments[:, 1], segments[:, 2] - segments[:, 0])
    off = np.abs(np.angle(np.exp(2j * (angle[point] - theta[line])))) / 2.0
    found = np.zeros(len(xy), np.bool_)
    found[point[off <= TILT]] = True
    return found


def ring_segments(region: Any) -> Floats:
    """Return the edges (n, 4) of a region."""
    found = [np.zeros((0, 4))]
    for part in shapely.get_parts(region):
        for line in (part.exterior, *part.interiors):
            xy = np.array(line.coords)
            found.append(np.hstack([xy[:-1], xy[1:]]))
    return np.concatenate(found)


def scores(segments: Floats, truth: Floats, ends: Floats) -> dict[str, float]:
    """Return the share of true length found, and of found length that is false, both of what returns lie near."""
    tree = shapely.STRtree(shapely.points(ends))

    def seen(xy: Floats) -> NDArray[np.bool_]:
        near = tree.query(shapely.points(xy), predicate="dwithin", distance=SEEN)[0]
        return np.isin(np.arange(len(xy)), near)

    xy, angle = places(truth)
    kept = seen(xy)
    own, own_angle = places(segments)
    shown = seen(own)
    false = ~matched(own[shown], own_angle[shown], truth)
    return {
        "found": float(matched(xy[kept], angle[kept], segments).mean()),
        "false": float(false.mean()) if shown.any() else 0.0,
    }


def faces_of(plan: Plan) -> Floats:
    """Return the edges (n, 4) of the region that the walls of a plan cover."""
    walls = np.array([[*wall.ends.ravel(), wall.thickness] for wall in plan.walls]).reshape(-1, 5)
    return ring_segments(shapely.union_all(shapely.polygons(corners_of(walls))))


def plan_scores(plan: Plan, floor: Floor) -> dict[str, float]:
    """Return how well thickness of inner walls and doors are found, and how many doors are false."""
    errors = []
    for row in np.array(floor.walls)[4:]:  # the first four are outer walls, of which one face is seen
        middle = row[:4].reshape(2, 2).mean(axis=0)
        away = [shapely.LineString(wall.ends).distance(shapely.Point(middle)) for wall in plan.walls]
        if away and min(away) < 0.1:
            errors.append(abs(plan.walls[int(np.argmin(away))].thickness - row[4]))
    middles = np.array([door.ends.mean(axis=0) for door in plan.doors]).reshape(-1, 2)
    true = np.array(floor.doors)
    apart = np.hypot(*(true[:, None] - middles).transpose(2, 0, 1))
    width = np.array([door.width for door in plan.doors])
    fits = (apart < DOOR_NEAR) & (np.abs(width - DOOR) < DOOR_WIDTH)
    return {
        "thickness": float(np.mean(np.array(errors) < THICKNESS)) if errors else 0.0,
        "thickness_error": float(np.median(errors)) if errors else float("nan"),
        "doors": float(fits.any(axis=1).mean()),
        "false_doors": int((~fits.any(axis=0)).sum()),
    }


def grid_lines(path: Path) -> Floats | None:
    """Return the lines (n, 4) that scikit-image finds in a grid; None where it is not installed."""
    try:
        transform = importlib.import_module("skimage.transform")
    except ImportError:
        return None
    image = read_grid(path).image()
    lines = transform.probabilistic_hough_line(image.occupancy > 0.5, threshold=10, line_length=8, line_gap=3, rng=0)
    cells = np.array(lines, np.float64).reshape(-1, 4)
    return np.asarray(np.tile(image.origin, 2) + (cells + 0.5) * image.resolution)


def best_edges(run: Run) -> Floats:
    """Return the edges (n, 4) of the best map of a run."""
    best: Coloring | None = run.best
    assert best is not None
    return best.segments()


def one_world(family: str, number: int, options: Any) -> list[dict[str, Any]]:
    """Simulate a floor, map it in each way, and return a row each."""
    folder = options.output / f"{family}-{number}"
    folder.mkdir(parents=True, exist_ok=True)
    floor = FAMILIES[family](np.random.default_rng([options.seed, number]))
    x0, y0, x1, y1 = floor.region().bounds
    content = {
        "type": "Feature",
        "geometry": shapely.geometry.mapping(floor.region()),
        "properties": {"window": [x0 - 0.5, y0 - 0.5, x1 + 0.5, y1 + 0.5]},
    }
    (folder / "plan.geojson").write_text(json.dumps(content))
    made("simulate", folder / "world", world=folder / "plan.geojson", seed=options.seed, **{"simulate.spacing": 1.0})
    log = folder / "world" / "laser.log.gz"
    readings = read_readings(str(log))
    ends, truth = readings.within(29.0).impacts(), ring_segments(floor.region())
    how: dict[str, Any] = {
        "laser": log,
        "time_budget": options.seconds,
        "seed": options.seed,
        "threads": options.threads,
    }
    rows = []
    made("sample", folder / "walls", prior="walls", **how)
    plan = plan_of(read_run(folder / "walls"))
    rows.append({"map": "walls, plan", **scores(faces_of(plan), truth, ends), **plan_scores(plan, floor)})
    made("sample", folder / "polygons", preset="building", **how)
    rows.append({"map": "polygons, best map", **scores(best_edges(read_run(folder / "polygons")), truth, ends)})
    made("grid", folder / "grid.npz", laser=log, **{"grid.resolution": 0.05})
    lines = grid_lines(folder / "grid.npz")
    if lines is not None:
        rows.append({"map": "grid, Hough lines", **scores(lines, truth, ends)})
    for row in rows:
        say(f"{family} {number} {row['map']:20} " + "  ".join(f"{k} {v:.3f}" for k, v in row.items() if k != "map"))
    return [{"world": f"{family}-{number}", **row} for row in rows]


def main() -> None:
    """Map the floors and write plans.json."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--worlds", type=int, default=3)
    asked.add_argument("--family", choices=FAMILIES, default="offices")
    options = commands.parse(asked)
    rows = [row for number in range(options.worlds) for row in one_world(options.family, number, options)]
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / f"plans-{options.family}.json").write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
