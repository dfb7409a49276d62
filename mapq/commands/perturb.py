"""Make a labelled map from posed scans: merged as they are, or with known errors of their poses."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer

from mapq.configuration import Configuration, MergeSettings
from prf.shell.cli.options import Force, Json, Output, Seed, with_settings
from prf.shell.cli.settings import Loaded

logger = logging.getLogger(__name__)

ERRORS = ("offset", "yaw", "drift", "missed_loop")
"""Settings of errors of poses; the others are the rule by which points are labelled."""

EXAMPLES = (
    "mapq perturb sequences/00 --drift 0.5 1 --seed 1 -o drifted.ply",
    "mapq perturb scans --poses odometry.txt --reference slam.txt -o odometry.ply",
    "mapq perturb 0.pcd 1.pcd --poses poses.txt --submaps -o map.ply",
)


@with_settings(Configuration, "perturb", "scans", "cloud")
def perturb(
    inputs: Annotated[
        list[str], typer.Argument(metavar="SCANS...", help="A folder of scans, an E57 file, or the files of the scans.")
    ],
    *,
    settings: Loaded[Configuration],
    reference: Annotated[
        str | None, typer.Option("--reference", metavar="FILE", help="The right poses, which show what is displaced.")
    ] = None,
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
    from mapq.perturb.build import SCHEMA, build, target_files, write_map
    from mapq.posed import find_scans, replace_poses
    from prf.shell.cli import console, storage
    from prf.shell.cli.console import progress
    from prf.shell.cli.outputs import refuse_inputs
    from prf.shell.cli.storage import resolve_seed

    chosen, finding = settings.settings.perturb, settings.settings.scans
    posed = find_scans(inputs, finding, settings.settings.cloud)
    targets = target_files(output, force)
    refuse_inputs(targets, [*posed.names, finding.poses, reference, finding.calibration])
    right = replace_poses(posed, reference, finding).every(finding.every).poses if reference else None
    used_seed = None if chosen.moves_nothing else resolve_seed(seed)
    if chosen.moves_nothing and right is None:
        logger.info("no poses are known to be right: every scan is registered to those near it, piece by piece, which")
        logger.info("takes a while. If these poses are right, give the same file as --reference too; without labels")
        logger.info("mapq classify takes the scans as they are.")
    with progress(1.0, "merging and comparing scans") as bar:
        built = build(posed.every(finding.every), chosen, finding, right, used_seed or 0, bar)
    head = {
        "seed": used_seed,
        "errors": chosen.model_dump(include=set(ERRORS)),
        "rule": chosen.model_dump(exclude=set(ERRORS)),
        "merging": finding.model_dump(include=set(MergeSettings.model_fields)),
    }
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
