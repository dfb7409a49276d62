"""Make a labelled map from posed scans: merged as they are, or with known errors of their poses."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer

from mapq.commands._options import Calibration, Config, Every, Pattern, Poses, Submaps
from mapq.commands._scans import ScanOptions, find_settings
from prf.shell.cli.options import Assignments, Force, Json, Output, Seed

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq perturb sequences/00 --drift 0.5 1 --seed 1 -o drifted.ply",
    "mapq perturb scans --poses odometry.txt --reference slam.txt -o odometry.ply",
    "mapq perturb 0.pcd 1.pcd --poses poses.txt --submaps -o map.ply",
)


def perturb(
    scans: Annotated[
        list[str], typer.Argument(metavar="SCANS...", help="A folder of scans, an E57 file, or the files of the scans.")
    ],
    poses: Poses = None,
    reference: Annotated[
        str | None, typer.Option("--reference", metavar="FILE", help="The right poses, which show what is displaced.")
    ] = None,
    pattern: Pattern = None,
    calibration: Calibration = None,
    every: Every = 1,
    submaps: Submaps = False,
    offset: Annotated[
        float, typer.Option("--offset", metavar="METRES", help="Displace every scan but the first by this.")
    ] = 0.0,
    yaw: Annotated[
        float, typer.Option("--yaw", metavar="DEG", help="Turn every scan but the first about its sensor.")
    ] = 0.0,
    drift: Annotated[
        tuple[float, float],
        typer.Option("--drift", metavar="METRES DEG", help="Errors that grow along the way, to these at its end."),
    ] = (0.0, 0.0),
    missed_loop: Annotated[
        tuple[float, float],
        typer.Option("--missed-loop", metavar="METRES DEG", help="Displace all scans from the first revisit on."),
    ] = (0.0, 0.0),
    config: Config = None,
    assignments: Assignments = None,
    seed: Seed = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a labelled map from posed scans: merged as they are, or with known errors of their poses.

    Point field `suspicious` is 1 where scans that see the same surface disagree along its normal, 0 where they agree or
    one alone saw it, 255 where that is ambiguous or unknown. With errors the given poses are the right ones; else
    --reference has them, or, without it, small pieces of the scans are registered to each other. The table [perturb] of
    the settings has the bounds of both labels, [scans] ranges and thinning.
    """
    from dataclasses import asdict

    from mapq.configuration import load_configuration
    from mapq.perturb import PoseErrors, Rule, build
    from mapq.perturb.files import SCHEMA, target_files, write_map
    from mapq.posed import find_scans, replace_poses
    from prf.shell.cli import console, storage
    from prf.shell.cli.outputs import refuse_inputs
    from prf.shell.cli.progress import progress
    from prf.shell.cli.provenance import resolve_seed

    loaded = load_configuration({"config": config, "assignments": assignments}, "perturb", "scans", "cloud").settings
    chosen = loaded.perturb
    find = find_settings(ScanOptions(poses, calibration, pattern, every, submaps), loaded)
    posed = find_scans(scans, find)
    targets, errors = target_files(output, force), PoseErrors(offset, yaw, drift, missed_loop)
    errors.check()
    refuse_inputs(targets, [*posed.names, poses, reference, calibration])
    rule = Rule(chosen.suspicious_above, chosen.plausible_below, chosen.reach, chosen.search)
    settings = loaded.scans.merging(submaps)
    right = replace_poses(posed, reference, find).every(every).poses if reference else None
    used_seed = None if errors.is_none else resolve_seed(seed)
    if errors.is_none and right is None:
        logger.info("no poses are known to be right: every scan is registered to those near it, piece by piece, which")
        logger.info("takes a while. If these poses are right, give the same file as --reference too; without labels")
        logger.info("mapq classify takes the scans as they are.")
    with progress(1.0, "merging and comparing scans") as bar:
        built = build(posed.every(every), errors, rule, settings, right, used_seed or 0, bar)
    head = {"seed": used_seed, "errors": asdict(errors), "rule": asdict(rule), "merging": asdict(settings)}
    report = write_map(targets, built, head)
    if json:
        storage.emit_object(SCHEMA, report)
        return
    for line in _lines(report, targets[1]):
        console.summarize(line)


def _lines(report: Mapping[str, Any], beside: str) -> Iterator[str]:
    """Yield the table for a person."""
    n_points = report["n_points"]
    yield f"{'scans':<16}{len(report['scans'])}, {report['n_read']:,} points read, {n_points:,} kept"
    reach = f", within {report['reach']:.2f} m along a surface" if "reach" in report else ""
    yield f"{'labels from':<16}{report['labels_from']}{reach}"
    rule = report["rule"]
    for name, words in (
        ("suspicious", f"scans disagree by more than {rule['suspicious_above']:g} m"),
        ("plausible", f"they disagree by less than {rule['plausible_below']:g} m, or one alone saw it"),
        ("ambiguous", "between these"),
        ("not_known", "no plane, or scans that could not be compared"),
        ("seen_once", "of the plausible, those that one scan alone saw"),
    ):
        count = report[f"n_{name}"]
        yield f"{name.replace('_', ' '):<16}{count:,} points ({count / n_points:.1%}): {words}"
    yield f"{'disagreement':<16}{report['largest_disagreement']:.2f} m at most"
    if report["seed"] is not None:
        yield f"{'seed':<16}{report['seed']}"
    yield f"{'report':<16}{beside}"
    for row in report["files"]:
        yield f"{'map':<16}{row['path']}: {row['n_points']:,} points, {row['n_suspicious']:,} suspicious"
