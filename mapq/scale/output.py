"""Where the result of a map in tiles goes: one cloud with a JSON beside it, or a folder of tiles with one in it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mapq.io.result_folder import RESULT_JSON
from mapq.io.results import claim_result, json_beside, result_lines
from mapq.io.write import LAS_SUFFIXES
from mapq.scale.source import Source
from prf.shell.errors import OutputExists, UsageError
from prf.shell.files import STREAM, atomic_write
from prf.shell.lock import claim, claim_output
from prf.shell.together import together

CLOUD_SUFFIXES = (*LAS_SUFFIXES, ".ply")
COPC = ".copc.laz"


class Output(NamedTuple):
    """What is written: for each file the places of the sources whose points it takes, and the JSON."""

    path: str
    is_folder: bool
    files: dict[str, list[int]]
    json: str


def plan_output(path: str, sources: list[Source], is_tiled: bool, force: bool) -> Output:
    """Return what is written under a name: a folder for a folder, unless the name is that of a cloud.

    Raises
    ------
    OutputExists, OutputError
        If it stands and `force` is not given, or cannot be written.
    UsageError
        If it is standard output, in a format that is not written in tiles, or the folder of the input.
    """
    if path == STREAM:
        raise UsageError("a map in tiles cannot go to standard output. Name a file or a folder with -o.")
    if not is_tiled or path.lower().endswith(CLOUD_SUFFIXES) or path == os.devnull:
        claim_result(path, force)
        files = {} if path == os.devnull else {path: list(range(len(sources)))}
        return Output(path, False, files, json_beside(path))
    folder = Path(path)
    if folder.is_dir() and any(os.path.samefile(folder, Path(source.path).parent) for source in sources):
        raise UsageError(f"{path} is the input and would be overwritten. Name another folder with -o.")
    if not folder.is_dir():
        claim_output(path, force)
    elif not force and any(folder.iterdir()):
        raise OutputExists(f"{path} already exists. Use --force to overwrite.")
    claim(path)
    return Output(path, True, {_name(source): [place] for place, source in enumerate(sources)}, RESULT_JSON)


def _name(source: Source) -> str:
    """Return the name of a tile of the result: that of the source; COPC becomes plain LAZ."""
    name = Path(source.path).name
    return name[: -len(COPC)] + ".laz" if name.lower().endswith(COPC) else name


def made_in(folder: str, output: Output) -> dict[str, list[int]]:
    """Return the files as they are made in the work folder."""
    return {os.path.join(folder, f"made_{Path(name).name}"): files for name, files in output.files.items()}


def publish(folder: str, output: Output, head: Mapping[str, Any], patches: Iterable[Mapping[str, Any]]) -> None:
    """Move the files from the work folder to their places, and the JSON after them, together.

    Raises
    ------
    OutputError
        If that cannot be done.
    """
    if output.path == os.devnull:
        return
    target = Path(output.path)
    if output.is_folder:
        target.mkdir(exist_ok=True)
    with together() as group:
        for name in output.files:
            made = os.path.join(folder, f"made_{Path(name).name}")
            group.add(made, Path(os.path.realpath(target / name if output.is_folder else target)))
        with atomic_write(target / output.json if output.is_folder else output.json) as stream:
            stream.writelines(result_lines(head, patches))
