"""`simulate`: a world, a drive through it, and the map that odometry renders from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import SimulateSettings
from mapq.simulate.laser import Returns, choose_beams, count_beams, make_beams, observe
from mapq.simulate.layout import Plan, add_block, block_waypoints, draw_plan
from mapq.simulate.robot import Trajectory, drive_along, odometry
from mapq.simulate.scene import MOVING, NO_SURFACE, Frame, Kind, SceneBuilder, World
from mapq.simulate.street import add_traffic
from mapq.simulate.truth import Observed, Truth, judge
from prf.shell.cli.storage import spawn_generators

Floats = NDArray[np.float64]

CHUNK = 200_000
"""Beams cast at once: enough for speed, few enough for progress and memory."""

PROBE = 6_000
"""Beams cast to find out how many return."""

UPRIGHT = 0.1
"""Largest upward component of the normal of what counts as a vertical surface."""

SEEN = 20
"""Points from which on a surface counts as seen."""


class Report(NamedTuple):
    """A simulated map in numbers: lengths in metres, the drive in seconds, shares of points.

    `suspicious_wall_points` and `look_alike_points` are shares of the points on vertical surfaces, `suspicious_cells`
    of their cells; `surfaces` counts vertical surfaces with `SEEN` points, `look_alike_surfaces` is a share of these.
    """

    points: int
    passes: int
    path_length: float
    duration: float
    final_drift: float
    final_drift_deg: float
    suspicious_points: float
    suspicious_wall_points: float
    suspicious_cells: float
    surfaces: int
    look_alike_points: float
    look_alike_surfaces: float
    points_by_kind: dict[str, int]


class Simulation(NamedTuple):
    """A simulated map: its points in the order of time, with the fields of docs/simulation.md, and its numbers."""

    cloud: PointCloud
    report: Report


def simulate(settings: SimulateSettings, seed: int) -> PointCloud:
    """Return a simulated map with its truth, see :func:`simulate_with_report`."""
    return simulate_with_report(settings, seed).cloud


def simulate_with_report(
    settings: SimulateSettings, seed: int, progress: Callable[[float], None] = lambda share: None
) -> Simulation:
    """Build a world, drive through it, and render the map from odometry.

    Section 4 and figure 4 of the paper: a street lined with offices (A), twice round a block (B to E), on under an
    archway (F); a 2D laser that nods. The same settings and seed give the same map; the world does not depend on the
    drift, nor on how many points are wanted.

    Parameters
    ----------
    settings : SimulateSettings
    seed : int
        Not negative.
    progress : callable
        Called with the share of the beams that are cast.
    """
    in_world, in_traffic, in_drift, in_choice, in_laser = spawn_generators(seed, 5)
    builder = SceneBuilder()
    way = _build(builder, settings, in_world)
    add_traffic(builder, way, settings, in_traffic)
    world = builder.finish(settings.max_range)
    believed = odometry(way, settings, in_drift)
    numbers = _wanted_beams(world, way, settings, in_choice)
    parts = []
    for first in range(0, len(numbers), CHUNK):
        beams = make_beams(numbers[first : first + CHUNK], way, settings.speed, settings.all_round)
        parts.append(observe(world, beams, settings, in_laser))
        progress(min(1.0, (first + CHUNK) / len(numbers)))
    returns = Returns(*(np.concatenate(values) for values in zip(*parts, strict=True)))
    return _render(world, returns, way, believed, settings)


def _build(builder: SceneBuilder, settings: SimulateSettings, rng: np.random.Generator) -> Trajectory:
    """Build all blocks, each where the pathway of the one before ends and on its other side; return the way."""
    waypoints = []
    start, heading, side = np.zeros(2), 0.0, 1.0
    for block in range(settings.blocks):
        plan = draw_plan(settings, rng)
        frame = _frame(plan, start, heading, side)
        add_block(builder, plan, frame, block == settings.blocks - 1, settings, rng)
        points = block_waypoints(plan, frame, settings.loops, rng)
        waypoints += points if block == 0 else points[1:]
        direction = frame.turn(plan.exit_direction)
        start, heading = points[-1].xy, float(np.arctan2(direction[1], direction[0]))
        side = -side
    return drive_along(waypoints, rng)


def _frame(plan: Plan, start: Floats, heading: float, side: float) -> Frame:
    """Return the frame in which the plan's street begins at `start` and runs along `heading`."""
    along = plan.bend - plan.start
    turned = Frame(np.zeros(2), heading - side * float(np.arctan2(along[1], along[0])), side)
    return turned._replace(origin=start - turned.place(plan.start))


def _wanted_beams(
    world: World, way: Trajectory, settings: SimulateSettings, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return the numbers of the beams that give about the wanted number of points."""
    n_all = count_beams(way, settings.speed)
    probe = make_beams(choose_beams(n_all, PROBE, rng), way, settings.speed, settings.all_round)
    share = len(observe(world, probe, settings, rng).time) / len(probe.time)
    return choose_beams(n_all, round(settings.n_points / max(share, 0.01)), rng)


def _render(
    world: World, returns: Returns, way: Trajectory, believed: Trajectory, settings: SimulateSettings
) -> Simulation:
    """Return the map: every return placed from where odometry has the robot at its time."""
    driven = settings.speed * returns.time
    _, heading = way.at(driven)
    origin, believed_heading = believed.at(driven)
    turn = believed_heading - heading
    c, s = np.cos(turn), np.sin(turn)

    def placed(points: Floats) -> Floats:
        away = points[:, :2] - returns.origins[:, :2]
        x, y = c * away[:, 0] - s * away[:, 1], s * away[:, 0] + c * away[:, 1]
        return np.column_stack([origin[:, 0] + x, origin[:, 1] + y, points[:, 2]])

    moved = placed(returns.hits)[:, :2] - returns.hits[:, :2]
    seen = _seen(world, returns, moved)
    truth = judge(seen, settings)
    pass_id = np.searchsorted(way.pass_starts, driven, side="right").astype(np.int16)
    points = placed(returns.measured)
    to_sensor = np.column_stack([origin, returns.origins[:, 2]]) - points
    fields = _fields(world, returns, seen, truth, pass_id)
    fields |= {f"to_sensor_{axis}": to_sensor[:, k].astype(np.float32) for k, axis in enumerate("xyz")}
    cloud = PointCloud.from_world(points.astype(np.float32), fields, "simulated")
    return Simulation(cloud, summarise(cloud, world, truth, way, believed, settings))


def _seen(world: World, returns: Returns, moved: Floats) -> Observed:
    """Return what the rule of truth needs."""
    never = returns.mixed | np.isin(world.kind[returns.items], MOVING)
    surface = np.where(returns.mixed, NO_SURFACE, world.surface[returns.items])
    thing = np.where(never, -1, world.thing[returns.items])
    normal = world.normal[np.maximum(surface, 0)]
    return Observed(returns.hits, moved, returns.time, surface.astype(np.int32), thing.astype(np.int32), normal)


def _fields(
    world: World, returns: Returns, seen: Observed, truth: Truth, pass_id: NDArray[np.int16]
) -> dict[str, NDArray[np.generic]]:
    """Return the fields of the map's points."""
    kind = np.where(returns.mixed, np.uint8(Kind.MIXED), world.kind[returns.items])
    look_alike = (seen.surface >= 0) & find_look_alikes(world, seen.surface)[np.maximum(seen.surface, 0)]
    return {
        "truth": truth.suspicious.astype(np.uint8),
        "surface": seen.surface,
        "kind": kind.astype(np.uint8),
        "time": returns.time,
        "pass_id": pass_id,
        "disagreement": truth.disagreement.astype(np.float32),
        "look_alike": look_alike.astype(np.uint8),
    }


def summarise(
    cloud: PointCloud, world: World, truth: Truth, way: Trajectory, believed: Trajectory, settings: SimulateSettings
) -> Report:
    """Return the numbers of one map."""
    surface = cloud.fields["surface"]
    upright = (surface != NO_SURFACE) & (np.abs(world.normal[np.maximum(surface, 0), 2]) < UPRIGHT)
    kinds = np.bincount(cloud.fields["kind"], minlength=len(Kind))
    sizes = np.bincount(surface[upright], minlength=len(world.normal))
    bad_cells = np.unique(truth.cell[upright & truth.suspicious])
    return Report(
        len(cloud),
        int(cloud.fields["pass_id"].max(initial=-1)) + 1,
        way.length,
        way.length / settings.speed,
        float(np.hypot(*(believed.xy[-1] - way.xy[-1]))),
        float(np.degrees(abs(believed.heading[-1] - way.heading[-1]))),
        _share(truth.suspicious),
        _share(truth.suspicious[upright]),
        len(bad_cells) / max(len(np.unique(truth.cell[upright])), 1),
        int(np.count_nonzero(sizes >= SEEN)),
        _share(cloud.fields["look_alike"][upright]),
        _share(find_look_alikes(world, surface)[sizes >= SEEN]),
        {kind.name.lower(): int(kinds[kind]) for kind in Kind},
    )


def find_look_alikes(world: World, surface: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return which surfaces (n_surfaces,) look like an error but are right, given the surface (n,) of each point.

    Of two walls close to each other both must be seen: one face of a gap between buildings is a wall like any other.
    """
    seen = np.bincount(surface[surface != NO_SURFACE], minlength=len(world.normal)) >= SEEN
    return np.asarray((world.partner != NO_SURFACE) & seen & seen[world.partner])


def _share(flags: np.ndarray) -> float:
    return float(flags.mean()) if len(flags) else 0.0
