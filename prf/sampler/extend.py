"""Going on from a run with more readings.

The posterior is that of the readings of the run and of the new ones together, under the prior and the sensors of the
run. Only where chains start is the run's: from its last maps, with what new readings show of ground that it did not see
(:mod:`prf.sampler.continued`), and in ground that no reading concerns near a draw of the prior. Burn-in is left out as
in any run, so that the law is that of one run on everything.
"""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Configuration
from prf.model.coloring import Coloring
from prf.model.layout import image_grid, pixel_centres
from prf.model.walls import map_of_walls
from prf.model.window import Window
from prf.poses.body import body_of, joined
from prf.poses.model import LocalReadings, PoseModel
from prf.poses.plane import seen_from
from prf.readings import Kind, LogNotes, PointTable, Readings, join_logs
from prf.readings.ground import seen_cells, thin_beams
from prf.readings.several import warn_of_frames
from prf.results import PosteriorImage, RunData, names
from prf.sampler.continued import Earlier
from prf.sampler.forget import forgetting
from prf.sampler.prepare import Prepared, chosen_tiles, make_target, prepare_whole
from prf.sampler.target import Target, Tuning
from prf.shell.cli.settings import Loaded, places_of
from prf.shell.cli.storage import describe_input
from prf.shell.errors import ConfigError, InputError

logger = logging.getLogger(__name__)

NEAR = 0.2
"""Metres from ground that a run saw up to which it knows what stands there."""
MOST_BEAMS = 20_000
"""Beams with which a run goes on that forgets, about; of new ones at least :data:`LEAST_ROOM` all the same."""
LEAST_ROOM = 0.2
FIRST_DENSITY, LESS = 64.0, 0.8
"""Beams a square metre where thinning begins if none is asked for, and by what it is lowered until it will do."""
KEPT = ("prior", "laser", "sonar", "points", "thinning", "driven", "trajectory")
"""Tables of which an extension has the values of its run; but for the window."""


def extended_configuration(run: RunData, stored: Configuration, requested: Loaded[Configuration]) -> Configuration:
    """Return the configuration of a run that goes on from one: its own, with readings and chains as requested.

    `stored`: that of the run, as resolved.

    Raises
    ------
    ConfigError
        If another prior, sensor or frame is requested, or a window that does not hold the run's.
    """
    wanted, default = requested.settings, type(stored)()
    for place in places_of(Configuration, (*KEPT, "readings.frame")):
        value, source = wanted.get(place), requested.sources.get(place, place)
        is_asked = place in requested.sources or value != default.get(place)
        if place != "prior.window" and is_asked and value != stored.get(place):
            raise ConfigError(
                f"{source} {value}: the run to extend has {stored.get(place)}. Leave it out, or sample all logs anew."
            )
    window = wanted.prior.window
    if window is not None and Window(*window).joined(run.draws.window) != Window(*window):
        held = " ".join(f"{each:g}" for each in run.draws.window)
        raise ConfigError(f"--window {' '.join(f'{each:g}' for each in window)}: must hold the run's, {held}.")
    sampler = {
        name: value if f"sampler.{name}" in requested.sources or value != getattr(default.sampler, name) else kept
        for (name, value), kept in zip(wanted.sampler, dict(stored.sampler).values(), strict=True)
    }
    # What its readings had chosen is chosen anew by all of them.
    chosen = {"window": window, "resolution": wanted.sampler.resolution, "tiles": wanted.sampler.tiles}
    given = run.manifest.get("sources", {})
    kept = {name: value for name, value in chosen.items() if value is not None or name not in given}
    return stored.model_copy(update={"readings": wanted.readings}).replace(**sampler | kept)


def prepare_extension(
    run: RunData,
    config: Configuration,
    laser: Readings | None,
    sonar: Readings | None,
    observed: PointTable | None,
    forget: bool = False,
) -> Prepared:
    """Return the readings of a run and new ones, of whole logs, made ready for its chains to go on.

    `forget`: let readings of the run go where its draws agree (:mod:`prf.sampler.forget`).
    """
    image = _check(run)
    placed = run.placed()
    before = dataclasses.replace(placed, laser=_named(placed, "laser"), sonar=_named(placed, "sonar"))
    new = prepare_whole(config, laser, sonar, observed, run.draws.window)
    if before.laser is not None and new.target.laser is not None:
        warn_of_frames([before.laser, new.target.laser.readings])
    forgotten: dict[str, Any] = {}
    left = before
    if forget and before.laser is not None:
        standing, forgotten = forgetting(run, before.laser)
        left = dataclasses.replace(before, laser=standing)
    beams = _joined(left.laser, new.target.laser)
    rows = np.zeros(0, np.int64)
    if beams is not None:
        rows, share = _thinned(beams, new.config, MOST_BEAMS if forget else np.inf)
        beams = dataclasses.replace(beams, share=share)
    n_thinned = new.n_beams_thinned + int(run.manifest.get("n_beams_thinned", 0))
    n_thinned += 0 if beams is None else beams.n_beams - len(rows)
    known = _widened(image)
    poses = _joined_poses(run, left if forgotten else None, new.target, rows)
    kept = None if beams is None else beams.select(rows)
    target, resolved = _target(before, image, new, kept, poses, config.sampler.tiles)
    return new._replace(
        target=target,
        config=resolved,
        n_beams_thinned=n_thinned,
        counts=new.counts if run.counts is None else run.counts.joined(new.counts, target.window),
        earlier=tuple(Earlier(each, known) for each in last_maps(run, resolved.sampler.chains)),
        before={"inputs": run.manifest.get("inputs", []), "extends": _source(run), **forgotten},
    )


def _widened(image: PosteriorImage) -> PosteriorImage:
    """Return the image with ground as seen up to :data:`NEAR` from what was: returns by a wall lie about it."""
    from scipy import ndimage  # noqa: PLC0415 - a fifth of a second, where a run is gone on from alone

    away = ndimage.distance_transform_edt(~image.seen) if image.seen.any() else np.full(image.seen.shape, np.inf)
    return image._replace(seen=away * image.resolution <= NEAR)


def _target(
    before: RunData,
    image: PosteriorImage,
    new: Prepared,
    beams: Readings | None,
    poses: PoseModel | None,
    tiles: int | None,
) -> tuple[Target, Configuration]:
    """Return the target of all readings, and the configuration with what is chosen by them.

    `new`: those that the run `before` did not have, made ready alone. `beams`: all of the laser. `poses`: uncertain
    ones of all readings.
    """
    cones = _joined(before.sonar, new.target.sonar)
    points = _joined_points(before.points, None if new.target.points is None else new.target.points.readings)
    n_readings = sum(part.n_beams for part in (beams, cones) if part is not None)
    window, old = new.target.window, new.config
    chosen = chosen_tiles(window, n_readings) if tiles is None else tiles
    max_range = old.laser.max_range if beams is None else beams.max_range
    resolved = old.replace(tiles=0 if old.sampler.is_tempered else chosen, max_range=max_range)
    grid = image_grid(window, resolved.sampler.resolution or image.resolution)
    seen = image.seen_at(pixel_centres(grid)).reshape(grid.ny, grid.nx)
    # Its beams may have gone on where its window ended.
    seen |= seen_cells(window, grid.cell, before.laser, before.sonar, before.points)
    seen |= False if new.target.seen is None else new.target.seen
    way = np.unique(np.concatenate([before.way, new.target.way]), axis=0)
    tuning = Tuning(first_new_log=0 if before.laser is None else len(before.laser.names))
    if poses is not None:  # from the model, as a run is resumed: else bits differ
        beams, cones = poses.placed(beams, cones, poses.start)
    target = make_target(resolved, beams, cones, points)
    return dataclasses.replace(target, way=way, seen=seen, tuning=tuning, poses=poses), resolved


def last_maps(run: RunData, n_chains: int) -> tuple[Coloring, ...]:
    """Return the map that each of so many chains goes on from: the last of a chain, or an earlier one of it.

    Of a run of walls it is their rectangles (:func:`prf.model.walls.map_of_walls`).
    """
    own = [np.flatnonzero(run.chain == chain) for chain in np.unique(run.chain)]
    rounds = -(-n_chains // len(own))
    picked = [own[i % len(own)] for i in range(n_chains)]
    back = [(i // len(own)) * len(rows) // (2 * rounds) for i, rows in enumerate(picked)]
    draws = [int(rows[-1 - each]) for rows, each in zip(picked, back, strict=True)]
    if run.walls is not None:
        return tuple(map_of_walls(run.walls[draw], run.draws.window) for draw in draws)
    return tuple(Coloring(*run.draws[draw]) for draw in draws)


def _joined_poses(run: RunData, left: RunData | None, new: Target, rows: NDArray[np.int64]) -> PoseModel | None:
    """Return the uncertain poses of a run, which start at their means, and of new readings; None of certain ones.

    `left`: what is left of the run if it is let go of, at the mean poses. `rows`: beams of all that are kept.
    """
    if run.trajectory is None or new.poses is None:
        return None
    found, kept = (joined(run.trajectory), run) if left is None else (body_of(run.trajectory), left)
    assert found.prior is not None
    at = found.given if left is None else found.mean
    local: list[LocalReadings | None] = []
    for readings, owner in ((kept.laser, found.laser), (kept.sonar, found.sonar)):
        if readings is None:
            local.append(None)
            continue
        of = np.zeros(readings.n_beams, np.int32) if owner is None else owner
        seen = seen_from(at[of], np.column_stack([readings.origin, readings.angle]))
        local.append(LocalReadings(of, np.ascontiguousarray(seen[:, :2]), seen[:, 2].copy()))
    before = PoseModel(found.prior, found.scan, found.time, found.mean, laser=local[0], sonar=local[1])
    numbered = kept.sonar if kept.laser is None else kept.laser
    model = before.followed_by(new.poses, 0 if numbered is None else sum(numbered.lengths))
    n_cones = 0 if model.sonar is None else len(model.sonar.owner)
    return model.used(rows, np.arange(n_cones))


def _check(run: RunData) -> PosteriorImage:
    """Return the image of a run that can be gone on from."""
    if len(run.draws) == 0:
        raise InputError(f"{run.name}: no draws yet to go on from. Resume it with prf sample --resume.")
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    if run.laser is None and run.sonar is None and run.points is None:
        raise run.missing(names.READINGS)
    poses = run.trajectory
    if poses is not None and (poses.prior is None or len(poses.prior.motion) > 0):
        raise ConfigError(f"{run.name}: its poses are of odometry, which says nothing of those of other logs.")
    return run.image


def _named(run: RunData, kind: Kind) -> Readings | None:
    """Return the readings of a kind that a run has, with the names of their logs."""
    readings: Readings | None = getattr(run, kind)
    if readings is None:
        return None
    n = 1 + int(readings.log.max(initial=0))
    known = list(run.manifest.get("logs", {}).get(kind, []))
    return dataclasses.replace(readings, notes=LogNotes(names=tuple((known + [run.name] * n)[:n])))


def _joined(before: Readings | None, new: Any) -> Readings | None:
    """Return the readings of a run and new ones of a kind, under the maximum range of the run."""
    parts = [part for part in (before, None if new is None else new.readings) if part is not None]
    if not parts:
        return None
    joined = join_logs(parts)
    return joined.within(parts[0].max_range)


def _thinned(beams: Readings, config: Configuration, most: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return which beams of all logs stay, as of one they would, and `most` at most; all that stand for others do.

    With the share (n_beams,) that is then left of such as each.
    """
    window, density = Window(*(config.prior.window or ())), config.thinning.beam_density or 0.0
    alone = np.flatnonzero(beams.weight == 1.0)
    origin, angle, ranges = (each[alone] for each in (beams.origin, beams.angle, beams.range))
    stays, share = beams.weight != 1.0, beams.share.copy()
    room = max(most - np.count_nonzero(stays), LEAST_ROOM * len(alone))
    while True:
        chosen, left = thin_beams(window, origin, angle, ranges, beams.max_range, density, share[alone])
        if len(chosen) <= room:
            break
        density = LESS * (density or FIRST_DENSITY)
    stays[alone[chosen]] = True
    share[alone[chosen]] = left
    return np.flatnonzero(stays), share


def _joined_points(before: PointTable | None, new: PointTable | None) -> PointTable | None:
    if before is None or new is None:
        return new or before
    xy, value, line = (np.concatenate(parts) for parts in zip(before[:3], new[:3], strict=True))
    return PointTable(xy, value, line, new.source)


def _source(run: RunData) -> dict[str, Any]:
    """Return what a manifest says of the run that another one goes on from."""
    laser = _named(run, "laser")
    found: dict[str, Any] = {
        "run": str(run.path),
        "seed": run.manifest.get("seed"),
        "steps": run.manifest.get("steps"),
        "n_laser_logs": 0 if laser is None else len(laser.names),
    }
    if run.path is not None:
        found["manifest"] = describe_input(run.path / names.MANIFEST)["sha256"]
    return found
