"""Show how a run was made, and the state of its files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.shell.options import Json

if TYPE_CHECKING:
    from prf.run import FileState

EXAMPLES = ("prf inspect office", "prf inspect office --json")


def inspect(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Directory that prf sample wrote.")],
    json: Json = False,
) -> None:
    """Show how a run was made, and the state of its files.

    Prints the manifest (versions, configuration, seed, inputs, status) and for each file whether it is ok, missing or
    damaged. A damaged file makes the exit code 3; a missing one does not, since a run may end early.
    """
    from pathlib import Path

    from prf.run import inspect_files, read_manifest
    from prf.shell import console, jsonout
    from prf.shell.errors import InputError

    manifest = read_manifest(Path(run))
    files = inspect_files(run)
    if json:
        content = {"path": run, "manifest": manifest, "files": [file._asdict() for file in files]}
        jsonout.emit_object("prf.inspect/1", content)
    else:
        for line in (*_manifest_lines(manifest), "", *_file_lines(files)):
            console.emit(line)
    damaged = [file.name for file in files if file.state == "damaged"]
    if damaged:
        raise InputError(f"{run}: damaged: {', '.join(damaged)}.")


def _manifest_lines(manifest: Mapping[str, Any]) -> Iterator[str]:
    rows = list(_flat(manifest))
    width = max(len(name) for name, _ in rows) + 2
    return (f"{name:<{width}}{value}" for name, value in rows)


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
    for file in files:
        size = "" if file.bytes is None else f"{file.bytes:,} B"
        yield f"{file.name:<18}{file.state:<9}{size:>15}  {file.summary}".rstrip()
