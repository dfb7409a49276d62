"""Files that readers of the pages bring: small ones of the right kind, under the names that the pages use."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from mapq.io import write_cloud, write_patches
from mapq.patches import Patches
from prf.readings import read_readings, write_table
from prf.results import write_run
from tests.conftest import ROOT
from tests.factories import make_room_run, make_run
from tests.mapq.labelled import draw_patches
from tests.mapq.posed.test_find import write_e57
from tests.readings.bags import Maker, Note, yaw
from tests.readings.samples import player_laser, position

Floats = NDArray[np.float64]

NO_INPUTS = ("-o", "--output")
"""Options whose values name no input file."""
OFFICE = ROOT / "data" / "demo-office.log.gz"
SONAR_REACH = 3.5


def bring(words: list[str], folder: Path, with_outputs: bool) -> None:
    """Make every file that a command names, that is not there, and that `MAKERS` know.

    `with_outputs`: also what another of our commands writes, for pages that begin in the middle of the work. Else a
    name that an earlier command of the page did not write is missing, as it is for a reader.
    """
    for before, word in pairwise(words):
        path = folder / word
        is_kind = before == "--world" and not path.suffix  # of a simulated world, no file
        if before in NO_INPUTS or is_kind or word.startswith("-") or path.exists():
            continue
        for pattern, make in MAKERS:
            if re.fullmatch(pattern, word):
                assert with_outputs or make not in WRITTEN, f"no command before has written {word}"
                path.parent.mkdir(parents=True, exist_ok=True)
                make(path)
                break


def make_log(path: Path) -> None:
    """Write a table of every third scan and sixth beam of the demo office."""
    readings = read_readings(str(OFFICE))
    write_table(path, readings.where((readings.scan % 3 == 0) & (readings.beam % 6 == 0)))


def make_ring(path: Path) -> None:
    """Write a table of sonar readings: what cones of 20 degrees round a few of those beams may have read."""
    readings = read_readings(str(OFFICE))
    readings = readings.where((readings.scan % 3 == 0) & (readings.beam % 20 == 10))
    rows = zip(*readings.origin.T, readings.angle, readings.range, readings.scan // 3, strict=True)
    lines = [
        f"{x:.3f},{y:.3f},{a:.5f},{r if r < SONAR_REACH else np.inf:.3f},0.349,{scan}" for x, y, a, r, scan in rows
    ]
    path.write_text("\n".join(["x,y,theta,range,cone,scan", *lines]) + "\n")


def make_bag(path: Path) -> None:
    """Write a ROS 1 bag with every third scan of the demo office, two sonars, and tf to the frame of the map."""
    make = Maker("ros1")
    notes = []
    for time, (pose, angle, distance) in enumerate(_scans(), start=1):
        heading = angle[len(angle) // 2]
        for frame in ("laser", "left", "right"):
            notes.append(Note("/tf", time, make.tf(time, "map", frame, (*pose, 0.0), yaw(heading))))
        fields = {"angle_min": angle[0] - heading, "angle_increment": angle[1] - angle[0], "range_max": 30.0}
        notes.append(Note("/scan", time, make.scan(time, distance.tolist(), **fields)))
        notes += [Note(f"/sonar_{side}", time, make.range(time, 2.0, side)) for side in ("left", "right")]
    make.write(path, notes)


def make_trajectory(path: Path) -> None:
    """Write where the robot was at the scans of that bag."""
    ahead = [(time, pose, angle[len(angle) // 2] / 2) for time, (pose, angle, _) in enumerate(_scans(), start=1)]
    path.write_text("".join(f"{t} {p[0]} {p[1]} 0 0 0 {np.sin(h)} {np.cos(h)}\n" for t, p, h in ahead))


def make_ranges(path: Path) -> None:
    """Write the ranges of every third scan of the demo office, a row a scan, and the poses."""
    table = read_readings(str(OFFICE))
    ranges = np.full((int(table.scan.max()) + 1, 180), np.inf)
    ranges[table.scan, table.beam] = table.range
    poses = np.array([table.notes.scans.pose[table.notes.scans.number == scan][0] for scan in range(len(ranges))])
    np.savetxt(path, ranges[::3] if path.name.startswith("ranges") else poses[::3])


def make_mat(path: Path) -> None:
    """Write those ranges and poses as a .mat."""
    for name in ("ranges.txt", "poses.txt"):
        make_ranges(path.with_name(name))
    arrays = {name: np.loadtxt(path.with_name(f"{name}.txt")) for name in ("ranges", "poses")}
    savemat(path, {**arrays, "angles": np.arange(-90.0, 90.0)})


def make_player(path: Path) -> None:
    """Write a log of Player 2.x with every third scan of the demo office, localized twice."""
    lines = []
    for time, (pose, angle, distance) in enumerate(_scans()):
        heading = angle[len(angle) // 2]
        lines += [position(*pose, heading, time), position(*pose, heading, time, index="01")]
        ranges = np.minimum(distance, 30.0).round(3).tolist()
        lines.append(player_laser(ranges, time, angle[0] - heading, angle[1] - angle[0], 30.0))
    path.write_text("".join(lines))


def _scans() -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield place, directions and ranges of every third scan of the demo office, every sixth beam."""
    readings = read_readings(str(OFFICE))
    readings = readings.where((readings.scan % 3 == 0) & (readings.beam % 6 == 0))
    for scan in np.unique(readings.scan):
        its = readings.scan == scan
        yield readings.origin[its][0], readings.angle[its], readings.range[its]


def make_points(path: Path) -> None:
    path.write_text("x,y\n2.0,7.0\n11.0,7.0\n20.0,3.0\n")


def make_route(path: Path) -> None:
    path.write_text("x,y\n3.0,7.0\n19.0,7.0\n")


def make_values(path: Path) -> None:
    """Write a bitmap of 12 x 12 pixels, a black block in white, a tenth of it flipped."""
    rng = np.random.default_rng(1)
    lines = [
        f"{x},{y},{int((4 <= x <= 8 and 3 <= y <= 9) != (rng.random() < 0.1))}" for y in range(12) for x in range(12)
    ]
    path.write_text("\n".join(["x,y,value", *lines]) + "\n")


def make_plan(path: Path) -> None:
    shutil.copy(ROOT / "data" / "demo-office.geojson", path)


@cache
def _patches(seed: int) -> Patches:
    return draw_patches(seed, labelled=False)


def make_cloud(path: Path) -> None:
    """Write walls along streets, a third of them twice; points have a scan number, and whether they are copies."""
    patches = _patches(len(path.stem) % 3 + 1)
    cloud = patches.cloud.with_fields(plane=patches.patch)
    if path.suffix == ".pcd":
        xyz = cloud.xyz + cloud.shift
        head = "VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
        head += f"WIDTH {len(xyz)}\nHEIGHT 1\nPOINTS {len(xyz)}\nDATA ascii\n"
        path.write_text(head + "".join(f"{x} {y} {z}\n" for x, y, z in xyz))
    else:
        write_cloud(str(path), cloud)


def make_patches(path: Path) -> None:
    write_patches(path, draw_patches(len(path.stem) % 3 + 1))


def make_result(path: Path) -> None:
    """Classify a small map."""
    from tests.docs.runner import TOOLS, run_app

    patches = path.with_name("brought.patches")
    make_patches(patches)
    assert run_app(TOOLS["mapq"], "mapq", ["classify", str(patches), "-o", str(path), "-q", "--force"]) == 0


def make_grid(path: Path) -> None:
    """Make a grid of the sonar readings."""
    from tests.docs.runner import TOOLS, run_app

    ring = path.with_name("brought.csv")
    make_ring(ring)
    assert run_app(TOOLS["prf"], "prf", ["grid", "--sonar", str(ring), "-o", str(path), "-q"]) == 0


def make_tiles(path: Path) -> None:
    """Write a folder of two tiles in LAZ."""
    path.mkdir()
    for number in (1, 2):
        make_cloud(path / f"{'t' * number}.laz")


def make_tiled_result(path: Path) -> None:
    """Classify such a folder."""
    from tests.docs.runner import TOOLS, run_app

    tiles = path.with_name("brought")
    make_tiles(tiles)
    assert run_app(TOOLS["mapq"], "mapq", ["classify", str(tiles), "-o", str(path), "-q"]) == 0


STOPS = (4.0, 18.0, 20.0, 34.0, 46.0, 48.0, 60.0)
"""Where those scans were taken along the street, in metres: some places were seen twice, others once."""


def make_scans(path: Path) -> None:
    """Write scans from a drive along those streets as KITTI lays them out, with right poses."""
    (path / "velodyne").mkdir(parents=True)
    for number, points in enumerate(_seen_from_stops()):
        rows = np.column_stack([points, np.zeros(len(points))])
        (path / "velodyne" / f"{number:06d}.bin").write_bytes(rows.astype("<f4").tobytes())
    make_poses(path / "poses.txt")


def make_stations(path: Path) -> None:
    """Write these scans as an E57."""
    poses = np.tile(np.eye(4), (len(STOPS), 1, 1))
    poses[:, :3, 3] = [(x, 6.0, 1.0) for x in STOPS]
    write_e57(path, _seen_from_stops(), poses)


def _seen_from_stops() -> list[Floats]:
    """Return what scans from those places see of the streets, each in its own frame."""
    rng = np.random.default_rng(5)
    cloud = _patches(1).cloud
    walls = np.repeat((cloud.xyz + cloud.shift)[cloud.fields["truth"] == 0], 3, axis=0)
    walls += rng.normal(0.0, 0.1, walls.shape) * [1.0, 0.0, 1.0]
    scans = []
    for x in STOPS:
        seen = walls - [x, 6.0, 1.0]
        seen = seen[(np.hypot(seen[:, 0], seen[:, 1]) < 10.0) & (rng.random(len(seen)) < 0.5)]
        scans.append(seen + rng.normal(0.0, 0.01, seen.shape))
    return scans


def make_poses(path: Path) -> None:
    """Write poses of those scans that are right, or, for odometry and the like, drift by a metre."""
    drift = 0.01 if path.stem in ("odometry", "chain") else 0.0
    rows = [f"1 0 0 {x} 0 1 0 {6.0 + drift * x} 0 0 1 1.0\n" for x in STOPS]
    path.write_text("".join(rows))


def make_settings(path: Path) -> None:
    path.write_text({"flips": "[points]\nflip_probability = 0.1\n"}.get(path.stem, "[sonar]\nmax_range = 3.0\n"))


def make_run_folder(path: Path) -> None:
    write_run(path, make_run(n_draws=12))


def make_rooms(path: Path) -> None:
    write_run(path, make_room_run())


def make_ros_map(path: Path) -> None:
    """Write a room of 10 x 8 m as a ROS map."""
    pixels = np.full((80, 100), 254, np.uint8)
    pixels[:3], pixels[-3:], pixels[:, :3], pixels[:, -3:] = 0, 0, 0, 0
    path.with_suffix(".pgm").write_bytes(b"P5 100 80 255\n" + pixels.tobytes())
    path.write_text(
        f"image: {path.stem}.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


MAKERS: tuple[tuple[str, Callable[[Path], None]], ...] = (
    (r"points\.csv", make_points),
    (r"(path|route)\.csv", make_route),
    (r"door\.csv", lambda path: path.write_text("x,y\n8.0,1.5\n8.0,4.5\n")),
    (r"drive\.csv", lambda path: path.write_text("x,y\n3.0,3.0\n7.0,3.0\n7.0,5.0\n")),
    (r"(bitmap|soil|taps)\.csv", make_values),
    (r"(ring|elsewhere)\.csv", make_ring),
    (r"(drive|later|trace0|a|b)\.bag", make_bag),
    (r"(slam|later|a|b)\.tum", make_trajectory),
    (r"player\.log", make_player),
    (r"(ranges|poses|odom)\.txt", make_ranges),
    (r"scans\.mat", make_mat),
    (r"(?!data/).*\.log(\.gz)?|doors\.csv|readings\.csv", make_log),
    (r"(floor|plan|truth)\.geojson", make_plan),
    (r".*\.classified\.(ply|laz|las)", make_result),
    (r".*\.classified/", make_tiled_result),
    (r"(?!data/).*\.(ply|laz|las|pcd)", make_cloud),
    (r".*\.e57", make_stations),
    (r".*\.patches", make_patches),
    (r"(sequences/)?00|scans|drive/", make_scans),
    (r"pcd", make_scans),
    (r"(odometry|slam|chain|icp)\.txt", make_poses),
    (r"calib\.txt", lambda path: path.write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")),
    (r"city/", make_tiles),
    (r"(sonar|site|flips|robot)\.toml", make_settings),
    (r"office|ring|posterior|run", make_run_folder),
    (r"rooms", make_rooms),
    (r"map\.yaml", make_ros_map),
    (r".*\.grid\.npz", make_grid),
)
"""Names, in the order in which they are tried, and what makes such a file."""
WRITTEN = (make_result, make_tiled_result, make_patches, make_run_folder, make_rooms, make_grid)
"""Makers of what our own commands write."""
