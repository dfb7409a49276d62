"""Where to look next: `prf explore` beside random places, the nearest frontier and the information of a grid.

python -m benchmarks.explore poses [SEED ...]    # predicted and realised gains in half mapped buildings
python -m benchmarks.explore drive [SEED ...]    # metres until a robot knows 95 % of what it can reach
python -m benchmarks.explore table               # of what the other two have written
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

import prf
from benchmarks.commands import OUTPUT, say
from benchmarks.explore_rivals import grid_information, grid_of, nearest_frontier, seen_closed
from prf.configuration import LaserPhysics
from prf.output.run import Run
from prf.readings import Readings
from prf.results.explore.gain import N_BEAMS
from prf.results.explore.question import ask, cells_of, gain_at
from prf.results.explore.reach import reachable
from prf.results.explore.scanner import first_walls, scanner_of
from prf.results.explore.search import candidates, thinned
from prf.results.occupancy import OccupancyGrid
from prf.simulate import Roadmap, World, office, plan_drive, roadmap, scans_along, simulate_laser
from prf.simulate.sensors import bearings_of

TUNED, JUDGED = range(101, 107), range(1, 21)
DRIVEN = range(1, 5)
SIZE, DRIVE_SIZE, RADIUS = (12.0, 9.0), (18.0, 12.0), 0.25
PHYSICS = LaserPhysics(max_range=8.0)
STEPS, DRIVE_STEPS = 1_000_000, 250_000
N_RANDOM = 2
FINE, COARSE = 0.1, 0.2
"""Sides of the cells of grids, metres: fine ones to drive in; coarse ones between which no beam of a scan slips."""
SEEDS_BEFORE, SEEDS_AFTER = 3, 2
KNOWN = 0.95
MOST_LEGS = 60
COLUMNS = ("predicted", "realised", "in_view", "nll", "metres")
DRIVE_SPACING = (0.5, 0.5)

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Building(NamedTuple):
    """A world, the poses (n, 3) at which a robot has measured in it, and its readings (n, n_beams)."""

    world: World
    road: Roadmap
    pose: Floats
    ranges: Floats
    rng: np.random.Generator

    def readings(self) -> Readings:
        return prf.laser(self.pose, bearings_of(PHYSICS), self.ranges)

    def grid(self, resolution: float, method: str = "count") -> OccupancyGrid:
        """Return the grid of its readings; the side of a cell in metres."""
        return grid_of(self.readings(), self.world.window, PHYSICS.max_range, resolution, method)

    def looked(self, pose: Floats) -> Building:
        """Return it after scans at `pose` (k, 3)."""
        more = simulate_laser(self.world.walls, pose, PHYSICS, self.rng)
        return self._replace(pose=np.vstack([self.pose, pose]), ranges=np.vstack([self.ranges, more]))

    def sampled(self, seed: int, steps: int) -> Run:
        return prf.sample(
            self.readings(),
            prf.Prior(window=self.world.window),
            [prf.LaserModel(max_range=PHYSICS.max_range)],
            steps=steps,
            chains=4,
            seed=seed,
            threads=1,
            progress=False,
        )


def building_of(seed: int, share: float, size: tuple[float, float] = SIZE) -> Building:
    """Return a building in which a robot has done a share of a drive through all of it; 0: stands at its start."""
    rng = np.random.default_rng(seed)
    world = office(*size, rng)
    road = roadmap(world, RADIUS)
    pose = scans_along(plan_drive(road, 3.5)).pose
    first = pose[:1] + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi]])
    taken = pose[: int(share * len(pose))] if share > 0.0 else first
    return Building(world, road, taken, simulate_laser(world.walls, taken, PHYSICS, rng), rng)


def averaged(run: Run, cell: Floats) -> Floats:
    """Return how probably cells (n, 2) are occupied, over all steps."""
    assert run.image is not None
    column, row = np.floor((cell - run.image.origin) / run.image.resolution).astype(int).T
    return run.occupancy[row, column].astype(np.float64)


def entropies(p: Floats) -> Floats:
    """Return the entropies (n,) of probabilities, nats."""
    p = np.clip(p, 1e-9, 1.0 - 1e-9)
    return np.asarray(-p * np.log(p) - (1.0 - p) * np.log1p(-p))


def unseen_rooms(building: Building, run: Run, cell: Floats) -> Bools:
    """Return which cells are free, or wall beside what is, and were not seen."""
    assert run.image is not None
    free = shapely.difference(shapely.box(*building.world.window), building.world.occupied)
    inside = shapely.difference(free, _outdoors(building.world)).buffer(0.2)
    shapely.prepare(inside)
    return np.asarray(shapely.contains_xy(inside, cell) & ~run.image.seen_at(cell))


def _outdoors(world: World) -> Any:
    parts = shapely.get_parts(shapely.difference(shapely.box(*world.window), world.occupied))
    border = shapely.box(*world.window).exterior
    return shapely.union_all([part for part in parts if part.intersects(border)])


def nll(p: Floats, truth: Bools) -> float:
    """Return the mean of -log of the probability that cells (n,) have of what they are, nats."""
    p = np.clip(p, 1e-3, 1.0 - 1e-3)
    return float(-np.log(np.where(truth, p, 1.0 - p)).mean())


def choices(building: Building, run: Run, seed: int) -> dict[str, tuple[Floats, float, float]]:
    """Return a pose (3,) of every way to choose, the gain that is predicted there, and metres of way."""
    scanner = scanner_of(run)
    assert scanner is not None
    draws, n_chains = thinned(run.draws, run.chain)
    start = building.pose[-1, :2]
    reach = reachable(draws, start, RADIUS)
    places = candidates(reach)
    rng = np.random.default_rng(1000 + seed)
    found = run.explore(start, radius=RADIUS)
    poses = {"prf explore": (np.array([*found.xy[0], found.theta[0]]), float(found.metres[0]))}
    coarse = building.grid(COARSE, "log-odds")
    information, heading = grid_information(coarse, reach.xy[places], scanner.field_of_view, PHYSICS.max_range)
    best = int(information.argmax())
    poses["grid information"] = (np.array([*reach.xy[places[best]], heading[best]]), float(reach.metres[places[best]]))
    goal = nearest_frontier(building.grid(FINE), start, RADIUS, [])
    question = ask(draws, n_chains, None, RADIUS)
    segments = [each.segments() for each in draws]

    def predicted(xy: Floats) -> tuple[float, float]:
        distance = first_walls(segments, draws.window, xy[None], N_BEAMS, scanner)
        gain, theta = gain_at(question, distance[:, 0], xy, scanner)
        return float(gain.mean()), theta

    if goal is not None:
        poses["nearest frontier"] = (np.array([*goal.way[-1], predicted(goal.way[-1])[1]]), goal.metres)
    for number, place in enumerate(rng.choice(places, N_RANDOM, replace=False).tolist()):
        xy = reach.xy[place]
        poses[f"random {number}"] = (np.array([*xy, predicted(xy)[1]]), float(reach.metres[place]))
    return {name: (pose, max(predicted(pose[:2])[0], 0.0), metres) for name, (pose, metres) in poses.items()}


class Measured(NamedTuple):
    """What is open in a building, in the mean over runs of several seeds."""

    entropy: Floats  # (c,) nats of each cell
    nll: float  # nats a cell of unseen rooms

    @classmethod
    def of(cls, p: Floats, truth: Bools, rooms: Bools) -> Measured:
        """Return it from how probably the cells are occupied in each run (k, c)."""
        nlls = [nll(each[rooms], truth[rooms]) for each in p]
        return cls(entropies(p).mean(axis=0), float(np.mean(nlls)))


def judge(seed: int, folder: Path) -> dict[str, Any]:
    """Return for each way to choose what was predicted and what a scan from there brought."""
    building = building_of(seed, 0.5)
    runs = [building.sampled(number, STEPS) for number in range(1, SEEDS_BEFORE + 1)]
    cell = cells_of(building.world.window)
    truth, rooms = ~building.world.free_at(cell), unseen_rooms(building, runs[0], cell)
    kept = {"cell": cell, "truth": truth, "rooms": rooms, "before": np.array([averaged(run, cell) for run in runs])}
    before, rows = Measured.of(kept["before"], truth, rooms), {}
    for name, (pose, gain, metres) in choices(building, runs[0], seed).items():
        can_be = bool(building.world.free_at(pose[None, :2])[0])
        after = before
        if can_be:
            looked = building.looked(pose[None])
            again = [looked.sampled(number, STEPS) for number in range(1, SEEDS_AFTER + 1)]
            kept[name.replace(" ", "-")] = p = np.array([averaged(run, cell) for run in again])
            after = Measured.of(p, truth, rooms)
        rows[name] = {"pose": pose.tolist(), "free": can_be, "metres": metres, "predicted": gain}
        rows[name] |= fallen(before, after, cell, pose)
        say(f"{seed} {name}: {rows[name]}")
    np.savez_compressed(folder / f"cells-{seed}.npz", allow_pickle=False, **kept)
    return {"seed": seed, "entropy": float(before.entropy.sum()), "rows": rows}


def fallen(before: Measured, after: Measured, cell: Floats, pose: Floats) -> dict[str, float]:
    """Return by how much entropy fell, of all cells and of those in view of a pose (3,), and the nll of rooms."""
    offset = cell - pose[:2]
    aside = np.abs(np.angle(np.exp(1j * (np.arctan2(offset[:, 1], offset[:, 0]) - pose[2]))))
    view = (aside < 0.5 * PHYSICS.field_of_view + 0.1) & (np.hypot(*offset.T) < PHYSICS.max_range + 0.2)
    drop = before.entropy - after.entropy
    return {"realised": float(drop.sum()), "in_view": float(drop[view].sum()), "nll": before.nll - after.nll}


def known_share(building: Building) -> float:
    """Return the share of the places that the robot can reach which some beam has passed."""
    grid = building.grid(FINE)
    seen = grid.image()._replace(seen=seen_closed(grid))
    return float(seen.seen_at(building.road.xy).mean())


def driven(building: Building, way: Floats) -> tuple[Building, float]:
    """Return the building after scans along a way, to where the world stops it, and the metres driven."""
    legs = [i for i in range(1, len(way)) if not building.road.clear(way[i - 1], way[i : i + 1])[0]]
    way = way[: legs[0]] if legs else way
    if len(way) < 2:
        return building, 0.0
    metres = float(np.hypot(*np.diff(way, axis=0).T).sum())
    return building.looked(scans_along(way, DRIVE_SPACING).pose[1:]), metres


def drive(seed: int, how: str) -> dict[str, Any]:
    """Return how far a robot drives until it knows :data:`KNOWN` of what it can reach."""
    building, metres, tried = building_of(seed, 0.0, DRIVE_SIZE), 0.0, list[Floats]()
    track = [(0.0, known_share(building))]
    for leg in range(MOST_LEGS):
        if track[-1][1] >= KNOWN:
            break
        here = building.pose[-1, :2]
        way, theta = next_way(building, how, seed + leg, tried)
        if way is None:
            break
        building, length = driven(building, way)
        look = building.pose[-1:, :].copy()
        if theta is not None:
            look[0, 2] = theta
        building = building.looked(look)
        metres += length
        track.append((metres, known_share(building)))
        if length == 0.0 or track[-1][1] - track[-2][1] < 0.002:
            tried.append(way[-1])
        say(f"{seed} {how} leg {leg}: from {here.round(1)} to {way[-1].round(1)}, {metres:.1f} m, {track[-1][1]:.3f}")
    return {"seed": seed, "how": how, "track": track}


def next_way(building: Building, how: str, seed: int, tried: list[Floats]) -> tuple[Floats | None, float | None]:
    """Return the way to the next place and the heading there; None: all is known."""
    here = building.pose[-1, :2]
    if how == "frontier":
        goal = nearest_frontier(building.grid(FINE), here, RADIUS, tried)
        return (None if goal is None else goal.way), None
    run = building.sampled(seed, DRIVE_STEPS)
    found = run.explore(here, radius=RADIUS, by="gain-per-metre")
    for number in range(len(found.gain)):
        new = all(np.hypot(*(found.xy[number] - place)) > 0.5 for place in tried)
        if new and found.metres[number] > 0.3 and found.gain[number] > 1.0:
            return found.ways[number], float(found.theta[number])
    return None, None


def table(folder: Path) -> None:
    """Print the figures of what was written."""
    judged = [json.loads(path.read_text()) for path in sorted(folder.glob("poses-*.json"))]
    for which in (TUNED, JUDGED):
        rows = [one for one in judged if one["seed"] in which]
        if rows:
            _table_of(rows)
    for path in sorted(folder.glob("drive-*.json")):
        track = json.loads(path.read_text())["track"]
        done = next((f"{metres:.1f} m" for metres, share in track if share >= KNOWN), "not reached")
        print(f"{path.stem}: {done}, {len(track) - 1} legs, {track[-1][1]:.3f} known after {track[-1][0]:.1f} m")


def _table_of(rows: list[dict[str, Any]]) -> None:
    from scipy.stats import spearmanr

    every = [row for one in rows for row in one["rows"].values()]
    for name in ("realised", "in_view"):
        rank = spearmanr([(row["predicted"], row[name]) for row in every])[0]
        linear = np.corrcoef([(row["predicted"], row[name]) for row in every], rowvar=False)[0, 1]
        print(f"{len(rows)} buildings, {len(every)} poses, {name}: rank correlation {rank:.3f}, linear {linear:.3f}")
    print("| chosen by | predicted | realised | in view | nll of unseen rooms | metres | n |")
    for way in ("prf explore", "nearest frontier", "grid information", "random"):
        some = [row for one in rows for name, row in one["rows"].items() if name.startswith(way)]
        columns = [
            np.array([row[key] for row in some]) for key in ("predicted", "realised", "in_view", "nll", "metres")
        ]
        errors = [column.std(ddof=1) / len(some) ** 0.5 for column in columns]
        cells = [f"{c.mean():.3g} ± {e:.2g}" for c, e in zip(columns, errors, strict=True)]
        print(f"| {way} | {' | '.join(cells)} | {len(some)} |")


def main() -> int:
    """Run the part that is asked for, building by building; those that were done are not done again."""
    asked = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    asked.add_argument("part", choices=("poses", "drive", "table"))
    asked.add_argument("seeds", type=int, nargs="*")
    asked.add_argument("-o", "--output", type=Path, default=OUTPUT / "explore")
    options = asked.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    if options.part == "table":
        table(options.output)
        return 0
    ways = ("",) if options.part == "poses" else ("frontier", "a metre")
    for seed in options.seeds or (JUDGED if options.part == "poses" else DRIVEN):
        for how in ways:
            path = options.output / f"{options.part}-{seed}{'-' + how.replace(' ', '-') if how else ''}.json"
            if not path.exists():
                begin = time.perf_counter()
                path.write_text(
                    json.dumps(judge(seed, options.output) if options.part == "poses" else drive(seed, how))
                )
                say(f"{path}, {time.perf_counter() - begin:.0f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
