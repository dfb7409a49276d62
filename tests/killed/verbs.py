"""The commands that are killed, on inputs that keep them short, and what each leaves when it is whole."""

from __future__ import annotations

import gzip
import json
import shutil
import sys
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapq.cloud import PointCloud
from mapq.io import read_cloud, write_ply
from tests.killed.child import complete
from tests.mapq.factories import wall
from tests.mapq.perturb.scenes import look, pose_at
from tests.mapq.posed.test_poses import rows

CHECKPOINT_SECONDS = 0.1
"""Between two checkpoints of a run, so that a run of a second has several."""
START = "import prf.sampler.session as s; s.CHECKPOINT_SECONDS = {seconds}; from prf.cli import main; main()"
OF_PROCESS = ("command", "created", "seconds", "steps_per_second", "inputs", "output", "path", "files")
"""Keys of JSON results that differ between runs in different folders, or hold times."""
STEPS = 60_000
"""Of each chain of a run, chosen so that it lasts as long as its start-up."""

Digest = dict[str, bytes]


def prf(*args: object) -> list[str]:
    """Return the command line of a verb of prf."""
    return [sys.executable, "-m", "prf", *map(str, args), "-q"]


def sample(*args: object) -> list[str]:
    """Return the command line of prf sample that leaves checkpoints often."""
    return [sys.executable, "-c", START.format(seconds=CHECKPOINT_SECONDS), "sample", *map(str, args), "-q"]


def mapq(*args: object) -> list[str]:
    """Return the command line of a verb of mapq."""
    return [sys.executable, "-m", "mapq", *map(str, args), "-q"]


@dataclass(frozen=True)
class Verb:
    """A command under test.

    Attributes
    ----------
    name : str
    command : callable
        Makes the command line of the inputs' folder and of the folder of the output.
    outputs : tuple of str
        Names in that folder, all of which a whole result has.
    edits : str
        Input that the verb changes in place, copied into the folder of the output first; "" for none.
    moments : int
        Weight in the draw of verbs.
    resumes : callable, optional
        Makes the command line that goes on with what is left.
    start_up : float
        Seconds after which the command surely listens to signals.
    best_so_far : bool
        Whether a signal makes it write the best that it has found until then.
    """

    name: str
    command: Callable[[Path, Path], list[str]]
    outputs: tuple[str, ...]
    edits: str = ""
    moments: int = 1
    resumes: Callable[[Path, Path], list[str]] | None = None
    start_up: float = 0.5
    best_so_far: bool = False

    def put_inputs(self, inputs: Path, folder: Path) -> None:
        """Copy what the verb changes in place."""
        folder.mkdir(parents=True)
        if self.edits:
            shutil.copy(inputs / self.edits, folder / self.edits)

    def digest(self, folder: Path) -> Digest:
        """Return what there is of the result, without times and names of folders."""
        paths = (folder / name for name in self.outputs)
        return {path.name: _content(path) for path in paths if path.exists()}


def _content(path: Path) -> bytes:
    if path.suffix in (".json", ".geojson") and path.name != "map.geojson":
        return json.dumps(_without_times(json.loads(path.read_bytes())), sort_keys=True).encode()
    if path.suffix == ".npz":
        with zipfile.ZipFile(path) as archive:
            parts = {name: archive.read(name) for name in archive.namelist() if name != "process.npy"}
        return repr(sorted(parts.items())).encode()
    return path.read_bytes()


def _without_times(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_times(each) for key, each in value.items() if key not in OF_PROCESS}
    return [_without_times(each) for each in value] if isinstance(value, list) else value


def laser(inputs: Path) -> tuple[object, ...]:
    """Return the options that say what a map is made from."""
    thin = ("--every-scan", 4, "--every-beam", 6, "--chains", 2, "--threads", 1, "--seed", 7)
    return ("--laser", inputs / "office.log", *thin)


RUN = tuple(
    f"a.run/{name}"
    for name in ("draws.npz", "posterior.npz", "readings.npz", "map.geojson", "checkpoint.npz", "posterior.png")
)

VERBS = (
    Verb(
        "prf sample",
        lambda i, o: sample(*laser(i), "--steps", STEPS, "-o", o / "a.run"),
        (*RUN, "a.run/diagnostics.json", "a.run/manifest.json"),
        moments=3,
        resumes=lambda _, o: sample("--resume", o / "a.run", "--steps", STEPS, "--threads", 1),
        start_up=1.5,
    ),
    Verb(
        "prf anneal",
        lambda i, o: prf("anneal", *laser(i), "--steps", 100_000, "-o", o / "a.geojson"),
        ("a.geojson",),
        best_so_far=True,
    ),
    Verb("prf grid", lambda i, o: prf("grid", "--laser", i / "office.log", "-o", o / "a.npz"), ("a.npz",)),
    Verb("mapq segment", lambda i, o: mapq("segment", i / "town.ply", "-o", o / "a.patches"), ("a.patches",)),
    Verb("mapq train", lambda i, o: mapq("train", i / "town.patches", "-o", o / "m.json"), ("m.json",)),
    Verb(
        "mapq classify",
        lambda i, o: mapq("classify", i / "town.ply", "-o", o / "a.ply"),
        ("a.ply", "a.json"),
    ),
    Verb(
        "mapq classify --workers 2",
        lambda i, o: mapq("classify", i / "town.ply", "-o", o / "a.ply", "--workers", 2, "--tile-points", 10_000),
        ("a.ply", "a.json"),
        moments=2,
    ),
    Verb(
        "mapq label",
        lambda _, o: mapq("label", o / "bare.patches", "--from-field", "truth"),
        ("bare.patches",),
        edits="bare.patches",
    ),
    Verb("mapq report", lambda i, o: mapq("report", i / "result.ply", "-o", o / "a.html"), ("a.html",)),
    Verb(
        "mapq perturb",
        lambda i, o: mapq(
            *("perturb", i / "scans", "--poses", i / "odometry.txt", "--reference", i / "scans" / "poses.txt"),
            *("-o", o / "a.ply"),
        ),
        ("a.ply", "a.json"),
    ),
)


def make_inputs(root: Path, folder: Path) -> None:
    """Write the inputs of all verbs into `folder`, from the small data that travel with the project."""
    folder.mkdir(parents=True)
    (folder / "office.log").write_bytes(gzip.decompress((root / "data" / "demo-office.log.gz").read_bytes()))
    town = read_cloud(str(root / "data" / "demo-town.ply.gz"))
    world = town.world()
    near = (np.abs(world - np.median(world, axis=0))[:, :2] < 12.0).all(axis=1)
    kept = {name: values[near] for name, values in town.fields.items()}
    write_ply(str(folder / "town.ply"), PointCloud.from_world(world[near].astype(np.float32), kept))
    _call("segment", folder / "town.ply", "-o", folder / "bare.patches")
    shutil.copy(folder / "bare.patches", folder / "town.patches")
    _call("label", folder / "town.patches", "--from-field", "truth")
    _call("classify", folder / "town.ply", "-o", folder / "result.ply")
    make_scans(folder)


def _call(*args: object) -> None:
    code, err, _ = complete(mapq(*args))
    assert code == 0, err


def make_scans(folder: Path) -> None:
    """Write scans of a long wall with their poses, and poses of which half are wrong."""
    poses = np.array([pose_at(3.0 + 1.5 * scan, -5.0, 5.0 * scan) for scan in range(8)])
    scans = folder / "scans"
    scans.mkdir()
    for number, pose in enumerate(poses):
        seen = look([wall((0.0, 0.0), (18.0, 0.0))], pose, number, 40.0)
        local = (seen - pose[:3, 3]) @ pose[:3, :3]
        write_ply(str(scans / f"{number}.ply"), PointCloud.from_world(local.astype(np.float32)))
    (scans / "poses.txt").write_text(rows(poses[:, :3].reshape(-1, 12)))
    poses[4:, 1, 3] += 0.5
    (folder / "odometry.txt").write_text(rows(poses[:, :3].reshape(-1, 12)))
