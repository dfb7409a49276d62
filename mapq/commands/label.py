"""Label patches plausible or suspicious by the majority of a point field."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from prf.shell.options import Json

if TYPE_CHECKING:
    from mapq.labels import LabelCounts

EXAMPLES = (
    "mapq label city.patches --from-field truth",
    "mapq label city.patches --from-field truth --force --json",
    "mapq label city.patches --from-field suspicious --conservative",
)


def label(
    patches: Annotated[
        str, typer.Argument(metavar="PATCHES", help="What mapq segment wrote; labels are stored in it.")
    ],
    from_field: Annotated[
        str | None,
        typer.Option(
            "--from-field",
            metavar="NAME",
            help="Point field with 1 where suspicious, 0 where plausible, 255 where not known (required).",
        ),
    ] = None,
    conservative: Annotated[
        bool,
        typer.Option(
            "--conservative", help="Plausible only if nine tenths of the points are, else suspicious, as in the paper."
        ),
    ] = False,
    json: Json = False,
    force: Annotated[bool, typer.Option("--force", "-f", help="Replace labels that were set by hand too.")] = False,
) -> None:
    """Label patches plausible or suspicious by the majority of a point field.

    A patch with as many points of either kind is suspicious. With --conservative every patch gets a label, and is
    plausible only if nine tenths of its points are: what is not known speaks against it. Labels of an earlier field are
    replaced. Labelling by hand comes with a later release.
    """
    from mapq.io import read_patches, write_patches
    from mapq.labels import label_from_field
    from prf.shell import console, jsonout
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    if patches == STREAM:
        raise UsageError("labels are stored in PATCHES itself, which standard input has no place for. Name a file.")
    found = read_patches(patches)
    if from_field is None:
        raise UsageError("name a point field with --from-field. Labelling by hand comes with a later release.")
    labelled, counts = label_from_field(found, from_field, patches, force, conservative)
    write_patches(patches, labelled)
    if json:
        jsonout.emit_object("mapq.label/1", {"patches": patches, "field": from_field, **counts._asdict()})
        return
    for line in _lines(counts):
        console.emit(line)


def _lines(counts: LabelCounts) -> Iterator[str]:
    """Return the table for a person."""
    yield f"patches         {counts.n_patches}"
    yield f"suspicious      {counts.n_suspicious}" + (f", {counts.n_ties} of them by a tie" if counts.n_ties else "")
    yield f"plausible       {counts.n_plausible}"
    yield f"without label   {counts.n_unlabelled}"
    if counts.n_kept:
        yield f"set by hand     {counts.n_kept}, kept (--force replaces them)"
