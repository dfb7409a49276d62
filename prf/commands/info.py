"""Say what is in a log: scans, beams, extent, ranges, and what looks suspicious."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from prf.shell.options import Json

if TYPE_CHECKING:
    from prf.logs.describe import Extent, LogSummary

EXAMPLES = (
    "prf info data/demo-office.log.gz",
    "prf info data/demo-office.log.gz --json",
    "gunzip -c data/demo-office.log.gz | prf info -",
)


def info(
    log: Annotated[
        str, typer.Argument(metavar="LOG", help="A CARMEN log or a CSV table, also gzipped; - is standard input.")
    ],
    json: Json = False,
) -> None:
    """Say what is in a log: scans, beams, extent, ranges, and what looks suspicious.

    Suspicious are poses that jump, clocks that do not run, ranges that are error codes, lines of unknown kinds. Whether
    the poses agree with one another over loops is not checked: look at the map for that.
    """
    from prf.logs import describe, read_readings
    from prf.shell import console, jsonout

    summary = describe(read_readings(log), log)
    if json:
        jsonout.emit_object("prf.info/1", jsonout.jsonable(summary))
    else:
        for line in _lines(summary):
            console.emit(line)


def _lines(summary: LogSummary) -> Iterator[str]:
    """Return the table for a person."""
    for name, value in _rows(summary):
        yield f"{name:<16}{value}"
    for remark in summary.remarks:
        yield f"{'assumed':<16}{remark}"
    for suspicion in summary.suspicions:
        yield f"{'suspicious':<16}{suspicion.message}"
    if not summary.suspicions:
        yield f"{'suspicious':<16}nothing that these checks see"


def _rows(summary: LogSummary) -> Iterator[tuple[str, str]]:
    fewest, most = summary.beams_per_scan
    yield "log", summary.source
    yield "format", f"{summary.format} ({', '.join(summary.devices)})"
    yield "scans", f"{summary.n_scans} of {fewest if fewest == most else f'{fewest} to {most}'} beams"
    yield "beams", f"{summary.n_beams} usable, {summary.n_zero_ranges} dropped (range 0)"
    yield "path", f"{summary.path_length:.1f} m long, {_extent(summary.path_extent)}"
    yield "returns", _extent(summary.returns_extent)
    yield "duration", "unknown" if _is_nan(summary.duration) else f"{summary.duration:,.1f} s"
    yield "largest range", _metres(summary.largest_range)
    yield "max range", f"{_metres(summary.max_range)}, unless given"
    yield "no return", f"{summary.share_no_return:.2%} of the beams are at the max range or beyond"
    yield "8 m or more", f"{summary.share_far:.2%} of the beams"
    yield "other lines", _counts(summary.lines)


def _extent(extent: Extent | None) -> str:
    if extent is None:
        return "none"
    x, y = (extent.x_min, extent.x_max), (extent.y_min, extent.y_max)
    return f"{x[1] - x[0]:.1f} x {y[1] - y[0]:.1f} m, x {x[0]:.1f} to {x[1]:.1f}, y {y[0]:.1f} to {y[1]:.1f}"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in counts.items()) or "none"


def _metres(value: float) -> str:
    return "unknown" if _is_nan(value) else f"{value:.2f} m"


def _is_nan(value: float) -> bool:
    return value != value
