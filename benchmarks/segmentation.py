"""Planes found in the test city, points a CPU second beside one search by scipy's tree, and bytes a point.

    python -m benchmarks.segmentation [N_POINTS]

Times are CPU seconds of a whole `segment()` with its kernels compiled, and of building and querying one
scipy.spatial.cKDTree (17 neighbours, one worker) of the same points in the same order of cells, by turns in one run;
and, where the extra `bench` is installed, of Open3D's normals (16 neighbours) and `detect_planar_patches`.
Memory is the peak of a process of its own, less what imports and kernels take.
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.city import City, make_city
from benchmarks.plane_scores import score_segmentation
from mapq.cloud import PointCloud
from mapq.configuration import SegmentSettings
from mapq.segmentation import STAGES, segment
from mapq.segmentation.points import sort_points

ALL_PLANES = SegmentSettings(surfaces=("upright", "level", "tilted"))
REPEATS = 3


def cpu(call: Callable[[], object]) -> float:
    """Return the CPU seconds that a call takes."""
    start = time.process_time()
    call()
    return time.process_time() - start


def show_quality(city: City) -> None:
    """Print how well the planes of the city are found."""
    patches = segment(PointCloud.from_world(city.xyz), ALL_PLANES)
    score = score_segmentation(patches.patch, city.plane)
    used = {name: round(float(patches.parameters[name]), 4) for name in ("spacing", "noise", "max_distance", "max_gap")}
    print(f"points               {len(city.xyz)}")
    print(f"parameters           {used}")
    print(f"planes IoU > 0.75    {score.n_matched} of {score.n_planes}")
    print(f"IoU mean, lowest     {score.mean_iou:.3f}, {score.iou.min():.3f}")
    print(f"patches              {len(patches)} (window panes among them)")
    print(f"over-segmented, under-segmented, missed: {score.over_segmented}, {score.under_segmented}, {score.missed}")


def show_speed(city: City) -> None:
    """Print points a CPU second, and the ratio to a search of scipy's tree."""
    cloud = PointCloud.from_world(city.xyz)
    cells = sort_points(cloud).xyz
    ours, tree = [], []
    for _ in range(REPEATS):
        ours.append(cpu(lambda: segment(cloud, ALL_PLANES)))
        tree.append(cpu(lambda: cKDTree(cells).query(cells, 17, workers=1)))
    ratios = [a / b for a, b in zip(ours, tree, strict=True)]
    print(f"points a CPU second  {len(cells) / statistics.median(ours):.0f}")
    print(f"ratio to cKDTree     {statistics.median(ratios):.2f} (from {min(ratios):.2f} to {max(ratios):.2f})")


def show_open3d(city: City) -> None:
    """Print the time of Open3D's planes of the same points beside ours, by turns."""
    try:
        import open3d
    except ImportError:
        print("Open3D               not installed: pip install '.[bench]'")
        return
    cloud, points = PointCloud.from_world(city.xyz), open3d.utility.Vector3dVector(city.xyz)
    near = open3d.geometry.KDTreeSearchParamKNN(16)

    def detect() -> int:
        theirs = open3d.geometry.PointCloud(points)
        theirs.estimate_normals(near)
        return len(theirs.detect_planar_patches(search_param=near))

    ratios = [cpu(detect) / cpu(lambda: segment(cloud, ALL_PLANES)) for _ in range(REPEATS)]
    print(f"Open3D by ours       {statistics.median(ratios):.2f} (from {min(ratios):.2f} to {max(ratios):.2f})")
    print(f"planes of Open3D     {detect()}")


def show_stages(city: City) -> None:
    """Print the share of the CPU time that each stage of one segmentation takes."""
    clock = StageClock()
    segment(PointCloud.from_world(city.xyz), ALL_PLANES, clock)
    clock(len(STAGES), stage="")
    total = sum(clock.seconds.values())
    print("stages               " + ", ".join(f"{name} {spent / total:.0%}" for name, spent in clock.seconds.items()))


class StageClock:
    """A reporter of progress that measures the CPU seconds between the stages reported to it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._stage, self._start = "", 0.0

    def __call__(self, completed: float, **fields: object) -> None:
        now = time.process_time()
        if self._stage:
            self.seconds[self._stage] = now - self._start
        self._stage, self._start = str(fields["stage"]), now


def peak() -> int:
    """Return the largest resident memory of this process in bytes.

    Not from getrusage, whose figure begins with that of the process which started this one.
    """
    status = Path("/proc/self/status").read_text()
    return 1024 * int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0])


def measure_memory(path: str) -> None:
    """Print the peak of this fresh process over the coordinates in a file, less that over a tiny cloud."""
    rng = np.random.default_rng(0)
    segment(PointCloud.from_world(rng.uniform(0, 1, (2000, 3)) * (10.0, 0.01, 5.0)), ALL_PLANES)
    before = peak()
    cloud = PointCloud(np.load(path), np.zeros(3))
    segment(cloud, ALL_PLANES)
    print(f"peak bytes a point   {(peak() - before) / len(cloud):.0f} (the coordinates' 24 included)")


def show_memory(city: City, folder: str) -> None:
    """Print the peak of a process of its own that segments the city."""
    path = f"{folder}/city.npy"
    np.save(path, city.xyz)
    subprocess.run([sys.executable, "-m", "benchmarks.segmentation", "--memory", path], check=True)


if __name__ == "__main__":
    import tempfile

    if sys.argv[1:2] == ["--memory"]:
        measure_memory(sys.argv[2])
    else:
        parser = argparse.ArgumentParser(description="Segment a city: quality, speed, stages, memory.")
        parser.add_argument("points", type=int, nargs="?", default=1_000_000, help="of the city")
        made = make_city(parser.parse_args().points)
        show_quality(made)
        show_speed(made)
        show_stages(made)
        show_open3d(made)
        with tempfile.TemporaryDirectory() as folder:
            show_memory(made, folder)
