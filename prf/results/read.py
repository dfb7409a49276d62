"""Reading a RUN directory: every array is checked before a kernel sees it."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring, Draws
from prf.model.sensors import LARGEST_COORDINATE
from prf.model.walls import N_WALL, WallDraws
from prf.model.window import Window
from prf.poses.body import BODY
from prf.poses.model import NO_CLOSURES, Closures, PosePrior
from prf.poses.posterior import Trajectory
from prf.readings import PointTable, Readings
from prf.readings.counts import BeamCounts
from prf.results import names
from prf.results.geojson import read_map_feature
from prf.results.run import PosteriorImage, RunData
from prf.shell.cli.storage import OtherVersion, damaged, load_arrays, load_object, take_array
from prf.shell.errors import InputError

PARTS = (names.POSTERIOR, names.READINGS, names.POSES, names.MAP, names.DIAGNOSTICS)
"""Files beside manifest and draws; a run that was interrupted early may lack them, one with fixed poses has none."""


OF_SESSIONS = (("log", 0, np.int64), ("weight", 1.0, np.float64), ("share", 1.0, np.float64))
"""What readings have since runs may be gone on from; before that these values."""

LARGEST = 1e300
"""Beyond it lie whole numbers that no float holds."""


def read_run_data(path: str | os.PathLike[str], parts: Collection[str] = PARTS) -> RunData:
    """Return the run in the directory `path`."""
    folder = Path(path)
    manifest = read_manifest(folder)
    present = {name for name in parts if (folder / name).exists()}
    fields: dict[str, Any] = read_draws(folder / names.DRAWS)
    if names.POSTERIOR in present:
        fields["image"] = read_image(folder / names.POSTERIOR)
    if names.READINGS in present:
        fields |= read_readings(folder / names.READINGS)
    if names.POSES in present:
        found = read_trajectory(folder / names.POSES)
        is_whole = len(found.draws) == len(fields["chain"])
        fields["trajectory"] = dataclasses.replace(found, chain=fields["chain"]) if is_whole else found
        _check_owners(folder / names.POSES, fields)
    if names.MAP in present:
        fields["best"], fields["best_log_posterior"] = read_best(folder / names.MAP)
    if names.DIAGNOSTICS in present:
        fields["diagnostics"] = load_object(folder / names.DIAGNOSTICS, names.SCHEMAS[names.DIAGNOSTICS])
    return RunData(manifest=manifest, path=folder, **fields)


def is_run(path: str | os.PathLike[str]) -> bool:
    """Return whether `path` is a directory with the manifest of a run, of whatever version."""
    return (Path(path) / names.MANIFEST).is_file()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of the RUN directory `folder` (InputError if there is none)."""
    if not folder.exists():
        raise InputError(f"{folder}: no such directory.")
    if not folder.is_dir():
        advice = f"If it is a result of mapq: mapq report {folder}"
        raise InputError(f"{folder}: not a directory; expected a RUN that prf sample wrote. {advice}")
    if not is_run(folder):
        raise InputError(f"{folder}: no {names.MANIFEST} in it; expected a RUN that prf sample wrote.")
    return load_object(folder / names.MANIFEST, names.SCHEMAS[names.MANIFEST])


def read_draws(path: Path) -> dict[str, Any]:
    """Return the fields of :class:`RunData` that draws.npz holds."""
    arrays = load_arrays(path, names.SCHEMAS[names.DRAWS])
    draws = _take_draws(path, arrays)
    n = len(draws)
    probe_xy = take_array(path, arrays, "probe_xy", np.float64, (None, 2))
    prefix = names.FUNCTIONAL_PREFIX
    walls = None
    if names.WALLS in arrays:
        wall = take_array(path, arrays, names.WALLS, np.float64, (None, N_WALL))
        walls = WallDraws(_take_offsets(path, arrays, names.WALL_OFFSETS, n, len(wall)), wall)
    return {
        "draws": draws,
        "walls": walls,
        "chain": take_array(path, arrays, "chain", np.int32, (n,)),
        "step": take_array(path, arrays, "step", np.int64, (n,)),
        "functionals": {
            name.removeprefix(prefix): take_array(path, arrays, name, np.float64, (n,))
            for name in arrays
            if name.startswith(prefix)
        },
        "probe_xy": probe_xy,
        "probe_black": take_array(path, arrays, "probe_black", np.bool_, (n, len(probe_xy))),
    }


def _arrays_of_image(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of posterior.npz.

    Version 1 knows neither which cells were seen, so that all count as such, nor where chains disagree.
    """
    try:
        return load_arrays(path, names.SCHEMAS[names.POSTERIOR])
    except OtherVersion as error:
        if error.found != names.OLD_POSTERIOR:
            raise
    arrays = load_arrays(path, names.OLD_POSTERIOR)
    shape = take_array(path, arrays, "occupancy", np.float32, (None, None)).shape
    return {**arrays, "seen": np.ones(shape, np.bool_), "disagreement": np.full(shape, np.nan, np.float32)}


def read_image(path: Path) -> PosteriorImage:
    """Return the image in posterior.npz."""
    arrays = _arrays_of_image(path)
    occupancy = take_array(path, arrays, "occupancy", np.float32, (None, None))
    image = PosteriorImage(
        occupancy,
        take_array(path, arrays, "square_occupancy", np.float32, occupancy.shape),
        take_array(path, arrays, "origin", np.float64, (2,)),
        float(take_array(path, arrays, "resolution", np.float64, ())),
        take_array(path, arrays, "seen", np.bool_, occupancy.shape),
        take_array(path, arrays, "disagreement", np.float32, occupancy.shape),
    )
    assert image.disagreement is not None
    for values in (image.occupancy, image.square_occupancy, image.disagreement):
        if ((values < 0.0) | (values > 1.0)).any():
            raise damaged(path, "a probability is outside 0 to 1")
    if not ((np.abs(image.origin) <= LARGEST_COORDINATE).all() and 0.0 < image.resolution <= LARGEST_COORDINATE):
        raise damaged(path, f"origin {image.origin.tolist()}, resolution {image.resolution}")
    return image


def read_readings(path: Path) -> dict[str, Any]:
    """Return the fields of :class:`RunData` that readings.npz holds; None for readings that the run did not use."""
    arrays = load_arrays(path, names.SCHEMAS[names.READINGS])
    laser = _take_readings(path, arrays, "")
    sonar = _take_readings(path, arrays, names.SONAR_PREFIX) if names.SONAR_PREFIX + "angle" in arrays else None
    points = _take_points(path, arrays) if names.POINT_PREFIX + "value" in arrays else None
    arrays.setdefault(names.WAY, np.zeros((0, 4)))
    way = take_array(path, arrays, names.WAY, np.float64, (None, 4))
    if not np.isfinite(way).all():
        raise damaged(path, f"array {names.WAY} has a value that is not finite")
    has_others = sonar is not None or points is not None
    return {
        "laser": None if has_others and laser.n_beams == 0 else laser,
        "sonar": sonar,
        "points": points,
        "way": way,
        "counts": _take_counts(path, arrays) if names.COUNT_PREFIX + "passes" in arrays else None,
    }


def _take_counts(path: Path, arrays: dict[str, NDArray[Any]]) -> BeamCounts:
    passes = take_array(path, arrays, names.COUNT_PREFIX + "passes", np.int32, (None, None))
    counts = BeamCounts(
        passes,
        take_array(path, arrays, names.COUNT_PREFIX + "returns", np.int32, passes.shape),
        take_array(path, arrays, names.COUNT_PREFIX + "origin", np.float64, (2,)),
        float(take_array(path, arrays, names.COUNT_PREFIX + "cell", np.float64, ())),
    )
    is_placed = (np.abs(counts.origin) <= LARGEST_COORDINATE).all() and 0.0 < counts.cell <= LARGEST_COORDINATE
    if not (is_placed and (counts.returns >= 0).all() and (counts.returns <= passes).all()):
        raise damaged(path, "counts of beams that cannot be")
    return counts


def _take_readings(path: Path, arrays: dict[str, NDArray[Any]], prefix: str) -> Readings:
    """Return the readings of the laser (no prefix), or of the sonar, whose readings have fields of view."""
    angle = take_array(path, arrays, prefix + "angle", np.float64, (None,))
    n = len(angle)
    ranges = take_array(path, arrays, prefix + "range", np.float64, (n,))
    values: dict[str, Any] = {
        "origin": take_array(path, arrays, prefix + "origin", np.float64, (n, 2)),
        "angle": angle,
        "cone": take_array(path, arrays, prefix + "cone", np.float64, (n,)) if prefix else np.zeros(n),
    }
    for name, value, kind in OF_SESSIONS:  # earlier releases have neither
        arrays.setdefault(prefix + name, np.full(n, value, kind))
        values[name] = take_array(path, arrays, prefix + name, kind, (n,))
    sound = {name: np.isfinite(array).all() for name, array in values.items()} | {"range": (ranges >= 0.0).all()}
    sound |= {name: sound[name] and bool((values[name] >= 0).all()) for name, _, _ in OF_SESSIONS}
    sound["share"] &= bool((values["share"] > 0.0).all())
    for name in (name for name, is_sound in sound.items() if not is_sound):
        raise damaged(path, f"a reading has an impossible value of {name}")
    scan = take_array(path, arrays, prefix + "scan", np.int64, (n,))
    readings = Readings.from_arrays(ranges=ranges, scan=scan, source=str(path), **values)
    return readings.within(float(take_array(path, arrays, prefix + "max_range", np.float64, ())))


def _take_points(path: Path, arrays: dict[str, NDArray[Any]]) -> PointTable:
    value = take_array(path, arrays, names.POINT_PREFIX + "value", np.float64, (None,))
    xy = take_array(path, arrays, names.POINT_PREFIX + "xy", np.float64, (len(value), 2))
    if not (np.isfinite(xy).all() and np.isfinite(value).all()):
        raise damaged(path, "a point has a coordinate or value that is not finite")
    return PointTable(xy, value, np.arange(1, len(value) + 1), str(path))


def read_trajectory(path: Path) -> Trajectory:
    """Return the sampled poses in poses.npz."""
    arrays = load_arrays(path, names.SCHEMAS[names.POSES])
    scan = take_array(path, arrays, "scan", np.int64, (None,))
    n = len(scan)
    given = take_array(path, arrays, "given", np.float64, (n, 3))
    prior, draws = _take_prior(path, arrays, given), take_array(path, arrays, "draws", np.float32, (None, n, 3))
    body = None if prior is None else _take_body(path, arrays, len(draws), prior)
    owned = range(0 if body is None else BODY, n)
    laser, sonar = (_take_owners(path, arrays, f"pose_of_{kind}", owned) for kind in ("laser", "sonar"))
    found = Trajectory(
        scan,
        take_array(path, arrays, "time", np.float64, (n,)),
        given,
        draws,
        laser,
        sonar,
        prior=prior,
        disputed=_take_closures(path, arrays, n),
        body=body,
    )
    if not (np.isfinite(found.given).all() and np.isfinite(found.draws).all()):
        raise damaged(path, "a pose has a value that is not finite")
    return found


def _take_prior(path: Path, arrays: dict[str, NDArray[Any]], given: NDArray[np.float64]) -> PosePrior | None:
    """Return what was known of the poses; None in files that do not have it."""
    if "slip" not in arrays:
        return None
    motion = take_array(path, arrays, "motion", np.float64, (None, 3))
    spread = take_array(path, arrays, "spread", np.float64, (len(motion), 3))
    noise = np.tile(take_array(path, arrays, "noise", np.float64, (2,)), (len(given), 1))
    return PosePrior(given, noise, motion, spread, float(take_array(path, arrays, "slip", np.float64, ())))


def _take_body(path: Path, arrays: dict[str, NDArray[Any]], n_draws: int, prior: PosePrior) -> Trajectory | None:
    """Return the pose of what is left of runs that were let go of; None where there are none."""
    prefix = names.BODY_PREFIX
    if prefix + "given" not in arrays:
        return None
    given = take_array(path, arrays, prefix + "given", np.float64, (3,))[None]
    noise = take_array(path, arrays, prefix + "noise", np.float64, (2,))[None]
    draws = take_array(path, arrays, prefix + "draws", np.float32, (n_draws, 3))[:, None]
    if not (np.isfinite(given).all() and np.isfinite(draws).all() and (noise > 0.0).all()):
        raise damaged(path, "the pose of a body has an impossible value")
    own = prior._replace(given=given, noise=noise)
    return Trajectory(np.array([BODY]), np.array([np.nan]), given, draws, prior=own)


def _take_closures(path: Path, arrays: dict[str, NDArray[Any]], n: int) -> Closures:
    """Return the loops in dispute; none in files that do not have them."""
    if names.LOOP_PREFIX + "tail" not in arrays:
        return NO_CLOSURES
    tail = take_array(path, arrays, names.LOOP_PREFIX + "tail", np.int64, (None,))
    k = len(tail)
    head = take_array(path, arrays, names.LOOP_PREFIX + "head", np.int64, (k,))
    if k and not (min(tail.min(), head.min()) >= 0 and max(tail.max(), head.max()) < n):
        raise damaged(path, "a loop has a number that is not one of the poses")
    pose = take_array(path, arrays, names.LOOP_PREFIX + "pose", np.float64, (k, 3))
    return Closures(tail, head, pose, take_array(path, arrays, names.LOOP_PREFIX + "covariance", np.float64, (k, 3, 3)))


def _take_owners(path: Path, arrays: dict[str, NDArray[Any]], name: str, owned: range) -> NDArray[np.int32] | None:
    if name not in arrays:
        return None
    owner: NDArray[np.int32] = take_array(path, arrays, name, np.int32, (None,))
    if ((owner < owned.start) | (owner >= owned.stop)).any():
        raise damaged(path, f"array {name} has a number that is not one of the poses")
    return owner


def _check_owners(path: Path, fields: dict[str, Any]) -> None:
    """Refuse poses of other readings than those of the run, if both are read."""
    for kind in ("laser", "sonar"):
        readings, owner = fields.get(kind), getattr(fields["trajectory"], kind)
        if readings is not None and owner is not None and len(owner) != readings.n_beams:
            raise damaged(path, f"poses of {len(owner)} readings, but the run has {readings.n_beams}")


def read_best(path: Path) -> tuple[Coloring, float]:
    """Return the best map in map.geojson and its log posterior (nan if the file has none)."""
    coloring, properties = read_map_feature(path)
    value = properties.get("log_posterior")
    if isinstance(value, int | float) and abs(value) < LARGEST:
        return coloring, float(value)
    return coloring, float("nan")


def _take_draws(path: Path, arrays: dict[str, NDArray[Any]]) -> Draws:
    bounds = take_array(path, arrays, "window", np.float64, (4,))
    if not ((np.abs(bounds) <= LARGEST_COORDINATE).all() and (bounds[:2] < bounds[2:]).all()):
        raise damaged(path, f"window {bounds.tolist()}")
    anchor_black = take_array(path, arrays, "anchor_black", np.bool_, (None,))
    n = len(anchor_black)
    xy = take_array(path, arrays, "xy", np.float64, (None, 2))
    edges = take_array(path, arrays, "edges", np.int32, (None, 2))
    draws = Draws(
        Window(*bounds.tolist()),
        _take_offsets(path, arrays, "vertex_offsets", n, len(xy)),
        xy,
        take_array(path, arrays, "side", np.int8, (len(xy),)),
        _take_offsets(path, arrays, "edge_offsets", n, len(edges)),
        edges,
        anchor_black,
    )
    _check_edges(path, draws)
    return draws


def _take_offsets(path: Path, arrays: dict[str, NDArray[Any]], name: str, n: int, total: int) -> NDArray[np.int64]:
    offsets = take_array(path, arrays, name, np.int64, (n + 1,))
    if offsets[0] != 0 or offsets[-1] != total or (np.diff(offsets) < 0).any():
        raise damaged(path, f"array {name} does not ascend from 0 to {total}")
    return offsets


def _check_edges(path: Path, draws: Draws) -> None:
    """Refuse vertex numbers out of range: compiled code would read beyond its arrays."""
    n_vertices = np.repeat(np.diff(draws.vertex_offsets), draws.n_edges)
    if (draws.edges < 0).any() or (draws.edges >= n_vertices[:, None]).any():
        raise damaged(path, "array edges names a vertex that its draw does not have")
    if not np.isfinite(draws.xy).all():
        raise damaged(path, "array xy has a value that is not finite")
