"""Readers of prf, each with whole files to begin from."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from prf.calibrate import read_known_map
from prf.coloring import read_geojsonl, write_geojsonl
from prf.export.source import read_source
from prf.inspection import inspect
from prf.logs import Kind, describe, describe_points, read_point_data, read_readings
from prf.logs.suspicions import find_suspicions
from prf.occupancy import read_grid, write_grid
from prf.run import names, read_run, write_run
from prf.run.points import read_points
from prf.score import read_occupied_area
from prf.settings_file import check_settings, read_settings
from prf.shell.errors import InputError, PrfError
from prf.shell.storage import save_arrays
from prf.simulate import read_world
from prf.simulate.path_file import read_path
from prf.window import Window
from tests.factories import make_run, random_draws
from tests.fuzz.reader import Reader
from tests.logs.bags import START, Maker, Note, drive
from tests.logs.samples import flaser, player, player1, player_laser, position, robot_laser
from tests.test_occupancy import BEAM, build

CARMEN = "# FLASER\nPARAM a b nohost 0\n" + flaser([1.5, 0, 81.83]) + "NEFF 3\n" + robot_laser([1, 2])
SONAR = "ODOM 0 0 0 0 0 0 1 h 1\nSONAR 0.3 2 1 2 0.1 0 0.5 0.1 0 -0.5 1.5 h 1.5\nODOM 1 0 0 0 0 0 2 h 2\n"
PLAYER = (
    player("laser", (0.1, 0, 0, 0.1, 0.1), kind="004 001")
    + position(0, 0, 0, 1)
    + player_laser([1, 2], 1.5)
    + player("sonar", (8, *[1.0] * 8), 1.6)
    + position(1, 0, 0, 2)
)
PLAYER1 = player1("position", (0, 0, 0, 0, 0, 0, 0), 1.0) + player1(
    "laser", (-90, 90, 45, 4, 1, 0, 2, 0, 3, 0, 4, 0), 1
)
TABLE = "x,y,theta,range,cone,t,scan\n1,2,0.5,3,0,1,0\n1.5,2,0.5,inf,0,,0\n2,2,0,,0.1,2,1\n"
SETTINGS = "[prior]\nscale = 0.1\nwindow = [0, 0, 10.5, 20]\n[laser]\nnoise = 0.03\nmax_range = 20\n"
SETTINGS += '[points]\nkind = "binary"\n'
YAML = (
    "image: a.pgm\nresolution: 0.05\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
PGM = b"P5\n4 3\n255\n" + bytes([0, 255, 205, 254] * 3)
GEOJSON = (
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"window": [0, 0, 10, 10]}, '
    '"geometry": {"type": "Polygon", "coordinates": [[[1, 1], [4, 1], [4, 4], [1, 4], [1, 1]]]}}, {"type": "Feature", '
    '"properties": {}, "geometry": {"type": "MultiPolygon", "coordinates": [[[[5, 5], [6, 5], [6, 6], [5, 5]]]]}}]}'
)


def _log(path: Path) -> None:
    """Read a log for every kind of sensor, and all that is told of it."""
    for kind in (None, "laser", "sonar"):
        _told(path, kind)


def _told(path: Path, kind: Kind | None) -> None:
    try:
        readings = read_readings(str(path), kind)
    except InputError:
        if kind is None:
            raise
        return
    with np.errstate(all="raise", under="ignore"):
        describe(readings, str(path))
        find_suspicions(readings)


def _texts(*texts: str) -> Callable[[Path], Sequence[bytes]]:
    return lambda _: [text.encode() for text in texts]


def _bag(kind: str, folder: Path) -> Sequence[bytes]:
    make = Maker(kind)
    notes = [*drive(make), Note("/scan", START + 0.5, make.scan(START + 0.5, [1.0, 2.0, np.inf]))]
    notes.append(Note("/sonar", START + 0.6, make.range(START + 0.6, 1.5, "laser")))
    path = make.write(folder / "made.bag", sorted(notes, key=lambda note: note.time))
    files = [path] if path.is_file() else [file for file in path.iterdir() if file.suffix in (".db3", ".mcap")]
    return [files[0].read_bytes()]


def _run(folder: Path) -> Path:
    write_run(folder / "run", make_run(n_draws=2, window=Window(-2.0, -2.0, 4.0, 2.0)))
    run = folder / "run"
    arrays = {"run": np.array("a"), "chain0.graph.counts": np.arange(40), "chain0.ladder.powers": np.ones(3)}
    save_arrays(run / names.CHECKPOINT, names.CHECKPOINT_SCHEMA, arrays)
    return run


def _part(name: str) -> Callable[[Path], Sequence[bytes]]:
    return lambda folder: [(_run(folder) / name).read_bytes()]


def _of_run(path: Path) -> None:
    """Read a part of a run with the others beside it; a summary says what is damaged, and reading refuses it."""
    inspect(path.parent)
    read_run(path.parent)


def _beside(path: Path) -> None:
    run = _run(path)
    for file in run.iterdir():
        file.rename(path / file.name)


def _grid(folder: Path) -> Sequence[bytes]:
    write_grid(folder / "a.npz", build(BEAM))
    return [(folder / "a.npz").read_bytes()]


def _draws(folder: Path) -> Sequence[bytes]:
    write_geojsonl(folder / "a.geojsonl", random_draws(1, 2, scale=0.1))
    return [(folder / "a.geojsonl").read_bytes()]


def _settings(path: Path) -> None:
    check_settings(path)
    read_settings(path)


def _each(*reads: Callable[[Path], Any]) -> Callable[[Path], None]:
    """Read a file in several ways, each of which may refuse it; the last error is that of the whole."""

    def read_each(path: Path) -> None:
        last: PrfError | None = None
        for read in reads:
            try:
                read(path)
            except PrfError as error:
                last = error
        if last is not None:
            raise last

    return read_each


_map = _each(inspect, read_occupied_area, read_source, read_world)
_cell_map = _each(partial(read_world, unknown_is_occupied=True), read_world, read_known_map)
"""As the world to be simulated, and as the map to calibrate in."""


def _points(path: Path) -> None:
    table = read_point_data(path)
    describe_points(table)
    table.refuse_other_than_colours()


def _ros2(folder: Path) -> Path:
    """Write the folder of a ROS 2 bag and return it."""
    make = Maker("sqlite3")
    notes = [*drive(make), Note("/scan", START + 0.5, make.scan(START + 0.5, [1.0, 2.0, np.inf]))]
    return make.write(folder / "bag", sorted(notes, key=lambda note: note.time))


def _metadata(folder: Path) -> Sequence[bytes]:
    return [(_ros2(folder) / "metadata.yaml").read_bytes()]


def _beside_metadata(folder: Path) -> None:
    bag = _ros2(folder)
    for file in bag.iterdir():
        file.rename(folder / file.name)
    bag.rmdir()


def _png(_: Path) -> Sequence[bytes]:
    from matplotlib.image import imsave

    stream = io.BytesIO()
    imsave(stream, np.zeros((2, 3)), format="png")
    return [PGM, stream.getvalue()]


def _raster(image: Path) -> None:
    _cell_map(image.parent / "map.yaml")


READERS: dict[str, Reader] = {
    "carmen": Reader(
        "a.log", lambda _: [CARMEN.encode(), SONAR.encode(), gzip.compress(CARMEN.encode(), mtime=0)], _log
    ),
    "player": Reader("a.log", _texts(PLAYER, PLAYER1), _log),
    "table": Reader("a.csv", _texts(TABLE), _log),
    "ros1": Reader("a.bag", partial(_bag, "ros1"), _log),
    "ros2-sqlite": Reader("a.db3", partial(_bag, "sqlite3"), _log),
    "ros2-mcap": Reader("a.mcap", partial(_bag, "mcap"), _log),
    "points": Reader("a.csv", _texts("x,y,value\n1,2,1\n# a\n3,4,0\n"), _points),
    "query-points": Reader("a.csv", _texts("x,y\n1,2\n3,4\n", "1,2,3\n4,5,6\n"), read_points),
    "path": Reader("a.csv", _texts("x,y,theta,t\n1,2,0,1\n# a\n3,4,0,2\n", "1,2\n3,4\n"), read_path),
    "settings": Reader("a.toml", _texts(SETTINGS), _settings),
    "geojson": Reader("a.geojson", _texts(GEOJSON), _map),
    "map": Reader("a.geojson", _part(names.MAP), _map),
    "draws-lines": Reader("a.geojsonl", _draws, read_geojsonl),
    "grid": Reader("a.npz", _grid, read_grid),
    "ros2-metadata": Reader("metadata.yaml", _metadata, lambda path: _log(path.parent), _beside_metadata),
    "cell-map": Reader("map.yaml", _texts(YAML), _cell_map, lambda folder: (folder / "a.pgm").write_bytes(PGM)),
    "cell-image": Reader("a.pgm", _png, _raster, lambda folder: (folder / "map.yaml").write_text(YAML)),
    **{
        f"run-{Path(name).stem}": Reader(name, _part(name), _of_run, _beside)
        for name in (names.MANIFEST, names.DRAWS, names.POSTERIOR, names.READINGS, names.MAP, names.DIAGNOSTICS)
    },
    "run-picture": Reader(names.PICTURE, lambda folder: _png(folder)[1:], _of_run, _beside),
    "run-checkpoint": Reader(names.CHECKPOINT, _part(names.CHECKPOINT), _of_run, _beside),
}
