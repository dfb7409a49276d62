"""The maps of `benchmarks.unseen`: real places with right and with wrong poses, dense and thinned, as PATCHES files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks import real_data
from data.true_ranges import true_ranges, with_metres
from mapq.cloud import PointCloud
from mapq.configuration import MergeSettings, PerturbSettings
from mapq.io import read_patches, write_patches
from mapq.labels import metres_of
from mapq.patches import Patches
from mapq.perturb import build, displaced
from mapq.posed import PosedScans
from mapq.segmentation import segment

INDEX = "index.json"
RIGHT, WRONG, ALONE = "right", "wrong", "alone"
"""Kinds of maps: all scans merged at right poses, some at wrong ones, and what was seen once or is a finished map."""
DEVELOPMENT = ("kitti", "kitti4", "hall", "one kitti", "one hall")
"""Sets that may be looked at while something is built. All others are for judging: nothing is tuned on them."""
THINNED = (1, 3, 6, 10)
"""One of so many points is kept, at random."""
PAIRED = 6
"""Thinning at which wrong maps are measured again."""
SIZES = (0.3, 0.4, 0.6, 1.0)
"""Metres. Suspicious is what lies more than 0.3 m off along its normal: displacements of 0.3 m make none, and serve the
share of area against the size of error alone."""
RISES = (("raised", 0.15, 1, 1), ("raised", 0.3, 2, 1), ("rising", 0.3, 1, 1), ("raised", 0.3, 1, 6))
"""Errors of height: of the second half, or growing along the way."""
MANY = 6
"""Scans from which on two are displaced, not one."""
DEGREES = 1.0
"""Of heading that a growing drift has gathered for each metre."""
FARTHEST = 30.0
"""Metres: beyond stand the returns of the corridor that are none."""


class Map(NamedTuple):
    """What a map is.

    Attributes
    ----------
    name : str
        Of its file, without ``.patches``.
    place : str
        The set.
    kind : str
        `RIGHT`, `WRONG` or `ALONE`.
    error : str
        ``halves``, ``drift``, ``scans``, ``raised``, ``rising``, ``published``, ``raw``, ``chained``, or nothing.
    size : float
        Metres of the error; nan where it is not made.
    seed, thinned : int
    """

    name: str
    place: str
    kind: str
    error: str = ""
    size: float = 0.0
    seed: int = 0
    thinned: int = 1

    @property
    def role(self) -> str:
        """Return what the set may be used for."""
        return "development" if self.place in DEVELOPMENT else "judging"


Maker = Callable[[], Patches]


def maps(data: Path) -> Iterator[tuple[Map, Maker]]:
    """Yield all maps with what makes their clouds, small sets first."""
    places: dict[str, Callable[[Path], PosedScans]] = {
        "quad": real_data.quad,
        "room": real_data.room,
        "hall": real_data.hall,
        "pair": real_data.facade,
        "corridor": real_data.corridor,
        "rooms": real_data.rooms,
        "kitti4": lambda folder: real_data.kitti(folder).every(5),
    }
    for place, load in places.items():
        yield from _right(place, load, data)
        yield from _wrong(place, load, data)
    yield from _raw(data)
    yield from _alone(data)
    yield from _right("kitti", real_data.kitti, data)
    yield from _published(data)
    yield from _park(data)


def _merged(scans: PosedScans, poses: np.ndarray | None = None, thinned: int = 1) -> Patches:
    """Return the patches of the map of scans at poses that may be wrong, labelled by those that are right."""
    used = scans if poses is None else scans.with_poses(poses, "displaced")
    settings = MergeSettings(max_range=FARTHEST if "3dtk" in scans.source else None)
    patches = segment(thin(build(used, merging=settings, reference=scans.poses).cloud, thinned))
    moved = used.poses @ np.linalg.inv(scans.poses)
    back = np.linalg.inv(moved)[np.asarray(patches.cloud.fields["scan"]).astype(np.int64)]
    world = patches.cloud.world()
    places = np.einsum("nij,nj->ni", back[:, :3, :3], world) + back[:, :3, 3]
    return with_metres(patches, np.nan_to_num(true_ranges(patches, places, moved)))


def thin(cloud: PointCloud, thinned: int) -> PointCloud:
    """Return one of so many points, at random."""
    return cloud if thinned == 1 else cloud.take(np.random.default_rng(thinned).random(len(cloud)) * thinned < 1.0)


def _right(place: str, load: Callable[[Path], PosedScans], data: Path) -> Iterator[tuple[Map, Maker]]:
    for thinned in THINNED:
        row = Map(f"{place}-right-{thinned}", place, RIGHT, thinned=thinned)
        yield row, lambda row=row: _merged(load(data), thinned=row.thinned)  # type: ignore[misc]


def _wrong(place: str, load: Callable[[Path], PosedScans], data: Path) -> Iterator[tuple[Map, Maker]]:
    """Yield wrong maps; of two scans all errors are one."""
    errors = [("halves", size, 1 + number % 2, 1) for number, size in enumerate(SIZES)]
    if len(load(data)) == 2:
        errors += [("halves", 0.6, 2, 1), ("halves", 1.0, 1, 1), ("halves", 0.6, 1, PAIRED), ("halves", 0.6, 2, PAIRED)]
    else:
        errors += [("drift", 0.6, 2, 1), ("drift", 1.0, 1, 1), ("scans", 0.4, 1, 1), ("scans", 1.0, 2, 1)]
        errors += [("halves", 0.6, 1, PAIRED), ("scans", 1.0, 2, PAIRED)]
    errors += RISES if len(load(data)) > 2 else [row for row in RISES if row[0] == "raised"]
    for error, size, seed, thinned in errors:
        name = f"{place}-{error}-{size:g}-seed{seed}-{thinned}"
        row = Map(name, place, WRONG, error, size, seed, thinned)
        yield row, lambda row=row: _displaced(load(data), row)  # type: ignore[misc]


def _displaced(scans: PosedScans, row: Map) -> Patches:
    return _merged(scans, wrong_poses(scans.poses, row.error, row.size, row.seed), row.thinned)


def wrong_poses(poses: np.ndarray, error: str, size: float, seed: int) -> np.ndarray:
    """Return poses (k, 4, 4) of which the second half, all by and by, or one or two are displaced by `size` metres."""
    if error == "halves":
        return displaced(poses, PerturbSettings(missed_loop=(size, 0.0)), seed)
    if error == "drift":
        return displaced(poses, PerturbSettings(drift=(size, DEGREES * size)), seed)
    rng, moved, n = np.random.default_rng(seed), poses.copy(), len(poses)
    if error in ("raised", "rising"):
        share = np.linspace(0.0, 1.0, n) if error == "rising" else (np.arange(n) >= n // 2).astype(float)
        moved[:, 2, 3] += size * rng.choice([-1.0, 1.0]) * share
        return moved
    for scan in 1 + rng.permutation(len(poses) - 1)[: 2 if len(poses) >= MANY else 1]:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        moved[scan, :2, 3] += size * np.array([np.cos(angle), np.sin(angle)])
    return moved


def _raw(data: Path) -> Iterator[tuple[Map, Maker]]:
    unregistered = np.stack([np.eye(4)] * 2)
    for thinned in (1, PAIRED):
        row = Map(f"pair-raw-{thinned}", "pair", WRONG, "raw", np.nan, 0, thinned)
        yield row, lambda row=row: _merged(real_data.facade(data), unregistered, row.thinned)  # type: ignore[misc]


def _published(data: Path) -> Iterator[tuple[Map, Maker]]:
    for thinned in (1, PAIRED):
        row = Map(f"kitti-published-{thinned}", "kitti", WRONG, "published", np.nan, 0, thinned)
        yield (
            row,
            lambda row=row: _merged(  # type: ignore[misc]
                real_data.kitti(data), real_data.kitti(data, published=True).poses, row.thinned
            ),
        )


def _alone(data: Path) -> Iterator[tuple[Map, Maker]]:
    """Yield scans that stand alone, and finished maps."""
    chosen: dict[str, tuple[Callable[[Path], PosedScans], tuple[int, ...]]] = {
        "one kitti": (real_data.kitti, (0, 9, 19)),
        "one hall": (real_data.hall, (0,)),
        "one quad": (real_data.quad, (0,)),
        "one room": (real_data.room, (0, 2)),
        "one corridor": (real_data.corridor, (0, 1)),
        "one of rooms": (real_data.rooms, (0, 1)),
        "one of pair": (real_data.facade, (0, 1)),
    }
    for place, (load, numbers) in chosen.items():
        for number in numbers:
            row = Map(f"{place.replace(' ', '_')}-{number}", place, ALONE)
            yield row, lambda load=load, number=number: _merged(real_data.some(load(data), [number]))  # type: ignore[misc]
    for name in real_data.FINISHED:
        yield Map(f"finished-{name}", "finished", ALONE), lambda name=name: segment(real_data.finished(data, name))  # type: ignore[misc]


def _park(data: Path) -> Iterator[tuple[Map, Maker]]:
    """Yield the sub-maps alone, and all as odometry has them, labelled by registration of small pieces."""
    for number in range(len(real_data.park(data))):
        row = Map(f"park-alone-{number}", "park", ALONE)
        yield row, lambda number=number: _submap(real_data.park(data), number)  # type: ignore[misc]
    chained = Map("park-chained-1", "park", WRONG, "chained", np.nan)
    yield chained, lambda: _chained(real_data.park(data))


def _chained(scans: PosedScans) -> Patches:
    patches = segment(build(scans, merging=MergeSettings(submaps=True)).cloud)
    return with_metres(patches, metres_of(patches.patch, len(patches), patches.cloud.fields["disagreement"]))


def _submap(scans: PosedScans, number: int) -> Patches:
    some = real_data.some(scans, [number])
    return segment(build(some, merging=MergeSettings(submaps=True), reference=some.poses).cloud)


def prepare(data: Path, folder: Path, say: Callable[[str], None]) -> None:
    """Write PATCHES of all maps whose data are there, but for those that `folder` has; and the index."""
    folder.mkdir(parents=True, exist_ok=True)
    for row, make in maps(data):
        path = folder / f"{row.name}.patches"
        if not path.exists():
            patches = make()
            write_patches(path, with_metres(patches, np.zeros(len(patches))) if row.kind == ALONE else patches)
        _add(folder, row)
        say(row.name)


def _add(folder: Path, row: Map) -> None:
    """Put a map into the index, in the place of the one of its name."""
    path = folder / INDEX
    rows = json.loads(path.read_text()) if path.exists() else []
    rows = [each for each in rows if each["name"] != row.name] + [row._asdict()]
    path.write_text(json.dumps(rows, indent=0))


def read_index(folder: Path) -> list[Map]:
    """Return the maps that a folder holds."""
    return [Map(**row) for row in json.loads((folder / INDEX).read_text())]


def read_map(folder: Path, row: Map) -> Patches:
    """Return the labelled patches of a map."""
    return read_patches(folder / f"{row.name}.patches")
