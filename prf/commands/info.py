"""Show what is in a log: scans, beams, extent, ranges, and what looks suspicious."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.configuration import Configuration
from prf.shell.cli.options import Json, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from prf.model.window import Window
    from prf.poses.given import PoseErrors
    from prf.poses.inputs import Inputs
    from prf.readings import Kind, Readings
    from prf.readings.describe import LogSummary

READ = ("topic", "frame", "poses", "beam_angles", "pose_mount", "pose_gap", "pose_offset", "pose_quaternion")
MOST_LINES = 15
DETAILS = ("log", "8 m or more", "other lines")
"""Rows for ``-v`` alone."""

POSES_TOO = "samples the poses with the map, for walls seen twice: compiles for minutes more, and takes far longer"

EXAMPLES = (
    "prf info data/demo-office.log.gz",
    "prf info data/demo-office.log.gz --json",
    "gunzip -c data/demo-office.log.gz | prf info -",
)


Files = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG|FILES...",
        help="CARMEN or Player log, ROS bag, CSV table, or ranges a row a scan; with it files of poses and odometry. "
        "Text, .npy, .npz, .mat, also gzipped; - is standard input.",
    ),
]
Sonar = Annotated[bool, typer.Option("--sonar", help="The sonar readings.  [laser if there are any, else sonar]")]
PointData = Annotated[bool, typer.Option("--point-data", help="LOG has values at points, CSV x,y,value.")]


@with_settings(Configuration, *(f"readings.{name}" for name in READ))
def info(
    files: Files,
    *,
    sonar: Sonar = False,
    point_data: PointData = False,
    settings: Loaded[Configuration],
    json: Json = False,
) -> None:
    """Show what is in a log: scans, beams, extent, ranges, and what looks suspicious.

    Of several files, or of one that is no log by itself, it says what each is, what is missing, and the command that
    maps them. -v prints all lines and notes. Suspicious are poses that jitter, jump or by which scans disagree, clocks
    that do not run, ranges that are error codes, lines of unknown kinds. Whether loops are closed is not checked: look
    at the map for that.
    """
    from prf.poses.inputs import sort_files
    from prf.shell.cli import console, storage
    from prf.shell.errors import UsageError

    if point_data:
        _tell_points(files[0], json)
        return
    chosen = settings.settings.readings
    if len(chosen.poses) > 1:
        raise UsageError("--poses: one log has the poses of one file. Give one.")
    found = sort_files([*files, *(each for each in chosen.poses if each not in files)])
    if chosen.beam_angles is not None:
        found = found._replace(beam_angles=chosen.beam_angles)
    rows = found.rows if len(found.rows) > 1 or found.missing else ()
    if found.missing:
        document = {"files": [{"name": name, "what": what} for name, what in found.rows], "missing": found.missing}
        if json:
            storage.emit_object("prf.info.files/1", {**document, "command": found.command("info")})
            return
        rows = (*rows, ("missing", found.missing), ("then", found.command("info")))
    else:
        summary = _summary(found, "sonar" if sonar else None, settings.settings)
        if json:
            storage.emit_object("prf.info/1", storage.jsonable(summary))
            return
        rows = (*rows, *_lines(summary), *([("map it", summary.command)] if summary.command else []))
        if summary.command_poses:
            rows = (*rows, ("poses too", summary.command_poses), ("", POSES_TOO))
    for name, value in rows:
        console.emit(f"{name:<15} {value}")


def _summary(found: Inputs, kind: Kind | None, config: Configuration) -> LogSummary:
    """Return what is in a log, how far the poses of a laser err, and the command that maps it."""
    import dataclasses

    from prf.poses.given import given_errors
    from prf.readings import describe
    from prf.readings.describe import WRONG_UNITS, Suspicion

    readings, is_raw = _read(found, kind, config)
    assert found.log is not None
    summary, errors = describe(readings, found.log), None
    suspicions = list(summary.suspicions)
    codes = {each.code for each in suspicions}
    if not codes.isdisjoint(WRONG_UNITS):
        return summary
    if summary.kind == "laser" and not _is_nan(summary.max_range):
        errors = given_errors(readings.within(summary.max_range), Configuration().laser.noise)
    if "angle" in codes and errors is not None and errors.advice():
        return summary  # scans that disagree and directions of many turns: degrees, with which nothing can be mapped
    flags, sampled = ("--odometry wheels" if is_raw or found.poses is None is not found.odometry else ""), ""
    if errors is not None:
        advice = errors.advice(flags)
        flags, sampled = (flags, "") if flags else _pose_flags(errors, found.odometry is not None)
        suspicions += [Suspicion("pose-error", advice)] if advice else []
        summary = dataclasses.replace(summary, pose_error=(errors.metres, errors.radians))
    typed = "".join(f" --{name} {value}" for name in ("topic", "frame") if (value := getattr(config.readings, name)))
    command, poses_too = (found.command(kind=summary.kind, flags=(each + typed).strip()) for each in (flags, sampled))
    poses_too = poses_too if sampled else ""
    return dataclasses.replace(summary, suspicions=tuple(suspicions), command=command, command_poses=poses_too)


def _pose_flags(errors: PoseErrors, has_odometry: bool) -> tuple[str, str]:
    """Return the options that map with poses as given, if these are good enough, and those that sample them too."""
    sampled, noise = errors.flags(), errors.covered()
    if has_odometry:
        sampled = "--odometry wheels" if errors.is_odometry else f"{errors.pose_noise()} --odometry wheels"
    if noise is None:
        return sampled, ""
    return f"--noise {noise:.2g}" if errors.flags() else "", sampled


def _read(found: Inputs, kind: Kind | None, config: Configuration) -> tuple[Readings, bool]:
    """Return the readings of a log, and whether it has no poses but raw odometry."""
    from prf.readings import read_readings
    from prf.sampler.prepare import given_poses
    from prf.shell.cli.files import STREAM
    from prf.shell.errors import InputError

    assert found.log is not None
    own = [found.poses or found.odometry] if found.poses or found.odometry else []
    options = config.readings.replace(poses=tuple(own), beam_angles=found.beam_angles)
    beside = found.odometry if found.poses is not None else None
    poses = next(iter(given_poses(options, beside)), None)
    how: dict[str, Any] = {
        "topic": options.topic,
        "frame": options.frame,
        "poses": poses,
        "beam_angles": options.beam_angles,
    }
    try:
        return read_readings(found.log, kind, **how), False
    except InputError:
        if poses is not None or found.log == STREAM:
            raise
        try:
            return read_readings(found.log, kind, odometry=True, **how), True
        except InputError:
            pass
        raise


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


def _lines(summary: LogSummary) -> Iterator[tuple[str, str]]:
    """Yield name and value of each row of the table for a person."""
    from prf.shell.cli import console

    rows = [row for row in _rows(summary) if console.is_verbose() or row[0] not in DETAILS]
    seen = [suspicion.message for suspicion in summary.suspicions] or ["nothing that these checks find"]
    notes = [("suspicious", message) for message in seen] + [("assumed", remark) for remark in summary.remarks]
    room = len(notes) if console.is_verbose() else MOST_LINES - len(rows)
    if len(notes) > room:
        notes[room - 1 :] = [("", f"{len(notes) - room + 1} notes more: prf info -v")]
    yield from (*rows, *notes)


def _rows(summary: LogSummary) -> Iterator[tuple[str, str]]:
    from prf.poses.plane import length_in_words

    fewest, most = summary.beams_per_scan
    yield "log", summary.source
    yield "format", f"{summary.format} ({', '.join(summary.devices)})"
    yield "kind", summary.kind
    yield "scans", f"{summary.n_scans} of {fewest if fewest == most else f'{fewest} to {most}'} beams"
    invalid = f", {summary.n_invalid} dropped (not a number, or too short)" if summary.n_invalid else ""
    yield "beams", f"{summary.n_beams} usable, {summary.n_zero_ranges} dropped (range 0){invalid}"
    if summary.range_unit:
        yield "ranges", summary.range_unit
    if summary.kind == "sonar":
        yield "cone", " to ".join(f"{cone:.3f}" for cone in sorted(set(summary.cones))) + " rad"
        yield "ring", _ring(summary.ring)
    yield "poses", summary.poses
    if summary.pose_error is not None:
        metres, radians = summary.pose_error
        yield "pose error", f"about {length_in_words(metres)} and {radians:.2g} rad, by which scans disagree"
    yield "path", f"{summary.path_length:.1f} m long, {_extent(summary.path_extent)}"
    yield "returns", _extent(summary.returns_extent)
    yield "duration", "unknown" if _is_nan(summary.duration) else f"{summary.duration:,.1f} s"
    yield "largest range", _metres(summary.largest_range)
    option = " by --sonar-max-range" if summary.kind == "sonar" else ""
    yield "max range", f"{_metres(summary.max_range)}, unless given{option}"
    far = ""
    if (advised := summary.max_range_advice) is not None:
        far = f", free so far; no return is beyond {summary.largest_return:.1f} m: advised is --max-range {advised:g}"
    yield "no return", f"{summary.share_no_return:.2%} of the beams are at the max range or beyond{far}"
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
