"""Uncertain poses of a chain: turns in which they move, between those in which the map does (docs/poses.md).

Given the poses, the map is sampled as usual. Given the map, poses move, and at times the map with them; then the lists
of beams, cones and sensors are laid out anew.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.poses.match import measure_spread
from prf.kernels.poses.state import LOG_POSE_PRIOR, N_LOCAL, N_POSE_SUMS, POSE_MOVES, WARP, Poses, place_readings
from prf.kernels.poses.turn import run_poses
from prf.kernels.readings.cones import N_POSE, READING
from prf.kernels.readings.sonar import SONAR_MAX
from prf.kernels.readings.sonar_features import MAY_CROSS
from prf.kernels.state.build import recompute_sums, trace_all
from prf.kernels.state.chain import Chain
from prf.model.layout import make_sites
from prf.model.ranges import make_beams, make_cones
from prf.poses.model import LocalReadings, PoseModel
from prf.poses.plane import wrapped
from prf.sampler.bends import NO_FIELDS, Fields, soft_fields
from prf.sampler.schedules import Plain, Steps
from prf.sampler.target import NO_LASER, NO_SONAR, Target, poses_of, rays_of, repaint, settle_image
from prf.shell.cli.console import progress

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAP_STEPS = 4_000
MOST_MAP_STEPS = 64_000
"""Steps of the map in a cycle: the least, which has a turn on the whole window and one in a region, and the most. In
between about as many as there are readings, since a turn of poses lays all of them out."""
STEPS_PER_POSE = 2
LEAST_POSE_STEPS = 200
MOST_POSE_STEPS = 4_000
"""Steps of poses in a cycle."""
WARPS = 16.0
"""Steps of poses in a cycle that move the map with them, about."""
FIRST_SPREAD = 0.1
"""Of what a pose may vary by, over the errors of the given ones, before it was measured."""


class PoseTurns(Plain):
    """The poses of one chain, and turns of theirs between those of its map; `state` is what the kernels hold."""

    def __init__(self, target: Target, chain: Chain, map_schedule: Plain) -> None:
        assert target.poses is not None
        self.target, self.map_schedule, self.first = target, map_schedule, target.poses.start
        self.state = make_poses(target, target.poses, chain)
        n, n_readings = len(self.state.pose), len(self.state.beam_of) + len(self.state.cone_of)
        self.map_steps = min(MOST_MAP_STEPS, MAP_STEPS * max(1, math.ceil(n_readings / MAP_STEPS)))
        self.pose_steps = int(np.clip(STEPS_PER_POSE * n, LEAST_POSE_STEPS, MOST_POSE_STEPS))
        self.warps = WARPS / self.pose_steps

    @property
    def log_prior(self) -> float:
        """Log prior of the present poses, up to a constant."""
        return float(self.state.sums[LOG_POSE_PRIOR])

    def turn(self, step: int, stop: int, end: int) -> tuple[Steps, int]:
        """Return the next steps: alternating between the map and poses."""
        cycle = self.map_steps + self.pose_steps
        begun = step - step % cycle
        if step < begun + self.map_steps:
            return self.map_schedule.turn(step, min(stop, begun + self.map_steps), end)
        return self.move, min(stop, begun + cycle)

    def move(self, chain: Chain, rng: np.random.Generator, step: int) -> Chain:
        """Move the poses of a chain up to `step`, and lay its readings out anew."""
        graph, index, state = chain.graph, chain.edge_index, self.state
        if chain.image.black.size > 0:
            settle_image(chain)
        warped = int(state.outcomes[WARP, c.ACCEPTED])
        names = ("vertex_xy", "vertex_sine", "edge_xy", "edge_length")
        trial = graph._replace(**{name: getattr(graph, name).copy() for name in names})
        trial_index = index._replace(cell_count=index.cell_count.copy(), cell_edges=index.cell_edges.copy())
        run_poses(chain, trial, trial_index, state, self.warps, step, rng)
        chain = self.laid_out(chain)
        recompute_sums(chain)
        if state.outcomes[WARP, c.ACCEPTED] > warped:
            repaint(chain)
        return chain

    def start(self, chain: Chain) -> Chain:
        """Put the poses of a chain where it starts, or, if a sensor left the window there, where scans agree best."""
        chain = self.place(chain, self.first)
        if self.target.window.contains(self.sites(), strictly=True).all():
            return chain
        assert self.target.poses is not None
        return self.place(chain, self.target.poses.start)

    def place(self, chain: Chain, pose: Floats) -> Chain:
        """Put the poses of a chain at `pose` (n, 3), and all its readings with them."""
        self.state.pose[:] = pose
        chain = self.laid_out(chain)
        trace_all(chain)
        recompute_sums(chain)
        return chain

    def laid_out(self, chain: Chain) -> Chain:
        """Return the chain with beams, cones and sensors listed where they are now; sums must follow."""
        grid, capacity, target = chain.edge_index.grid, len(chain.graph.edge_length), self.target
        laser, sonar = target.laser or NO_LASER, target.sonar or NO_SONAR
        # Once more from the poses alone: what was added up on the way depends on it.
        maximum = float(chain.cones.model[SONAR_MAX])
        place_readings(self.state, chain.graph.window, chain.beams.model, maximum, chain.beams.ray, chain.cones.pose)
        n_levels = chain.beams.first_beam.shape[1]
        beams = make_beams(grid, laser.model, chain.beams.ray, laser.readings.weight, capacity, n_levels)
        cones = make_cones(grid, sonar.model, chain.cones.pose, capacity)
        cones.sight.counts[MAY_CROSS] = chain.cones.sight.counts[MAY_CROSS]
        return chain._replace(
            beams=beams._replace(impact_edge=chain.beams.impact_edge),
            cones=cones,
            sensors=make_sites(grid, np.concatenate([self.sites(), target.way[:, :2], target.way[:, 2:]])),
        )

    def sites(self) -> Floats:
        """Return where sensors are now, (n_sites, 2) in metres."""
        state = self.state
        owner = np.repeat(np.arange(len(state.pose)), np.diff(state.site_start))
        local = LocalReadings(owner.astype(np.int32), state.site_local, np.zeros(len(owner)))
        return local.at(state.pose)[0]

    def offsets(self) -> NDArray[np.float32]:
        """Return the present poses less the given ones (n, 3), headings in [-pi, pi)."""
        offset = self.state.pose - self.state.given
        offset[:, 2] = wrapped(offset[:, 2])
        return np.asarray(offset, np.float32)

    def begin(self, chain: Chain) -> None:
        """Scale random walks by the first map."""
        self.measure(chain)

    def measure(self, chain: Chain) -> None:
        """Scale random walks by what poses may vary by on the present map; find how both can bend together."""
        measure_spread(chain.graph, chain.edge_index, chain.beams, self.state)
        assert self.target.poses is not None
        self.bend(soft_fields(chain, self.state, self.target.poses.prior))

    def bend(self, fields: Fields) -> None:
        """Let proposals displace map and poses by mixtures of these fields."""
        grid, found = fields
        self.state = self.state._replace(fields=found, field_grid=grid, mixture=np.zeros(found.shape[1:]))


def start_apart(turns: Sequence[PoseTurns], generators: Sequence[np.random.Generator], threads: int = 1) -> None:
    """Have the chains of a target start at draws of their poses, about, in pairs that are disturbed in opposite ways.

    They start apart as the posterior is wide, and the mean of all is about where scans agree best: a chain leaves its
    start but slowly. Where there are several ways that the robot may have gone, pairs share these. So many `threads`
    draw at once, which changes no bit.
    """
    model = turns[0].target.poses if turns else None
    if model is None or (draw := model.draw_start) is None:
        return
    seeds = [int(rng.integers(2**62)) for rng in generators[: len(turns) : 2]]
    shares, is_over = np.zeros(len(turns)), threading.Event()

    def drawn(k: int) -> Floats:
        def report(share: float) -> None:
            shares[k] = share
            show(float(shares.sum()))
            if is_over.is_set():
                raise CancelledError

        way = (k // 2 + 0.5) / len(seeds)
        return draw(np.random.default_rng(seeds[k // 2]), 1.0 if k % 2 == 0 else -1.0, way, report)

    with progress(len(turns), "drawing starts") as show, ThreadPoolExecutor(threads) as pool:
        try:
            for each, found in zip(turns, pool.map(drawn, range(len(turns))), strict=True):
                each.first = found
        finally:
            is_over.set()  # Ctrl-C does not wait for draws of ten seconds


def make_poses(target: Target, model: PoseModel, chain: Chain) -> Poses:
    """Lay out the poses of a chain at the start of their model."""
    prior, n = model.prior, len(model.start)
    beam_start, beam_of, beam_local = _by_pose(model.laser, n)
    cone_start, cone_of, cone_local = _by_pose(model.sonar, n)
    site_start, site_local = _sites(model, n)
    rays, cone_poses = rays_of(target), poses_of(target)
    half = np.zeros(0) if target.sonar is None else 0.5 * target.sonar.readings.cone
    room = chain.edge_index.grid.nx * chain.edge_index.grid.ny if len(half) else 1
    spread = np.zeros((n, 6))
    errors = np.where(np.isfinite(prior.noise), FIRST_SPREAD * prior.noise, 0.01)
    spread[:, [0, 2, 5]] = errors[:, [0, 0, 1]]
    reading = rays[beam_of, c.RANGE]
    return Poses(
        pose=model.start.copy(),
        start=model.start.copy(),
        given=prior.given.copy(),
        precision=1.0 / prior.noise**2,
        motion=prior.motion.copy(),
        weight=1.0 / prior.spread**2,
        slip=prior.log_slip,
        spread=spread,
        fields=NO_FIELDS.coefficients,
        field_grid=NO_FIELDS.grid,
        mixture=np.zeros(NO_FIELDS.coefficients.shape[1:]),
        beam_start=beam_start,
        beam_of=beam_of,
        beam_local=beam_local,
        returned=(np.isfinite(reading) & (reading >= 0.0)).astype(np.uint8),
        cone_start=cone_start,
        cone_of=cone_of,
        cone_local=cone_local,
        cone_half=half[cone_of],
        cone_reading=cone_poses[cone_of, READING],
        site_start=site_start,
        site_local=site_local,
        new_pose=np.zeros((n, 3)),
        new_ray=np.zeros((len(beam_of), c.N_RAY)),
        new_edge=np.zeros(len(beam_of), np.int32),
        new_cone=np.zeros((len(cone_of), N_POSE)),
        cells=np.zeros(room, np.int32),
        near=np.zeros(room),
        work=np.zeros(48),
        outcomes=np.zeros((len(POSE_MOVES), c.N_OUTCOMES), np.int64),
        sums=np.zeros(N_POSE_SUMS),
    )


def _by_pose(readings: LocalReadings | None, n: int) -> tuple[Ints, NDArray[np.int32], Floats]:
    """Return readings by their poses: starts (n + 1,), numbers (n_readings,), and local ones (n_readings, N_LOCAL)."""
    if readings is None:
        return np.zeros(n + 1, np.int64), np.zeros(0, np.int32), np.zeros((0, N_LOCAL))
    of = np.argsort(readings.owner, kind="stable").astype(np.int32)
    start = np.append(0, np.cumsum(np.bincount(readings.owner, minlength=n))).astype(np.int64)
    angle = readings.angle[of]
    return start, of, np.column_stack([readings.origin[of], np.cos(angle), np.sin(angle)])


def _sites(model: PoseModel, n: int) -> tuple[Ints, Floats]:
    """Return where the distinct places of sensors of each pose begin (n + 1,), and these (n_sites, 2) on the robot."""
    parts = [part for part in (model.laser, model.sonar) if part is not None]
    rows = [np.column_stack([part.owner, np.round(part.origin, 9)]) for part in parts]
    found = np.unique(np.concatenate([np.zeros((0, 3)), *rows]), axis=0)
    start = np.searchsorted(found[:, 0], np.arange(n + 1))
    return start.astype(np.int64), np.ascontiguousarray(found[:, 1:])
