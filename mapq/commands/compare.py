"""Compare two maps of one place: which is better, and where."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.commands._options import ModelFile
from mapq.configuration import Configuration, parse_share
from prf.shell.cli.console import is_verbose
from prf.shell.cli.options import Json, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from mapq.results.compare import Comparison, Place

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq compare odometry.classified.ply slam.classified.ply",
    "mapq compare yesterday.pcd today.pcd --fail-over 1%",
    "mapq compare before.patches after.patches --cell 10 --json",
)

N_PLACES = 3
"""Places of each kind that are listed without -v."""
LITTLE = 0.1
"""Share of both maps' areas below which common ground is doubtful."""


@with_settings(Configuration, "cloud", "crf.tolerance")
def compare(
    first: Annotated[
        str,
        typer.Argument(
            metavar="A",
            help="A map: RESULT of mapq classify (also in tiles), PATCHES, or a cloud, which is assessed now.",
        ),
    ],
    second: Annotated[str, typer.Argument(metavar="B", help="Another map of the same place, in the same frame.")],
    *,
    settings: Loaded[Configuration],
    model: ModelFile = None,
    cell: Annotated[
        float, typer.Option("--cell", metavar="METRES", help="Side of the cubes in which the maps are compared.")
    ] = 5.0,
    fail_over: Annotated[
        float | None,
        typer.Option(
            "--fail-over",
            metavar="SHARE",
            parser=parse_share,
            help="Exit 1 if B has a larger share of suspicious area than A, by more than this: 0, 0.01 or 1%.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Compare two maps of one place: which is better, and where.

    Only common ground counts: cells in which both have patches. Where scans are known in both, the better map is the
    one whose scans disagree by less; else that of which a smaller share is expected to be wrong: the mean of
    p_suspicious over the area. Both are judged at one tolerance. Places are cells side by side whose expected share
    differs by more than a quarter. The maps are not aligned.
    """
    from mapq.io.models import read_model
    from mapq.results.compare import check_cell, comparison_content
    from mapq.results.compare import compare as compare_maps
    from mapq.results.judged import read_judged
    from prf.shell.cli import console, storage
    from prf.shell.errors import CheckFailed

    used = read_model(model) if model is not None else None
    check_cell(cell)
    chosen = settings.settings
    one, other = (read_judged(name, used, cell, chosen.cloud, chosen.crf.tolerance) for name in (first, second))
    found = compare_maps(one, other, cell)
    if found.covered.max() < LITTLE:
        logger.warning(
            "common ground is %.1f %% of %s and %.1f %% of %s: are both in one frame?",
            *(value for row in zip(100.0 * found.covered, (first, second), strict=True) for value in row),
        )
    rise = float(found.suspicious[1] - found.suspicious[0])
    passed = None if fail_over is None else bool(rise <= fail_over)
    if json:
        verdict = {"rise_of_share": rise, "fail_over": fail_over, "passed": passed}
        content = {"files": [first, second], "model": model or "default", **comparison_content(found)}
        storage.emit_object("mapq.compare/1", {**content, "verdict": verdict})
    else:
        for line in _lines(found, first, second):
            console.emit(line)
    if passed is False:
        raise CheckFailed(
            f"{second}: the suspicious share of the area rose by {rise:.1%} over {first}, more than {fail_over:.1%}."
        )


def _lines(found: Comparison, first: str, second: str) -> Iterator[str]:
    """Return the table for a person."""
    yield f"{'common ground':<16}{found.n_cells} cells of {found.cell:g} m, judged at {found.tolerance:.2f} m"
    heads = ("area", "in common", "judged", "suspicious", "expected", "scans apart")
    yield f"{'':<16}" + "".join(f"{head:>12}" for head in heads)
    for place, (name, path) in enumerate(zip("AB", (first, second), strict=True)):
        shares = (column[place] for column in (found.covered, found.coverage, found.suspicious, found.expected))
        metres = _known(found.disagreement[place], ".3f", " m")
        yield (
            f"{name:<16}{found.area[place]:>9.1f} m2"
            + "".join(f"{_known(share, '.1%'):>12}" for share in shares)
            + f"{metres:>12}  {path}"
        )
    for worse in (False, True):
        places = [place for place in found.places if place.worse is worse]
        if places:
            word = "worse" if worse else "better"
            n_most = len(places) if is_verbose() else N_PLACES
            shown = "" if len(places) <= n_most else f", the {n_most} largest"
            yield f"B is {word} at {len(places)} place{'' if len(places) == 1 else 's'}{shown}:"
            yield from map(_place_line, places[:n_most])
    yield f"{'verdict':<16}{_verdict(found)}"


def _known(value: float, form: str, unit: str = "") -> str:
    return "-" if value != value else f"{value:{form}}{unit}"


def _verdict(found: Comparison) -> str:
    """Return which map is better, and by what."""
    low, value, high = found.difference.tolist()
    verdicts = {"first": "A is better", "second": "B is better", "same": "neither is better"}
    word, low, value, high = ("more", low, value, high) if value >= 0.0 else ("less", -high, -value, -low)
    if found.by == "disagreement":
        how = f"scans of B disagree by {value:.3f} m ({low:.3f} to {high:.3f}) {word} than those of A"
    else:
        how = f"{value:.1%} {word} of the area of B than of A is expected to be wrong"
    return f"{verdicts[found.better]}: {how}"


def _place_line(place: Place) -> str:
    box = " to ".join(" ".join(f"{value:.0f}" for value in corner.tolist()) for corner in (place.low, place.high))
    change = f"{place.change:+.1f} m2 suspicious of {place.area:.1f}"
    return f"  {change}, {place.before:.0%} before and {place.after:.0%} after, in {box}"
