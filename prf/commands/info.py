"""Show what is in a log: scans, beams, extent, ranges, and what looks suspicious."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from prf.configuration import Configuration
from prf.shell.cli.options import Json, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from prf.model.window import Window
    from prf.readings import Kind, Readings
    from prf.readings.describe import LogSummary

READ = ("topic", "frame", "poses", "beam_angles", "pose_mount", "pose_gap", "pose_offset", "pose_quaternion")
MOST_LINES = 15
DETAILS = ("log", "8 m or more", "other lines")
"""Rows for ``-v`` alone."""

EXAMPLES = (
    "prf info data/demo-office.log.gz",
    "prf info data/demo-office.log.gz --json",
    "gunzip -c data/demo-office.log.gz | prf info -",
)


Log = Annotated[
    str,
    typer.Argument(
        metavar="LOG", help="CARMEN or Player log, ROS bag or CSV table, also gzipped; - is standard input."
    ),
]
Sonar = Annotated[bool, typer.Option("--sonar", help="The sonar readings.  [laser if there are any, else sonar]")]
PointData = Annotated[bool, typer.Option("--point-data", help="LOG has values at points, CSV x,y,value.")]


@with_settings(Configuration, *(f"readings.{name}" for name in READ))
def info(
    log: Log,
    *,
    sonar: Sonar = False,
    point_data: PointData = False,
    settings: Loaded[Configuration],
    json: Json = False,
) -> None:
    """Show what is in a log: scans, beams, extent, ranges, and what looks suspicious.

    -v prints all lines and notes. Suspicious are poses that jump or by which scans disagree, clocks that do not run,
    ranges that are error codes, lines of unknown kinds. Whether loops are closed is not checked: look at the map for
    that.
    """
    from prf.readings import describe, read_readings
    from prf.sampler.prepare import given_poses
    from prf.shell.cli import console, storage
    from prf.shell.errors import UsageError

    if point_data:
        _tell_points(log, json)
        return
    if len(settings.settings.readings.poses) > 1:
        raise UsageError("--poses: one log has the poses of one file. Give one.")

    kind: Kind | None = "sonar" if sonar else None
    chosen = settings.settings.readings
    poses = next(iter(given_poses(chosen)), None)
    readings = read_readings(
        log, kind, topic=chosen.topic, frame=chosen.frame, poses=poses, beam_angles=chosen.beam_angles
    )
    summary = _with_pose_error(describe(readings, log), readings)
    if json:
        storage.emit_object("prf.info/1", storage.jsonable(summary))
    else:
        for line in _lines(summary):
            console.emit(line)


def _with_pose_error(summary: LogSummary, readings: Readings) -> LogSummary:
    """Return the summary with how far the poses of a laser err, and with what to do about it."""
    import dataclasses

    from prf.poses.given import given_errors
    from prf.readings.describe import Suspicion

    if summary.kind == "sonar" or _is_nan(summary.max_range):
        return summary
    found = given_errors(readings.within(summary.max_range), Configuration().laser.noise)
    if found is None:
        return summary
    advice = found.advice()
    suspicions = (*summary.suspicions, *([Suspicion("pose-error", advice)] if advice else []))
    return dataclasses.replace(summary, pose_error=(found.metres, found.radians), suspicions=suspicions)


def _tell_points(file: str, json: bool) -> None:
    from prf.readings import describe_points, read_point_data
    from prf.shell.cli import console, storage

    found = describe_points(read_point_data(file))
    if json:
        storage.emit_object("prf.info.points/1", found)
        return
    x0, y0, x1, y1 = found["extent"]
    rows = {
        "points": f"{found['source']}",
        "observations": f"{found['n_points']} at {found['n_places']} places",
        "extent": f"{x1 - x0:.4g} x {y1 - y0:.4g} m, x {x0:.4g} to {x1:.4g}, y {y0:.4g} to {y1:.4g}",
        "values": f"{found['lowest']:.4g} to {found['highest']:.4g}, mean {found['mean']:.4g}",
        "kind": f"{found['kind']}, unless given",
    }
    for name, value in rows.items():
        console.emit(f"{name:<16}{value}")


def _lines(summary: LogSummary) -> Iterator[str]:
    """Return the table for a person."""
    from prf.shell.cli import console

    rows = [row for row in _rows(summary) if console.is_verbose() or row[0] not in DETAILS]
    seen = [suspicion.message for suspicion in summary.suspicions] or ["nothing that these checks find"]
    notes = [("suspicious", message) for message in seen] + [("assumed", remark) for remark in summary.remarks]
    room = len(notes) if console.is_verbose() else MOST_LINES - len(rows)
    if len(notes) > room:
        notes[room - 1 :] = [("", f"{len(notes) - room + 1} notes more: prf info -v")]
    for name, value in (*rows, *notes):
        yield f"{name:<16}{value}"


def _rows(summary: LogSummary) -> Iterator[tuple[str, str]]:
    fewest, most = summary.beams_per_scan
    yield "log", summary.source
    yield "format", f"{summary.format} ({', '.join(summary.devices)})"
    yield "kind", summary.kind
    yield "scans", f"{summary.n_scans} of {fewest if fewest == most else f'{fewest} to {most}'} beams"
    invalid = f", {summary.n_invalid} dropped (not a number, or too short)" if summary.n_invalid else ""
    yield "beams", f"{summary.n_beams} usable, {summary.n_zero_ranges} dropped (range 0){invalid}"
    if summary.kind == "sonar":
        yield "cone", " to ".join(f"{cone:.3f}" for cone in sorted(set(summary.cones))) + " rad"
        yield "ring", _ring(summary.ring)
    yield "poses", summary.poses
    if summary.pose_error is not None:
        metres, radians = summary.pose_error
        yield "pose error", f"about {100.0 * metres:.2g} cm and {radians:.2g} rad, by which scans disagree"
    yield "path", f"{summary.path_length:.1f} m long, {_extent(summary.path_extent)}"
    yield "returns", _extent(summary.returns_extent)
    yield "duration", "unknown" if _is_nan(summary.duration) else f"{summary.duration:,.1f} s"
    yield "largest range", _metres(summary.largest_range)
    option = " by --sonar-max-range" if summary.kind == "sonar" else ""
    yield "max range", f"{_metres(summary.max_range)}, unless given{option}"
    yield "no return", f"{summary.share_no_return:.2%} of the beams are at the max range or beyond"
    if summary.kind == "laser":
        yield "8 m or more", f"{summary.share_far:.2%} of the beams"
    yield "other lines", _counts(summary.lines)


def _extent(extent: Window | None) -> str:
    if extent is None:
        return "none"
    x, y = (extent.x_min, extent.x_max), (extent.y_min, extent.y_max)
    return f"{x[1] - x[0]:.1f} x {y[1] - y[0]:.1f} m, x {x[0]:.1f} to {x[1]:.1f}, y {y[0]:.1f} to {y[1]:.1f}"


def _ring(ring: tuple[tuple[float, float, float], ...]) -> str:
    """Return where the transducers sit on the robot."""
    sites = ", ".join(f"({x:.3f} {y:.3f} {heading:.3f})" for x, y, heading in ring)
    return f"{len(ring)} transducers at x y heading {sites}" if ring else "not in the log"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in counts.items()) or "none"


def _metres(value: float) -> str:
    return "unknown" if _is_nan(value) else f"{value:.2f} m"


def _is_nan(value: float) -> bool:
    return value != value
