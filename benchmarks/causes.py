"""Causes that `mapq classify` names, beside the errors that maps were given: a confusion table.

A simulated city, driven round a block twice, is cut into scans, whose poses get errors of one kind: a loop that was
missed, offsets of scans, or both. Besides, the simulator's own maps, of odometry that drifts over two laps.
Judged are all patches whose points are displaced; no model is asked. A minute or two on one core.

With `--drives`: maps of scans whose poses are checked, with a wrong edge, wrong scans, drift or a missed loop; judged
are patches that are displaced and that the shipped model calls suspicious. Some ten seconds a map.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.edges import FEWEST, JITTER, MOST, Graph, graph_of, spoiled, write_g2o
from data.training_worlds import ScannedWorld, jittered, labelled, make_world
from mapq.cloud import PointCloud
from mapq.configuration import FeatureSettings, PerturbSettings, SimulateSettings
from mapq.features import patch_features
from mapq.labels import NO_PATCH, SUSPICIOUS
from mapq.patches import Patches, label_from_field
from mapq.perturb import build, displaced
from mapq.posed import PosedScans, check_poses, read_edges
from mapq.results.causes import (
    CAUSES,
    DRIFT,
    LOCAL,
    MISSED_LOOP,
    UNKNOWN,
    WRONG_EDGE,
    WRONG_SCAN,
    Cause,
    find_causes,
)
from mapq.results.result import assess
from mapq.results.visits import visits_of
from mapq.segmentation import segment
from mapq.simulate import simulate

SCAN_SECONDS = 2.8
"""Two nods of the laser."""
KNOWN = {
    "scans, from where": ("scan", "pass_id", "to_sensor_x", "to_sensor_y", "to_sensor_z"),
    "scans": ("scan",),
    "seconds": ("time",),
    "passes": ("pass_id",),
    "nothing": (),
}
"""What a map records of when it was seen, by the fields that are kept."""


ERRORS = {
    ("missed loop, 0.5 m and 1 degree", MISSED_LOOP): PerturbSettings(missed_loop=(0.5, 1.0)),
    ("missed loop, 1 m", MISSED_LOOP): PerturbSettings(missed_loop=(1.0, 0.0)),
    ("offsets of scans, 0.3 m", LOCAL): PerturbSettings(offset=0.3),
    ("turns of scans, 1 degree", LOCAL): PerturbSettings(yaw=1.0),
}
LATE = 0.8
"""Share of the drive after which, in the map with both, scans have offsets: it is then past the block for good."""
MOSTLY = 0.9
MOST_POINTS = 200_000
"""Of the map of a drive."""


class Judged(NamedTuple):
    """A cause; and the disagreement of its patch: true metres, and lower bound, value, upper bound as measured."""

    cause: Cause
    truth: float
    measured: np.ndarray


class Case(NamedTuple):
    """A labelled map: the point field of the labels, and the scans from which on errors are local instead of loops."""

    name: str
    cause: str
    field: str
    cloud: PointCloud
    local_from: int | None = None


def cut(cloud: PointCloud, seconds: float) -> PosedScans:
    """Return the scans of a simulated map without drift: what was seen in so many seconds, from the middle place."""
    time = cloud.fields["time"]
    number = np.unique(np.floor(time / seconds).astype(np.int64), return_inverse=True)[1]
    sensor = cloud.xyz + np.column_stack([cloud.fields[f"to_sensor_{axis}"] for axis in "xyz"])
    rows = [np.flatnonzero(number == scan) for scan in range(int(number.max()) + 1)]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, 3] = [np.median(sensor[some], axis=0) for some in rows]
    clouds = [PointCloud.from_world(cloud.xyz[some] - poses[scan, :3, 3]) for scan, some in enumerate(rows)]
    times = np.array([float(np.median(time[some])) for some in rows])
    names = tuple(f"from {at:.0f} s" for at in times)
    return PosedScans(names, poses, times, clouds.__getitem__, np.arange(len(rows)), "simulated")


def cases(seed: int, n_points: int) -> Iterator[Case]:
    """Yield maps whose causes are known."""
    scans = cut(simulate(SimulateSettings(n_points=n_points, drift=0.0), seed), SCAN_SECONDS)
    for (name, cause), error in ERRORS.items():
        yield Case(name, cause, "suspicious", build(scans, error, seed=seed).cloud)
    late = int(LATE * len(scans))
    poses = displaced(scans.poses, ERRORS["missed loop, 1 m", MISSED_LOOP], seed)
    poses[late:] = displaced(poses, ERRORS["offsets of scans, 0.3 m", LOCAL], seed)[late:]
    both = build(scans.with_poses(poses, "both"), reference=scans.poses).cloud
    for cause in (MISSED_LOOP, LOCAL):
        yield Case(f"both in one map, {cause}", cause, "suspicious", both, late)
    yield Case("drift of odometry, two laps", MISSED_LOOP, "truth", simulate(SimulateSettings(n_points=n_points), seed))


def chosen(case: Case, patches: Patches) -> np.ndarray:
    """Return which patches (m,) have the cause of a case: all, or those mostly of scans that have it."""
    if case.local_from is None:
        return np.ones(len(patches), bool)
    inside = patches.patch != NO_PATCH
    late = case.cloud.fields["scan"][inside] >= case.local_from
    share = np.bincount(patches.patch[inside], late, len(patches)) / patches.counts
    return np.asarray(share > MOSTLY if case.cause == LOCAL else share < 1.0 - MOSTLY)


def measure(case: Case) -> dict[str, list[Judged]]:
    """Return, by what a map records, the causes of its displaced patches, whether or not a model finds these."""
    patches = label_from_field(segment(case.cloud), case.field, case.name)[0]
    right = (patches.label == SUSPICIOUS) & chosen(case, patches)
    found, truth = {}, true_metres(patches)
    for name, fields in KNOWN.items():
        if set(fields) <= set(case.cloud.fields):
            reported = replace(case.cloud, fields={field: case.cloud.fields[field] for field in fields})
            features = patch_features(replace(patches, cloud=reported), FeatureSettings(context=("moments",)))
            causes = find_causes(patches, features, right, visits_of(reported))
            found[name] = [Judged(cause, truth[patch], features.disagreement[patch]) for patch, cause in causes.items()]
    return found


def true_metres(patches: Patches) -> np.ndarray:
    """Return what the points of each patch (m,) are truly displaced by against others there, in the median."""
    points, start = patches.members
    metres = np.asarray(patches.cloud.fields["disagreement"], float)[points]
    return np.array([np.nanmedian(metres[a:b]) for a, b in pairwise(start)])


def spoiled_poses(scans: PosedScans, kind: str, seed: int) -> tuple[np.ndarray, Graph | None]:
    """Return poses with errors of a kind, and the graph of a wrong edge."""
    rng = np.random.default_rng([seed, 11])
    size = rng.uniform(0.4, 1.0)
    if kind == WRONG_EDGE:
        rng = np.random.default_rng([seed, 12])
        graph = spoiled(graph_of(scans, rng), 1, rng)[0]
        return graph.poses, graph
    if kind != WRONG_SCAN:
        errors = (size, float(rng.choice([0.0, 1.0])))
        error = PerturbSettings(drift=errors) if kind == DRIFT else PerturbSettings(missed_loop=errors)
        return displaced(scans.poses, error, seed), None
    poses = scans.poses.copy()
    for scan in rng.permutation(len(scans))[: int(rng.integers(1, 4))]:
        turn = rng.uniform(0.0, 2.0 * np.pi)
        poses[scan, :2, 3] += size * np.array([np.cos(turn), np.sin(turn)])
    return poses, None


def of_drive(world: ScannedWorld, kind: str, seed: int) -> list[tuple[str, bool, float]]:
    """Return of suspicious patches the cause, whether they are displaced, and their area."""
    scans = world.posed()
    poses, graph = spoiled_poses(
        scans.with_poses(jittered(scans.poses, JITTER, np.random.default_rng([seed, 7])), "jittered"), kind, seed
    )
    thin = world.take(np.random.default_rng([seed, 3]).random(len(world.scan)) * len(world.scan) < MOST_POINTS)
    cloud, used = labelled(thin, poses, f"seed {seed}"), thin.posed().with_poses(poses, "spoiled")
    result = assess(label_from_field(segment(cloud), "suspicious", cloud.source)[0])
    with tempfile.TemporaryDirectory() as folder:
        edges = []
        if graph is not None:
            write_g2o(Path(folder) / "graph.g2o", graph)
            edges = read_edges(used.with_poses(poses, str(Path(folder) / "graph.g2o")))
        found = replace(result, poses=check_poses(cloud, used, edges)).causes
    wrong, area = result.patches.label == SUSPICIOUS, np.nan_to_num(result.area)
    return [(cause.kind, bool(wrong[patch]), float(area[patch])) for patch, cause in found.items()]


def report_drives(seeds: list[int]) -> None:
    """Print, by kind of error, how many of the causes named are right, and the share of the area without one."""
    rows: dict[str, list[tuple[str, bool, float]]] = {kind: [] for kind in (WRONG_EDGE, WRONG_SCAN, DRIFT, MISSED_LOOP)}
    with threadpool_limits(1):
        for seed in seeds:
            world = make_world(seed)
            for kind in rows if FEWEST <= len(world.poses) <= MOST else ():
                rows[kind] += of_drive(world, kind, seed)
    for kind, found in rows.items():
        true = [(name, area) for name, is_displaced, area in found if is_displaced]
        named = [name == kind for name, _ in true if name != UNKNOWN]
        lost = sum(area for name, area in true if name == UNKNOWN) / max(sum(area for _, area in true), 1e-9)
        print(f"{kind:22} {len(true):5} patches; right {np.mean(named):.2f}, unknown {lost:.2f} of the area")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 4], help="of worlds and errors")
    parser.add_argument("--n-points", type=int, default=300_000, help="of a map")
    parser.add_argument("--json", type=Path, help="the counts")
    parser.add_argument("--drives", type=int, nargs="*", help="seeds of drives whose poses are checked  [1 3 .. 59]")
    options = parser.parse_args()
    if options.drives is not None:
        report_drives(options.drives or list(range(1, 60, 2)))
        return
    table: dict[str, dict[str, Counter[str]]] = {}
    truth, metres = {}, []
    for seed in options.seeds:
        for case in cases(seed, options.n_points):
            truth[case.name] = case.cause
            for known, found in measure(case).items():
                row = table.setdefault(known, {}).setdefault(case.name, Counter())
                row.update(each.cause.kind for each in found)
                metres += [(each.truth, *each.measured) for each in found if each.cause.kind == case.cause]
    for known, rows in table.items():
        print(f"the map records: {known}")
        print(f"  {'':42}{'truth':>22}" + "".join(f"{kind:>22}" for kind in CAUSES))
        for name, row in rows.items():
            print(f"  {name:42}{truth[name]:>22}" + "".join(f"{row[kind]:>22}" for kind in CAUSES))
    true, low, said, high = (column[np.isfinite(metres).all(axis=1)] for column in np.array(metres).T)
    held = np.mean((low <= true) & (true <= high))
    error = np.median(np.abs(said - true))
    print(f"metres of causes that are right: median error {error:.3f}, within bounds {held:.0%}")
    if options.json:
        options.json.write_text(json.dumps({"truth": truth, "named": table}, indent=1))


if __name__ == "__main__":
    main()
