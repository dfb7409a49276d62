"""State of every file of a RUN directory, for ``prf inspect``: nothing here raises over a damaged file."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from prf.kernels.constants import STEP
from prf.run import names
from prf.run.read import read_best, read_draws, read_image, read_manifest, read_readings
from prf.shell.errors import PrfError
from prf.shell.files import open_input
from prf.shell.storage import OtherVersion, damaged, load_arrays, load_object, take_array

_OLD_CHECKPOINT = (
    "this release reads the draws, but cannot go on from here. Use the release that wrote it, or sample anew."
)
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"


class FileState(NamedTuple):
    """State of one file: "ok", "missing", "damaged" or "other version"; what it holds, or why it cannot be read."""

    name: str
    state: str
    bytes: int | None
    schema: str | None
    summary: str

    @property
    def is_lost(self) -> bool:
        """Whether it stands there and cannot be read, nor the run without it, as without an old checkpoint."""
        spare = self.state == "other version" and self.name == names.CHECKPOINT
        return self.state in ("damaged", "other version") and not spare


def inspect_files(path: str | os.PathLike[str]) -> list[FileState]:
    """Return the state of every file that a RUN directory may hold, in the order of the documentation."""
    folder = Path(path)
    if not (folder / names.MANIFEST).is_file():
        read_manifest(folder)  # says what is wrong with the folder itself
    return [_inspect(folder / name, summarise) for name, summarise in _SUMMARIES.items()]


def _inspect(file: Path, summarise: Callable[[Path], str]) -> FileState:
    schema = {**names.SCHEMAS, names.CHECKPOINT: names.CHECKPOINT_SCHEMA}.get(file.name)
    if not file.is_file():
        return FileState(file.name, "missing", None, schema, "")
    size = file.stat().st_size
    try:
        return FileState(file.name, "ok", size, schema, summarise(file))
    except OtherVersion as error:
        words = f"{error.found}: {_OLD_CHECKPOINT}" if file.name == names.CHECKPOINT else _without_name(error, file)
        return FileState(file.name, "other version", size, error.found, words)
    except PrfError as error:
        return FileState(file.name, "damaged", size, schema, _without_name(error, file))


def _without_name(error: PrfError, file: Path) -> str:
    return str(error).removeprefix(f"{file}: ")


def _summarise_manifest(file: Path) -> str:
    return f"status {load_object(file, names.SCHEMAS[names.MANIFEST]).get('status', 'unknown')}"


def _summarise_draws(file: Path) -> str:
    fields: dict[str, Any] = read_draws(file)
    chains = len(set(fields["chain"].tolist()))
    edges = fields["draws"].n_edges
    middle = f", {edges.mean():.0f} edges on average" if len(edges) else ""
    return f"{len(edges)} draws of {chains} chains{middle}; functionals {', '.join(fields['functionals']) or 'none'}"


def _summarise_image(file: Path) -> str:
    image = read_image(file)
    n_rows, n_columns = image.occupancy.shape
    return f"{n_columns} x {n_rows} cells of {image.resolution:g} m"


def _summarise_readings(file: Path) -> str:
    found = read_readings(file)
    beams, cones, points = found["beams"], found["cones"], found["points"]
    parts = []
    if beams is not None:
        parts.append(f"{len(beams.angle)} beams, {len(beams.impacts())} with a return below {beams.max_range:g} m")
    if cones is not None:
        n_returns = int(np.count_nonzero(cones.returned))
        parts.append(f"{len(cones.angle)} sonar readings, {n_returns} with a return below {cones.max_range:g} m")
    if points is not None:
        parts.append(f"{len(points.value)} points")
    return "; ".join(parts)


def _summarise_best(file: Path) -> str:
    coloring, log_posterior = read_best(file)
    return f"best map: {coloring.n_edges} edges, log posterior {log_posterior:.2f}"


def _summarise_diagnostics(file: Path) -> str:
    content = load_object(file, names.SCHEMAS[names.DIAGNOSTICS])
    return str(content.get("reason", ""))


def _summarise_checkpoint(file: Path) -> str:
    arrays = load_arrays(file, names.CHECKPOINT_SCHEMA)
    chains = [name for name in arrays if name.endswith(".graph.counts") and ".rung" not in name]
    counts = [take_array(file, arrays, name, np.int64, (None,)) for name in chains]
    if not counts or min(map(len, counts)) <= STEP:
        raise damaged(file, "no chain in it")
    return f"{len(counts)} chains at step {int(counts[0][STEP]):,}"


def _summarise_picture(file: Path) -> str:
    width, height = png_size(file)
    return f"{width} x {height} pixels"


def png_size(file: Path) -> tuple[int, int]:
    """Return width and height of a PNG file whose chunks are whole, by their check sums."""
    with open_input(file) as stream:
        data = stream.read()
    if not data.startswith(PNG_MAGIC):
        raise damaged(file, "not a PNG picture")
    place, kind, size = len(PNG_MAGIC), b"", (0, 0)
    while kind != b"IEND":
        (length,) = struct.unpack(">I", data[place : place + 4].rjust(4, b"\0"))
        chunk, check = data[place + 4 : place + 8 + length], data[place + 8 + length : place + 12 + length]
        if zlib.crc32(chunk) != int.from_bytes(check) or len(check) < 4:
            raise damaged(file, "the picture is cut off or changed")
        kind = chunk[:4]
        if kind == b"IHDR":
            if length < 8:
                raise damaged(file, "the picture says no size")
            size = struct.unpack(">II", chunk[4:12])
        place += 12 + length
    return size


_SUMMARIES: dict[str, Callable[[Path], str]] = {
    names.MANIFEST: _summarise_manifest,
    names.DRAWS: _summarise_draws,
    names.POSTERIOR: _summarise_image,
    names.READINGS: _summarise_readings,
    names.MAP: _summarise_best,
    names.DIAGNOSTICS: _summarise_diagnostics,
    names.CHECKPOINT: _summarise_checkpoint,
    names.PICTURE: _summarise_picture,
}
