"""Show what a result is, how it was made, and the state of its files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.shell.cli.options import Json

if TYPE_CHECKING:
    from prf.results.inspection import FileState

MAIN = ("kind", "created", "command", "inputs[0].path", "status", "seed")
"""Entries that are printed without ``-v``."""

EXAMPLES = (
    "prf inspect office",
    "prf inspect office.grid.npz --json",
    "prf inspect office/map.geojson",
    "prf inspect draws.geojsonl",
)


def inspect(
    source: Annotated[
        str, typer.Argument(metavar="RUN|GRID|MAP|DRAWS", help="From prf sample, grid, anneal or prior.")
    ],
    json: Json = False,
) -> None:
    """Show what a result is, how it was made, and the state of its files.

    Prints how the result was made, with -v its whole record (of a run and a grid: versions, configuration, seed,
    inputs, status), and for each file whether it is ok, missing, damaged or of another version. A file that cannot be
    read makes the exit code 3; a missing one does not, since a run may end early, nor a checkpoint of another version,
    since draws are read.
    """
    from prf.results.inspection import inspect as look_into
    from prf.shell.cli import console, storage
    from prf.shell.errors import InputError

    kind, manifest, files = look_into(source)
    if json:
        content = {"path": source, "kind": kind, "manifest": manifest}
        storage.emit_object("prf.inspect/1", {**content, "files": [file._asdict() for file in files]})
    else:
        rows = dict(_flat({"kind": kind, **manifest}))
        main = rows if console.is_verbose() else {name: rows[name] for name in MAIN if name in rows}
        hidden = [] if main == rows else [f"({len(rows) - len(main)} more entries: prf inspect -v)"]
        for line in (*_manifest_lines(main), *hidden, *_file_lines(files)):
            console.emit(line)
    for state in ("damaged", "other version"):
        lost = [file.name for file in files if file.state == state and file.is_lost]
        if lost:
            raise InputError(f"{source}: {state}: {', '.join(lost)}.")


def _manifest_lines(rows: Mapping[str, str]) -> Iterator[str]:
    width = max(map(len, rows)) + 2
    return (f"{name:<{width}}{value}" for name, value in rows.items())


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield dotted names and values; lists of plain values stay on one line."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for number, item in enumerate(value):
            yield from _flat(item, f"{name}[{number}]")
    elif isinstance(value, list):
        yield name, " ".join(map(str, value))
    else:
        yield name, "-" if value is None else str(value)


def _file_lines(files: list[FileState]) -> Iterator[str]:
    width = max(18, *(len(file.name) + 2 for file in files))
    for file in files:
        size = "" if file.bytes is None else f"{file.bytes:,} B"
        yield f"{file.name:<{width}}{file.state:<14}{size:>15}  {file.summary}".rstrip()
