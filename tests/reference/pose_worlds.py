"""Small worlds with uncertain poses: maps and poses drawn from their priors, readings from the densities.

A laser reaches less far than the border of the window, so that a reading is of the same kind wherever its pose is.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.window import Window
from prf.poses.model import PoseModel, PosePrior, pose_model
from prf.poses.plane import Floats, compose
from prf.readings import LogNotes, Readings, ScanTable
from prf.sampler.poses import PoseTurns
from prf.sampler.schedules import Plain
from prf.sampler.target import Execution, LaserData, SonarData, Target, make_chain
from tests.reference.beams import Sensor, draw_readings
from tests.reference.slow_sonar import Cone, Ring
from tests.reference.sonar_worlds import draw_data
from tests.reference.sonar_worlds import model_of as sonar_model_of
from tests.reference.worlds import model_of

ROOM = Window(0.0, 0.0, 6.0, 6.0)
GIVEN = np.array([[2.7, 2.8, 0.3], [3.1, 3.3, 3.0], [3.5, 2.9, -3.05], [2.9, 3.1, 1.2]])
"""Two of the headings are within their errors of a half turn."""
MOUNT = np.array([0.15, -0.05])
"""Where sensors sit on the robot, metres."""


class Rig(NamedTuple):
    """How worlds are drawn."""

    scale: float = 0.25
    n: int = 3
    noise: tuple[float, float] | None = (0.1, 0.1)
    first: float = 1.0  # errors of the first pose over those of others
    odometry: tuple[float, ...] | None = None
    slip: float = 0.0
    n_beams: int = 10  # a scan
    n_cones: int = 0
    sensor: Sensor = Sensor(2.2, noise=0.1, outlier=0.1, miss=0.05)
    ring: Ring = Ring(1.5, noise=0.1, surface=(3.0, 0.3, 6.0, 3.0))
    window: Window = ROOM


LASER = Rig()
UNLIKE = Rig(first=0.3)
BOTH = Rig(n=2, n_beams=6, n_cones=4, odometry=(0.2, 0.1, 0.1, 0.1))
DRIVEN = Rig(noise=None, odometry=(0.1, 0.05, 0.05, 0.05))
SLIPPING = DRIVEN._replace(slip=0.3)
BARE = Rig(n_beams=1, sensor=Sensor(1e-3), noise=(0.5, 0.3))
"""Its beams see nothing: all that is known of a pose is its prior, and that its sensor stands in white."""


class PoseWorld(NamedTuple):
    """A posterior whose chains start at the poses of the truth."""

    coloring: Coloring
    truth: Floats  # (n, 3)
    target: Target

    @property
    def model(self) -> PoseModel:
        assert self.target.poses is not None
        return self.target.poses


def unread(rig: Rig, n_readings: int, cone: float = 0.0) -> Readings:
    """Readings without a return at the given poses, all round each."""
    given, n = GIVEN[: rig.n], np.arange(rig.n)
    bearing = np.linspace(-np.pi, np.pi, n_readings, endpoint=False) + 0.1
    local = np.column_stack([np.tile(MOUNT, (n_readings, 1)), bearing])
    world = compose(given[:, None], local[None]).reshape(-1, 3)
    table = ScanTable(n, n + 1, np.full(rig.n, n_readings), np.zeros(rig.n, int), given, n.astype(float))
    owner = np.repeat(n, n_readings)
    silent = np.full(len(world), np.inf)
    notes = LogNotes(scans=table)
    return Readings.from_arrays(world[:, :2], world[:, 2], silent, scan=owner, time=owner, cone=cone, notes=notes)


def draw_poses(prior: PosePrior, rng: np.random.Generator) -> Floats:
    """Poses of the prior; of independent errors and odometry together by rejection."""
    if prior.is_held or not len(prior.motion):
        return prior.draw(rng)
    errors, steps = prior._replace(motion=np.zeros((0, 3))), prior._replace(noise=np.inf * prior.noise)
    most = np.log1p(np.exp(prior.log_slip).sum(axis=1)).sum()
    while True:
        poses = errors.draw(rng)
        if np.log(rng.random()) < steps.log_density(poses) - most:
            return poses


def draw_pose_world(rig: Rig, rng: np.random.Generator) -> PoseWorld:
    """Poses and a map of their priors until every sensor stands in white, then readings there."""
    silent = unread(rig, rig.n_beams) if rig.n_beams else None, unread(rig, rig.n_cones, 0.5) if rig.n_cones else None
    model = pose_model(*silent, rig.noise, rig.odometry)
    errors = model.prior.noise.copy()
    errors[0] *= rig.first
    model = dataclasses.replace(model, prior=model.prior._replace(slip=rig.slip, noise=errors))
    while True:
        truth = draw_poses(model.prior, rng)
        laser, sonar = model.placed(*silent, truth)
        places = np.unique(np.concatenate([part.origin for part in (laser, sonar) if part is not None]), axis=0)
        if not rig.window.contains(places, strictly=True).all():
            continue
        coloring = exact_draws(rig.scale, rig.window, 1, rng)[0]
        if not black_at(coloring, places).any():
            break
    model = dataclasses.replace(model, start=truth)
    return PoseWorld(coloring, truth, read(rig, model, laser, sonar, coloring, rng))


def read(
    rig: Rig,
    model: PoseModel,
    laser: Readings | None,
    sonar: Readings | None,
    coloring: Coloring,
    rng: np.random.Generator,
) -> Target:
    """The posterior of readings drawn in a map by sensors where they truly are."""
    target = Target(rig.window, rig.scale, poses=model, execution=Execution(cell=0.5))
    if laser is not None:
        data = LaserData(laser, model_of(rig.sensor))
        distance = make_chain(dataclasses.replace(target, laser=data), coloring).beams.ray[:, c.DISTANCE]
        ranges = draw_readings(rig.sensor, distance, rng)
        target = dataclasses.replace(target, laser=LaserData(dataclasses.replace(laser, range=ranges), data.model))
    if sonar is not None:
        cones = [Cone(*row) for row in np.column_stack([sonar.origin, sonar.angle, sonar.cone]).tolist()]
        heard = draw_data(coloring, rig.ring, cones, rng).readings.range
        heard_at = dataclasses.replace(sonar, range=heard)
        target = dataclasses.replace(target, sonar=SonarData(heard_at, sonar_model_of(rig.ring)))
    return target


def begin(world: PoseWorld) -> tuple[Chain, PoseTurns]:
    """A chain at the truth, and how its poses move: which must not depend on the truth."""
    chain = make_chain(world.target, world.coloring)
    turns = PoseTurns(world.target, chain, Plain())
    turns.state.start[:] = world.model.prior.given
    return turns.place(chain, world.truth), turns


def scratch(chain: Chain) -> tuple[Graph, EdgeIndex]:
    """Where a warp lays out the map that it proposes."""
    names = ("vertex_xy", "vertex_sine", "edge_xy", "edge_length")
    trial = chain.graph._replace(**{name: getattr(chain.graph, name).copy() for name in names})
    index = chain.edge_index
    return trial, index._replace(cell_count=index.cell_count.copy(), cell_edges=index.cell_edges.copy())
