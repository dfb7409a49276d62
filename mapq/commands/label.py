"""Label patches plausible or suspicious: by hand on a page, or by the majority of a point field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated

import typer

from prf.shell.cli.options import Json

EXAMPLES = (
    "mapq label city.patches",
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
            help="Point field with 1 where suspicious, 0 where plausible, 255 where not known; or floats, metres "
            "apart. No page is opened.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="METRES",
            min=0.001,
            help="With --from-field: suspicious is what is farther apart than this.  [0.3]",
        ),
    ] = None,
    conservative: Annotated[
        bool,
        typer.Option(
            "--conservative", help="Plausible only if nine tenths of the points are, else suspicious, as in the paper."
        ),
    ] = False,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="MODEL",
            help="Model by which patches are uncertain.  [that of the package]",
        ),
    ] = None,
    port: Annotated[
        int, typer.Option("--port", metavar="N", min=0, max=65535, help="Port of the page.  [a free one]")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Open no browser; the address is printed on standard error.")
    ] = False,
    json: Json = False,
    force: Annotated[
        bool, typer.Option("--force", "-f", help="With --from-field: replace labels that were set by hand too.")
    ] = False,
) -> None:
    """Label patches plausible or suspicious: by hand on a page, or by the majority of a point field.

    By hand: a page in the browser, served to this machine alone, asks for the most uncertain patch first: p plausible,
    s suspicious, u unsure, z undoes. Each label is on the disk before the next patch is shown, and in PATCHES when
    labelling ends, by the button or by Ctrl-C. It resumes where it stopped, also after a crash.

    With --from-field a patch with as many points of either kind is suspicious; of metres apart the median of each patch
    is kept too, from which mapq train learns all tolerances. With --conservative every patch gets a
    label, and is plausible only if nine tenths of its points are: what is unknown counts against it. Labels of an
    earlier field are replaced.
    """
    from prf.shell.cli.files import STREAM
    from prf.shell.errors import UsageError

    if patches == STREAM:
        raise UsageError("labels are stored in PATCHES itself, which standard input has no place for. Name a file.")
    if (conservative or force or tolerance is not None) and from_field is None:
        raise UsageError("--tolerance, --conservative and --force are for --from-field.")
    if from_field is not None and (model is not None or port or no_browser):
        raise UsageError("--model, --port and --no-browser are for the page, which --from-field does not open.")
    if from_field is not None:
        _from_field(patches, from_field, tolerance, conservative, force, json)
    else:
        _by_hand(patches, model, port, not no_browser, json)


def _from_field(path: str, name: str, tolerance: float | None, conservative: bool, force: bool, json: bool) -> None:
    """Label by a point field."""
    from dataclasses import replace

    from mapq.labelling.store import relabel
    from mapq.patches import Patches, label_from_field
    from prf.shell.cli import console, storage

    def labelled(patches: Patches) -> tuple[Patches, dict[str, int]]:
        judged = patches if tolerance is None else replace(patches, label_tolerance=tolerance)
        return label_from_field(judged, name, path, force, conservative)

    counts = relabel(path, labelled)
    if json:
        storage.emit_object("mapq.label/1", {"patches": path, "field": name, **counts})
        return
    for line in (*_field_lines(counts), f"labels          in {path}"):
        console.summarize(line)


def _by_hand(path: str, model: str | None, port: int, browser: bool, json: bool) -> None:
    """Label on the page."""
    from mapq.io.models import read_model
    from mapq.labelling import label_by_hand
    from prf.shell.cli import console, storage

    counts = label_by_hand(path, None if model is None else read_model(model), port, browser)
    if json:
        storage.emit_object("mapq.label.hand/1", {"patches": path, **counts})
        return
    for line in (*_hand_lines(counts), f"labels          in {path}"):
        console.summarize(line)


def _field_lines(counts: Mapping[str, int]) -> Iterator[str]:
    """Return the table for a person."""
    yield f"patches         {counts['n_patches']}"
    yield f"suspicious      {counts['n_suspicious']}" + (
        f", {counts['n_ties']} of them by a tie" if counts["n_ties"] else ""
    )
    yield f"plausible       {counts['n_plausible']}"
    yield f"without label   {counts['n_unlabelled']}"
    if counts["n_kept"]:
        yield f"set by hand     {counts['n_kept']}, kept (--force replaces them)"


def _hand_lines(counts: Mapping[str, int]) -> Iterator[str]:
    """Return the table for a person."""
    yield f"patches         {counts['n_patches']}"
    yield f"set by hand     {counts['n_by_hand']}"
    yield f"plausible       {counts['n_plausible']}"
    yield f"suspicious      {counts['n_suspicious']}"
    yield f"unsure          {counts['n_unsure']}, left out of training"
    if counts["n_from_field"]:
        yield f"from a field    {counts['n_from_field']}"
