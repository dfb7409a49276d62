"""One export from its start to its files."""

from __future__ import annotations

import os
from pathlib import PurePath
from typing import Any, NamedTuple

from prf.agreement import agreement
from prf.coloring import oriented_polygons
from prf.export import formats
from prf.export.cells import cells_of
from prf.export.dxf import dxf_text
from prf.export.formats import Options
from prf.export.known import cut_to_known
from prf.export.netcdf import netcdf_bytes
from prf.export.ros_map import ros_map
from prf.export.shapes import counts
from prf.export.source import Source, read_source, require_existing, stem_of
from prf.export.svg import paper_ratio, svg_text
from prf.run import map_text
from prf.shell.files import encoded, open_output, refuse_inputs
from prf.shell.lock import held_outputs
from prf.shell.together import together

AGREED = 0.99
"""Share of the seen ground on which chains agree, below which an export warns."""


class File(NamedTuple):
    """A file that was written, and its size."""

    path: str
    bytes: int


class Exported(NamedTuple):
    """What was written: format, files, figures about the content, and what its user should know."""

    format: str
    files: tuple[File, ...]
    facts: dict[str, Any]
    notes: tuple[str, ...]


class _Content(NamedTuple):
    parts: tuple[str | bytes, ...]
    facts: dict[str, Any]
    notes: tuple[str, ...] = ()


def export_source(path: str | os.PathLike[str], output: str | None, options: Options, force: bool = False) -> Exported:
    """Write a run, a grid or one map in the form of another program.

    Parameters
    ----------
    path : path
        RUN directory, GRID file or map in GeoJSON.
    output : str or None
        Where to; None: named after the source, in the working directory. ``-`` is standard output.
    options : Options
    force : bool
        Overwrite what stands.

    Returns
    -------
    Exported

    Raises
    ------
    InputError
        If the source cannot be read, or lacks what the format needs.
    UsageError
        If the options do not go together, or the format needs a library that is not installed.
    OutputError
        If the output stands already, or cannot be written.
    """
    require_existing(path)
    name = formats.resolve_format(options.format, output)
    formats.check_options(name, options)
    targets = formats.targets(name, output, stem_of(path), options.mode or formats.TRINARY)
    with held_outputs(targets, force):
        refuse_inputs(targets, [os.fspath(path)])
        source = read_source(path)
        content = _content(name, source, options, targets)
        _write(targets, content.parts)
    sizes = [len(encoded(part) if isinstance(part, str) else part) for part in content.parts]
    return Exported(name, tuple(map(File, targets, sizes)), content.facts, (*content.notes, *chains_notes(source)))


def _content(name: str, source: Source, options: Options, targets: tuple[str, ...]) -> _Content:
    if name == formats.NETCDF:
        return _netcdf(source)
    if name == formats.ROS_MAP:
        return _ros_map(source, options, PurePath(targets[1]).name)
    chosen = source.choose_map(options.draw)
    if options.draw is None:
        chosen = cut_to_known(chosen, source.image, options.extrapolate or 0.0)
    area, window = oriented_polygons(chosen.coloring), chosen.coloring.window
    facts, title = {"map": chosen.title, **counts(area)._asdict()}, _printable(chosen.title)
    if name == formats.GEOJSON:
        return _Content((map_text(chosen.coloring, chosen.properties),), facts)
    if name == formats.DXF:
        return _Content((dxf_text(area, window, title),), facts)
    return _Content((svg_text(area, window, title),), {**facts, "scale": f"1:{paper_ratio(window):g}"})


def chains_notes(source: Source) -> tuple[str, ...]:
    """Return a line where the chains of a run disagree on what was seen; of a grid or one map there is none."""
    image = None if source.run is None else source.run.image
    if image is None or image.disagreement is None:
        return ()
    found = agreement(image.disagreement, image.seen, image.origin, image.resolution)
    if not found.seen < AGREED:
        return ()
    return (f"{found.words()}. Sample longer before you rely on it there: prf sample --resume {source.path}",)


def _printable(title: str) -> str:
    """Return a title in one line, with escapes for what is no character of a text: XML and DXF cannot hold it."""
    plain = " ".join(title.split())
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in plain)


def _ros_map(source: Source, options: Options, image_name: str) -> _Content:
    mode = options.mode or formats.TRINARY
    cells = cells_of(source, options)
    made = ros_map(cells, mode, options.unknown, image_name)
    n_rows, n_columns = cells.probability.shape
    facts = {"mode": mode, "n_columns": n_columns, "n_rows": n_rows, "resolution": cells.resolution}
    return _Content(
        (made.yaml, made.image), {**facts, **made.counts}, () if mode == formats.TRINARY else (_served(mode),)
    )


def _served(mode: str) -> str:
    return (
        f"mode {mode} is served as probabilities in per cent: a costmap that takes only 100 for an obstacle "
        "needs a lower lethal_threshold, such as 65."
    )


def _netcdf(source: Source) -> _Content:
    run = source.require_run("chains")
    content, chains = netcdf_bytes(run)
    n_chains, n_draws = chains.rows.shape
    facts = {"n_chains": n_chains, "n_draws_per_chain": n_draws, "n_draws_left_out": chains.n_left_out}
    note = f"chains of uneven length: {chains.n_left_out} of {len(run.chain)} draws left out, beyond the shortest one."
    return _Content((content,), facts, (note,) if chains.n_left_out else ())


def _write(targets: tuple[str, ...], parts: tuple[str | bytes, ...]) -> None:
    """Write the files, which take their places together; the yaml file, which names the image, comes last."""
    with together():
        for target, part in reversed(list(zip(targets, parts, strict=True))):
            with open_output(target, binary=isinstance(part, bytes)) as stream:
                stream.write(part)
