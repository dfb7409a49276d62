"""Every public cloud as it is read: points, speed, and whether it comes back to the last bit.

    python -m benchmarks.formats [FOLDER]
    python -m benchmarks.formats --large [N_POINTS]

Files of FOLDER that are no clouds, such as tables of poses, are left out. "comes back": read, written (LAS as LAZ, all
else as PLY) and read again, coordinates and fields have the same bits. Seconds are CPU seconds of the first reading.

With --large the same cloud of N_POINTS (5 million) with intensity and colours in some formats: points a CPU second, and
the peak of memory of a process that does nothing else, beside the arrays of the cloud.
"""

from __future__ import annotations

import gc
import logging
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.real_data import DATA
from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io import read_cloud, write_cloud
from prf.shell.errors import PrfError

ENDS = (".pcd", ".ply", ".las", ".laz", ".e57", ".ptx", ".npy", ".csv", ".bin", ".bin.gz", ".3d.gz", ".xyz")
THREE_COLUMNS = ("newer_college_01", "gtsam_points_kitti_00")
LARGE = ("a.ply", "a.las", "a.laz", "a.npy", "a.xyz")


def main(arguments: list[str]) -> None:
    """Print the table of a folder, that of large files, or the peak of a process that reads one."""
    logging.disable(logging.WARNING)
    if arguments[:1] == ["--large"]:
        show_large(int(arguments[1]) if len(arguments) > 1 else 5_000_000)
    elif arguments[:1] == ["--peak"]:
        show_peak(arguments[1])
    else:
        show_folder(Path(arguments[0]) if arguments else DATA)


def show_folder(folder: Path) -> None:
    """Print for each group of files how many points they hold, how fast they are read, and whether they come back."""
    print(f"{'files':<44}{'number':>7}{'points':>12}{'seconds':>9}  comes back")
    for name, paths in groups(folder):
        n_points, seconds, same, refused = 0, 0.0, True, ""
        for path in paths:
            start = time.process_time()
            try:
                cloud = read_cloud(str(path), options_of(path))
            except PrfError as error:
                refused = str(error).removeprefix(str(path)).removeprefix(": ").partition(". ")[0]
                continue
            seconds += time.process_time() - start
            n_points += len(cloud)
            same &= comes_back(cloud)
        reported = refused or ("yes" if same else "NO")
        print(f"{name:<44}{len(paths):>7}{n_points:>12,}{seconds:>9.2f}  {reported}")


def groups(folder: Path) -> Iterator[tuple[str, list[Path]]]:
    """Yield the clouds, those of one folder and format together where there are more than four."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.rglob("*")):
        end = next((end for end in ENDS if path.name.endswith(end)), None)
        if end is not None and path.is_file():
            found.setdefault(f"{path.parent.relative_to(folder)}/*{end}", []).append(path)
    for name, paths in found.items():
        if len(paths) > 4:
            yield name, paths
        else:
            yield from ((str(path.relative_to(folder)), [path]) for path in paths)


def options_of(path: Path) -> ReadOptions:
    """Return what a file of the public data does not say of itself: columns and units."""
    return ReadOptions(
        bin_columns=3 if path.parent.name in THREE_COLUMNS else 4, unit=0.01 if path.suffix == ".npy" else None
    )


def comes_back(cloud: PointCloud) -> bool:
    """Return whether a cloud is the same to the last bit after it was written and read."""
    with tempfile.TemporaryDirectory() as folder:
        copy = str(Path(folder) / ("copy.laz" if cloud.las_header else "copy.ply"))
        write_cloud(copy, cloud)
        again = read_cloud(copy, ReadOptions(unit=None if cloud.las_header else float(cloud.unit[0])))
    same = cloud.xyz.tobytes() == again.xyz.tobytes() and list(cloud.fields) == list(again.fields)
    return same and all(values.tobytes() == again.fields[name].tobytes() for name, values in cloud.fields.items())


def show_large(n_points: int) -> None:
    """Print speed and peak memory of reading each format, for so many points."""
    rng = np.random.default_rng(0)
    world = rng.uniform(0, 200, (n_points, 3)).round(3) + np.array([437_000.0, 5_428_000.0, 100.0])
    fields = {"intensity": rng.integers(0, 65_536, n_points, dtype=np.uint16)}
    fields |= {name: rng.integers(0, 65_536, n_points, dtype=np.uint16) for name in ("red", "green", "blue")}
    cloud = PointCloud.from_world(world, fields)
    print(f"{n_points:,} points\n{'file':<8}{'MB':>8}{'million points a second':>26}{'peak MB':>10}{'arrays MB':>11}")
    with tempfile.TemporaryDirectory() as folder:
        for name in LARGE:
            path = Path(folder) / name
            if name.endswith(".npy"):
                np.save(path, np.column_stack([world, *fields.values()]))
            elif name.endswith(".xyz"):
                np.savetxt(path, np.column_stack([world, *fields.values()]), "%.3f %.3f %.3f %d %d %d %d")
            else:
                write_cloud(path, cloud)
            command = [sys.executable, "-m", "benchmarks.formats", "--peak", str(path)]
            reported = subprocess.run(command, capture_output=True, text=True, check=True).stdout
            seconds, peak, arrays = map(float, reported.split())
            size = path.stat().st_size / 1e6
            print(f"{name:<8}{size:>8.0f}{n_points / seconds / 1e6:>26.2f}{peak:>10.0f}{arrays:>11.0f}")
            path.unlink()


def show_peak(path: str) -> None:
    """Print CPU seconds and peak MB of reading a file, and the MB of its arrays."""
    write_cloud("/dev/null", PointCloud.from_world(np.zeros((1, 3))))
    if path.endswith((".las", ".laz")):
        import laspy  # noqa: F401
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # forgets the peak so far, a parent's included
    before = peak_kb()
    start = time.process_time()
    cloud = read_cloud(path)
    seconds = time.process_time() - start
    peak = peak_kb() - before
    arrays = cloud.xyz.nbytes + sum(values.nbytes for values in cloud.fields.values())
    print(seconds, peak / 1e3, arrays / 1e6)


def peak_kb() -> int:
    """Return the largest resident memory of this process in kB."""
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1])


if __name__ == "__main__":
    main(sys.argv[1:])
