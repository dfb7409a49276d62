"""Maps in tiles: speed and memory on a simulated city, one tile against many, and a Dask worker that is killed.

    python -m benchmarks.city_tiles run --points 100000000 --workers 2     time, memory and points a second
    python -m benchmarks.city_tiles tiles --points 2000000 --tiles 16      the same patches for 1 and for 16 tiles?
    python -m benchmarks.city_tiles drives --tiles 5                       simulated drives, in tiles and in memory
    python -m benchmarks.city_tiles lost --points 2000000                  a worker killed in the middle: same result?

The city is made first where it is not yet (`--folder`, by default in the folder for temporary files).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import SIZES, SimulateSettings
from mapq.io import read_cloud, write_cloud
from mapq.labels import UNLABELLED
from mapq.results.result import assess
from mapq.segmentation import segment
from mapq.simulate import simulate
from mapq.simulate.city import POINTS_OF_TILE, write_city

SEED = 7
DRIVES = (1, 2, 3, 4, 5)
"""Seeds of the simulated drives."""
INTERVAL = 0.2
"""Seconds between two looks at the memory of all processes."""
PAGE = os.sysconf("SC_PAGE_SIZE")


class Cost(NamedTuple):
    """What a command took: seconds by the clock and of CPU, and the largest sum of resident memory, in bytes."""

    wall: float
    cpu: float
    memory: int


def measured(command: list[str]) -> Cost:
    """Run a command; memory is summed over it and all processes that it starts."""
    begin, before = time.monotonic(), os.times()
    most = 0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            most = max(most, sum(resident(each) for each in family(process.pid)))
            time.sleep(INTERVAL)
    if process.returncode:
        sys.exit(f"{' '.join(command)}: exit code {process.returncode}")
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return Cost(time.monotonic() - begin, cpu, most)


def family(root: int) -> list[int]:
    """Return a process and all that descend from it."""
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, IndexError):
                continue
            parents.setdefault(parent, []).append(int(entry.name))
    found, waiting = [], [root]
    while waiting:
        found.append(waiting.pop())
        waiting += parents.get(found[-1], [])
    return found


def resident(process: int) -> int:
    """Return the resident memory of a process in bytes; pages that several share count for each."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE
    except (OSError, IndexError):
        return 0


def city(folder: Path, n_points: int, tile_points: int = POINTS_OF_TILE) -> Path:
    """Return the folder of a city, which is made where it is not yet."""
    target = folder / f"city_{n_points}"
    if not target.is_dir():
        begin = time.process_time()
        counts = write_city(target, n_points, SEED, tile_points)
        print(
            f"made            {counts['points']:,} points in {counts['tiles']} tiles, "
            f"{time.process_time() - begin:.0f} s of CPU"
        )
    return target


def classify(source: Path, target: Path, *options: str) -> Cost:
    """Classify a city in tiles; what an earlier run left is removed, whose tiles may be others."""
    if target.is_dir():
        shutil.rmtree(target)
    return measured([sys.executable, "-m", "mapq", "classify", str(source), "-o", str(target), "-f", *options])


class Labels(NamedTuple):
    """Patch and label (n,) of every point of a result, tile after tile."""

    patch: NDArray[np.int32]
    suspicious: NDArray[np.uint8]


def labels_of(folder: Path) -> Labels:
    """Return what a result says of its points."""
    clouds = [read_cloud(str(path)) for path in sorted(folder.glob("*.laz"))]
    return Labels(*(np.concatenate([cloud.fields[name] for cloud in clouds]) for name in ("patch", "suspicious")))


def agreement(one: Labels, other: Labels) -> dict[str, float]:
    """Return how two results of the same points agree; IoU is the mean over points of that of their patch."""
    both = (one.patch >= 0) & (other.patch >= 0)
    n_one, n_other = np.bincount(one.patch[one.patch >= 0]), np.bincount(other.patch[other.patch >= 0])
    key, shared = np.unique(one.patch[both].astype(np.int64) * len(n_other) + other.patch[both], return_counts=True)
    i, j = key // len(n_other), key % len(n_other)
    best = np.zeros(len(n_one))
    np.maximum.at(best, i, shared / (n_one[i] + n_other[j] - shared))
    return {
        "patches_one": len(n_one),
        "patches_other": len(n_other),
        "iou_by_points": float(best @ n_one / n_one.sum()),
        "patches_above_0.99": float(np.mean(best > 0.99)),
        "labels_equal": float(np.mean(one.suspicious == other.suspicious)),
        "labels_equal_in_patches": float(np.mean(one.suspicious[both] == other.suspicious[both])),
    }


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure time and memory of one run."""
    source = city(arguments.folder, arguments.points)
    target = arguments.folder / "result"
    options = ["--workers", str(arguments.workers), "--tile-points", str(arguments.tile_points)]
    cost = classify(source, target, *options)
    counts = json.loads((target / "result.json").read_text())["counts"]
    n_points = counts["n_points"]
    return {
        "points": n_points,
        "workers": arguments.workers,
        "patches": counts["n_patches"],
        "wall_s": cost.wall,
        "cpu_s": cost.cpu,
        "points_per_s": n_points / cost.wall,
        "points_per_cpu_s": n_points / cost.cpu,
        "peak_memory_gb": cost.memory / 1e9,
    }


def tiles(arguments: argparse.Namespace) -> dict[str, Any]:
    """Compare one tile with several."""
    source = city(arguments.folder, arguments.points, arguments.points // 4)
    n_points = sum(len(read_cloud(str(path))) for path in source.glob("*.laz"))
    found = {}
    for n_tiles in (1, arguments.tiles):
        target = arguments.folder / f"result_{n_tiles}"
        classify(source, target, "--tile-points", str(-(-n_points // n_tiles)))
        found[n_tiles] = json.loads((target / "result.json").read_text())["tiles"], labels_of(target)
    (n_one, one), (n_several, several) = found.values()
    return {"points": n_points, "tiles": [n_one, n_several], **agreement(one, several)}


def drives(arguments: argparse.Namespace) -> dict[str, Any]:
    """Compare maps of drifting drives, which tell when and from where they were seen, in tiles with those in memory."""
    found: dict[str, Any] = {}
    for seed in DRIVES:
        path = arguments.folder / f"drive_{seed}.ply"
        write_cloud(path, simulate(SimulateSettings(**SIZES["small"]), seed))
        cloud = read_cloud(str(path))
        plain = assess(segment(cloud))
        label = np.append(plain.labelling.label, np.uint8(UNLABELLED))[plain.patches.patch]
        target = arguments.folder / f"drive_{seed}.classified.ply"
        classify(path, target, "--tile-points", str(-(-len(cloud) // arguments.tiles)))
        fields = read_cloud(str(target)).fields
        equal = agreement(Labels(plain.patches.patch, label), Labels(fields["patch"], fields["suspicious"]))
        found |= {f"seed_{seed}_{name}": equal[name] for name in ("iou_by_points", "labels_equal")}
    return found


def lost(arguments: argparse.Namespace) -> dict[str, Any]:
    """Kill a worker of a Dask scheduler in the middle of a run, and compare the result with that of this process."""
    source = city(arguments.folder, arguments.points, arguments.points // 4)
    plain, killed = arguments.folder / "result_plain", arguments.folder / "result_killed"
    options = ["--tile-points", str(arguments.points // arguments.tiles)]
    classify(source, plain, *options)
    address = f"tcp://127.0.0.1:{arguments.port}"
    scheduler = start("scheduler", "--host", "127.0.0.1", "--port", str(arguments.port), "--no-dashboard")
    workers = [start("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard") for _ in range(2)]
    try:
        time.sleep(10.0)
        command = [sys.executable, "-m", "mapq", "classify", str(source), "-o", str(killed), "-f", *options]
        with subprocess.Popen([*command, "--scheduler", address], stdout=subprocess.DEVNULL) as process:
            wait_for_regions(arguments.folder, process)
            workers[0].send_signal(signal.SIGKILL)
            code = process.wait()
    finally:
        for each in (*workers, scheduler):
            each.kill()
            each.wait()
    one, other = labels_of(plain), labels_of(killed)
    same = {name: bool(np.array_equal(getattr(one, name), getattr(other, name))) for name in Labels._fields}
    rows = [json.loads((folder / "result.json").read_text())["patches"] for folder in (plain, killed)]
    return {"exit_code": code, "same": same, "same_json": rows[0] == rows[1]}


def start(role: str, *options: str) -> subprocess.Popen[bytes]:
    """Start a part of Dask."""
    command = [sys.executable, "-m", "distributed.cli.dask_" + role, *options]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def wait_for_regions(folder: Path, process: subprocess.Popen[bytes]) -> None:
    """Wait until some tile is segmented."""
    while process.poll() is None and not list(folder.glob(".result_killed.*.work/points_*")):
        time.sleep(0.05)


def main() -> None:
    """Run what the command line asks for, and print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "tiles", "drives", "lost"))
    parser.add_argument("--points", type=int, default=2_000_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tiles", type=int, default=16)
    parser.add_argument("--tile-points", type=int, default=POINTS_OF_TILE)
    parser.add_argument("--port", type=int, default=18786)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "mapq_city")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    found = {"run": run, "tiles": tiles, "drives": drives, "lost": lost}[arguments.what](arguments)
    for name, value in found.items():
        print(f"{name:<26}{value:.7g}" if isinstance(value, float) else f"{name:<26}{value}")


if __name__ == "__main__":
    main()
