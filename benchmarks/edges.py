"""Scans and edges that `mapq classify` names, beside those that were spoiled: how often the right one is first.

Simulated worlds (15 to 60 scans) and public scans with right poses. One scan is displaced by 0.2 to 0.5 m; and graphs
of odometry and loops, of which one or three edges are spoiled by 0.3 to 1 m or 2 to 10 degrees, are optimised with
these edges. Everything was tuned on worlds of even seeds, KITTI and the hall (`--tuned`); worlds of odd seeds, quad,
room and park judge it. Two changes came after a first look at these: points are matched as far as a surface's are
apart, and only scans within 10 m are neighbours, since none of the park's edges could be checked. These are its own.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from benchmarks.real_data import DATA, hall, kitti, park, quad, room
from data.training_worlds import jittered, make_world
from mapq.configuration import MergeSettings
from mapq.posed import PosedScans, check_poses, merge_scans, read_edges
from mapq.posed.check_scans import check_scans, pairs_of, scene_of
from mapq.posed.edges import EdgeError
from mapq.posed.register import motion_about
from prf.shell.poses.files import rigid

Floats = NDArray[np.float64]
Pair = tuple[int, int]

FEWEST, MOST = 15, 60
"""Scans of the simulated drives."""
JITTER = 0.02
"""Metres by which poses of the drives are off before anything is spoiled."""
NOISE = np.repeat([0.02, 0.003], 3)
"""Metres and radians of edges that are right."""
REAL = {"kitti": kitti, "hall": hall, "quad": quad, "room": room}
TUNED = ("kitti", "hall")
OUTLIER = (7, 10)
"""Of the park's edges, which a fit to all of them has 118 m off."""


class Graph(NamedTuple):
    """Poses, and relative poses of pairs of them."""

    poses: Floats  # (n, 4, 4)
    pairs: list[Pair]
    motion: Floats  # (m, 4, 4) of the second in the frame of the first


class Score(NamedTuple):
    """Of a graph: rank of the worst spoiled edge, and edges called wrong rightly, wrongly, and not."""

    rank: int
    found: int
    false: int
    missed: int


def drives(seeds: Sequence[int]) -> Iterator[tuple[str, PosedScans]]:
    """Yield simulated drives, whose poses are a little off."""
    for seed in seeds:
        world = make_world(seed)
        if FEWEST <= len(world.poses) <= MOST:
            scans = world.posed()
            poses = jittered(scans.poses, JITTER, np.random.default_rng([seed, 7]))
            yield f"{seed} {world.site.kind}, {world.sensor.kind}, {world.way}", scans.with_poses(poses, "jittered")


def rank_of_scan(scans: PosedScans, seed: int) -> tuple[int, float]:
    """Return the place among the worst of a scan that was displaced, and by how many metres its motion is off."""
    rng = np.random.default_rng([seed, 1])
    scan, turn = int(rng.integers(len(scans))), rng.uniform(0.0, 2.0 * np.pi)
    shift = rng.uniform(0.2, 0.5) * np.array([np.cos(turn), np.sin(turn), 0.0])
    poses = scans.poses.copy()
    poses[scan, :3, 3] += shift
    moved = scans.with_poses(poses, "displaced")
    rows = check_scans(merge_scans(moved), moved).rows
    rank = [row.scan for row in rows].index(scan)
    row = rows[rank]
    return rank, float(np.linalg.norm(np.array([row.dx, row.dy, row.dz]) + shift))


def graph_of(scans: PosedScans, rng: np.random.Generator) -> Graph:
    """Return a graph of odometry, and of loops between scans that share surfaces, one to three scans."""
    scene, n = scene_of(merge_scans(scans), scans.poses), len(scans)
    loops = [pair for pair in pairs_of(scene) if pair[1] - pair[0] > 2]
    some = rng.permutation(len(loops))[: max(n // 3, 2)]
    pairs = [(k, k + 1) for k in range(n - 1)] + [loops[k] for k in sorted(some.tolist())]
    motion = np.array([np.linalg.inv(scans.poses[a]) @ scans.poses[b] for a, b in pairs])
    noise = rng.standard_normal((len(pairs), 6)) * NOISE
    motion = np.array([m @ motion_about(np.zeros(3), twist) for m, twist in zip(motion, noise, strict=True)])
    return Graph(scans.poses, pairs, motion)


def spoiled(graph: Graph, n_wrong: int, rng: np.random.Generator) -> tuple[Graph, list[int]]:
    """Return the graph with some wrong edges, optimised with them, and which these are."""
    wrong, motion = sorted(rng.permutation(len(graph.pairs))[:n_wrong].tolist()), graph.motion.copy()
    for edge in wrong:
        twist = np.zeros(6)
        if rng.random() < 0.5:
            turn = rng.uniform(0.0, 2.0 * np.pi)
            twist[:2] = rng.uniform(0.3, 1.0) * np.array([np.cos(turn), np.sin(turn)])
        else:
            twist[5] = np.radians(rng.uniform(2.0, 10.0)) * rng.choice([-1.0, 1.0])
        motion[edge] = motion[edge] @ motion_about(np.zeros(3), twist)
    return optimised(graph._replace(motion=motion)), wrong


def optimised(graph: Graph) -> Graph:
    """Return the graph with the poses that fit all its edges best, by least squares; the first pose stays."""
    one, other = np.array(graph.pairs).T
    n = len(graph.poses)

    def moved(x: Floats) -> Floats:
        twist = np.concatenate([np.zeros((1, 6)), x.reshape(-1, 6)])
        turn = Rotation.from_rotvec(twist[:, 3:]).as_matrix()
        return graph.poses @ rigid(turn, twist[:, :3])

    def errors(x: Floats) -> Floats:
        poses = moved(x)
        off = np.linalg.inv(graph.motion) @ np.linalg.inv(poses[one]) @ poses[other]
        return np.asarray(
            (np.hstack([off[:, :3, 3], Rotation.from_matrix(off[:, :3, :3]).as_rotvec()]) / NOISE).ravel()
        )

    pattern = np.zeros((len(one), 6, n, 6), bool)
    for edge, pair in enumerate(graph.pairs):
        pattern[edge, :, pair] = True
    pattern_of_free = pattern[:, :, 1:].reshape(6 * len(one), 6 * (n - 1))
    found = least_squares(errors, np.zeros(6 * (n - 1)), jac_sparsity=pattern_of_free, max_nfev=50)
    return graph._replace(poses=moved(found.x))


def write_g2o(path: Path, graph: Graph) -> None:
    """Write a graph as g2o."""

    def numbers(pose: Floats) -> str:
        return " ".join(f"{x:.9f}" for x in (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()))

    information = " ".join(f"{1.0 / NOISE[a] ** 2 if a == b else 0.0:g}" for a in range(6) for b in range(a, 6))
    rows = [f"VERTEX_SE3:QUAT {k} {numbers(pose)}" for k, pose in enumerate(graph.poses)]
    for (a, b), motion in zip(graph.pairs, graph.motion, strict=True):
        rows.append(f"EDGE_SE3:QUAT {a} {b} {numbers(motion)} {information}")
    path.write_text("\n".join(rows) + "\n")


def edges_of(scans: PosedScans, graph: Graph, merging: MergeSettings | None = None) -> tuple[EdgeError, ...]:
    """Return what is found of the edges of a graph, by a g2o file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "graph.g2o"
        write_g2o(path, graph)
        posed = scans.with_poses(graph.poses, str(path))
        return check_poses(merge_scans(posed, merging), posed, read_edges(posed)).edges


def score_graph(scans: PosedScans, n_wrong: int, seed: int) -> Score:
    """Return how spoiled edges of a graph are found."""
    rng = np.random.default_rng([seed, 2, n_wrong])
    graph, wrong = spoiled(graph_of(scans, rng), n_wrong, rng)
    rows, first = edges_of(scans, graph), len(graph.poses)
    order = [row.row - first for row in rows]
    named = {row.row - first for row in rows if row.p_wrong > 0.5}
    found = len(named & set(wrong))
    return Score(max(order.index(edge) for edge in wrong), found, len(named) - found, n_wrong - found)


def park_graph(data: Path, scans: PosedScans) -> Graph:
    """Return the park's sub-maps with their authors' edges, each once."""
    rows = json.loads((data / "dxmcu_map" / "config" / "config.json").read_text())["edges"]
    found = {(row["from"], row["to"]): row["transformational_matrix"] for row in rows if row["from"] < row["to"]}
    motion = np.array([np.array(text.split(), np.float64).reshape(4, 4) for text in found.values()])
    left, _, right = np.linalg.svd(motion[:, :3, :3])
    return Graph(scans.poses, list(found), rigid(left @ right, motion[:, :3, 3]))


def cases(options: argparse.Namespace) -> Iterator[tuple[str, PosedScans, int]]:
    """Yield maps with a seed for what is spoiled: drives, and public scans several times."""
    for number, (name, scans) in enumerate(drives(options.seeds)):
        yield name, scans, number
    for name, read in REAL.items():
        if (name in TUNED) == options.tuned and name in options.real:
            for number in range(options.repeats):
                yield name, read(DATA), 1000 + number


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tuned", action="store_true", help="the maps on which all was tuned")
    parser.add_argument("--seeds", type=int, nargs="*", help="of worlds  [0 2 .. 78, or odd ones]")
    parser.add_argument("--real", nargs="*", default=list(REAL), help="public scans")
    parser.add_argument("--repeats", type=int, default=4, help="of public scans")
    options = parser.parse_args()
    if options.seeds is None:
        options.seeds = list(range(0 if options.tuned else 1, 80, 2))
    ranks, scores, began = [], {1: list[Score](), 3: list[Score]()}, time.process_time()
    with threadpool_limits(1):
        for name, scans, seed in cases(options):
            rank, off = rank_of_scan(scans, seed)
            ranks.append(rank)
            each = {n: score_graph(scans, n, seed) for n in scores if len(scans) > 2 * n}
            for n, score in each.items():
                scores[n].append(score)
            words = "; ".join(f"{n} wrong: rank {s.rank + 1}, {s[1:]}" for n, s in each.items())
            print(f"{name:40} {len(scans):3} scans: rank {rank + 1}, {off:.3f} m off; {words}", flush=True)
        if not options.tuned:
            report_park()
    print(f"the displaced scan is first in {np.mean(np.array(ranks) == 0):.0%} of {len(ranks)}")
    for n, found in scores.items():
        if not found:
            continue
        _, right, false, missed = np.array(found).reshape(-1, 4).sum(axis=0).tolist()
        first = np.mean([score.rank < n for score in found])
        recall, precision = right / max(right + missed, 1), right / max(right + false, 1)
        print(f"{n} wrong: first {first:.0%} of {len(found)} graphs; recall {recall:.2f} at precision {precision:.2f}")
    print(f"{time.process_time() - began:.0f} CPU seconds")


def report_park() -> None:
    """Print what is found of the park's edges."""
    scans = park(DATA)
    for row in edges_of(scans, park_graph(DATA, scans), MergeSettings(submaps=True)):
        off = "not checked" if row.error_m is None else f"{row.error_m:.2f} m, {row.error_rad:.3f} rad"
        print(f"park {row.ids}{' (the outlier)' if row.ids == OUTLIER else ''}: {off}, p_wrong {row.p_wrong:.2f}")


if __name__ == "__main__":
    main()
