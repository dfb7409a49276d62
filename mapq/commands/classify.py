"""Label the patches of a map plausible or suspicious, and say why."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapq.commands._options import (
    BinColumns,
    Frame,
    MaxFalseAlarms,
    Topic,
    Unit,
    beside,
    load_model,
    parse_share,
    refuse_inputs,
)
from prf.shell.options import Force, Json, Output

if TYPE_CHECKING:
    from mapq.assess import Result
    from mapq.io import ReadOptions
    from mapq.patches import Patches

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq classify city.patches -o city.classified.ply",
    "mapq classify map.pcd --model city.model.json --json",
    "mapq classify survey.laz -o survey.classified.laz",
    "mapq classify map.ply --fail-over 5%",
)

N_WORST = 10
"""Suspicious patches that the table lists."""
N_REGIONS = 5
"""Regions that it lists."""
N_REASONS = 3
"""Reasons that it names for each patch."""


def classify(
    file: Annotated[
        str,
        typer.Argument(metavar="PATCHES|CLOUD", help="What mapq segment wrote, or a cloud, which is segmented first."),
    ],
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="MODEL", help="What mapq train wrote; the model of the package if absent."),
    ] = None,
    max_false_alarms: MaxFalseAlarms = None,
    bin_columns: BinColumns = 4,
    unit: Unit = None,
    topic: Topic = None,
    frame: Frame = None,
    max_tilt: Annotated[
        float | None,
        typer.Option(
            "--max-tilt", metavar="DEG", help="For a CLOUD: drop patches farther from vertical; 90 keeps all."
        ),
    ] = None,
    up: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--up", metavar="X Y Z", help="For a CLOUD: the vertical.  [0 0 1]"),
    ] = None,
    fail_over: Annotated[
        float | None,
        typer.Option(
            "--fail-over",
            metavar="SHARE",
            parser=parse_share,
            help="Exit 1 if more of the area is suspicious: 0.05 or 5%.",
        ),
    ] = None,
    output: Output = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Label the patches of a map plausible or suspicious, and say why.

    RESULT.ply (or .las, .laz) has all points with all their fields, and patch, suspicious (0, 1, 255 = no patch),
    p_suspicious and colours: plausible blue, suspicious red. RESULT.json beside it has the regions of connected
    suspicious patches, worst first, and each patch with the reasons for its label in words, and the terms that led to
    it. Where points have a scan, a time or a pass, each has a cause too: a missed loop closure, or a local mapping
    error. Without -o they go beside the input: its stem + .classified.ply. With --fail-over a map without any patch
    fails too: nothing speaks for it.
    """
    from mapq.assess import assess
    from mapq.io import ReadOptions
    from mapq.io.models import read_default_model
    from mapq.io.results import SCHEMA, json_beside, refuse_existing_result, write_result
    from prf.shell import console, jsonout
    from prf.shell.errors import CheckFailed
    from prf.shell.files import STREAM
    from prf.shell.manifest import describe_process

    target = output or (beside(file, ".classified.ply") if file != STREAM else "map.classified.ply")
    refuse_existing_result(target, force)
    refuse_inputs([json_beside(target)], [file, *([model] if model else [])])
    used = load_model(model, max_false_alarms)
    patches = _patches(file, ReadOptions(bin_columns, unit, topic, frame), max_tilt, up)
    result = assess(patches, used or read_default_model())
    warnings = patches.report.get("warnings", ())
    for warning in warnings:
        logger.warning("%s: %s", file, warning)
    if not len(patches) and not warnings:
        logger.warning("%s: no plane patch was found, so nothing is labelled", file)
    head = {**describe_process([file, *([model] if model else [])]), "model": model or "default", **result.head()}
    head["verdict"] = result.verdict(fail_over)
    rows = list(result.patch_rows())
    write_result(target, result.cloud(), head, rows)
    if json:
        jsonout.emit_object(SCHEMA, {"output": target, **head, "patches": rows})
    else:
        for line in _lines(result, target):
            console.emit(line)
    if head["verdict"]["passed"] is not False:
        return
    if not len(patches):
        raise CheckFailed(f"{file}: there is no patch to be judged by, so nothing speaks for this map.")
    share = head["verdict"]["share_of_area"]
    raise CheckFailed(f"{file}: {share:.1%} of the area of patches is suspicious, more than {fail_over:.1%}.")


def _patches(file: str, options: ReadOptions, max_tilt: float | None, up: tuple[float, float, float] | None) -> Patches:
    """Return the patches of the file, segmented now if it is a cloud."""
    from mapq.assess import read_input
    from mapq.patches import Patches
    from mapq.segment import STAGES, SegmentSettings, segment
    from prf.shell.errors import UsageError
    from prf.shell.progress import progress

    chosen: dict[str, Any] = {name: value for name, value in (("max_tilt", max_tilt), ("up", up)) if value is not None}
    found = read_input(file, options)
    if isinstance(found, Patches):
        if chosen:
            raise UsageError(f"{file} is segmented already: --max-tilt and --up are for clouds.")
        return found
    with progress(len(STAGES), "segmenting") as reporter:
        return segment(found, SegmentSettings(**chosen), reporter)


def _lines(result: Result, target: str) -> Iterator[str]:
    """Return the table for a person."""
    counts = result.counts()
    yield f"patches         {counts['n_suspicious']} of {counts['n_patches']} suspicious{_percent(counts, 'patches')}"
    yield f"area            {counts['area_suspicious_m2']:.1f} of {counts['area_m2']:.1f} m2{_percent(counts, 'area')}"
    yield (
        f"points          {counts['n_points_suspicious']:,} of {counts['n_points_in_patches']:,} in patches"
        f"{_percent(counts, 'points')}; {counts['n_points']:,} in all"
    )
    if result.scans_apart == result.scans_apart:
        yield f"scans apart     {result.scans_apart:.3f} m, of patches that several saw in one visit, in the median"
    yield from _cause_line(result)
    yield from _region_lines(result)
    worst = result.worst(N_WORST)
    if worst:
        yield "most surely suspicious, with what speaks for it (log-odds):"
    for patch in worst:
        x, y, z = result.world_centroid(patch)
        p = result.labelling.probability[patch]
        yield f"  patch {patch:<6} p {p:.3f}  {result.area[patch]:.1f} m2 at {x:.1f} {y:.1f} {z:.1f}"
        for reason in result.reasons(patch, N_REASONS):
            yield f"      {reason.log_odds:+.2f}  {reason.text}"
        if result.visits is not None:
            yield f"      cause  {result.causes[patch].kind}: {result.causes[patch].text}"
    yield f"result          {target} and .json"


def _cause_line(result: Result) -> Iterator[str]:
    """Return how much of the suspicious area has which cause, where the map tells when it was seen."""
    area = result.area_by_cause()
    whole = sum(area.values())
    if result.visits is not None and whole:
        named = ", ".join(f"{name} {value / whole:.0%}" for name, value in area.items() if value)
        yield f"causes          {named} of the suspicious area"


def _region_lines(result: Result) -> Iterator[str]:
    """Return the regions for a person."""
    regions = result.regions
    unit = result.patches.cloud.unit
    if regions:
        shown = "" if len(regions) <= N_REGIONS else f", the worst {N_REGIONS}"
        yield f"regions         {len(regions)} of connected suspicious patches{shown}:"
    for number, region in enumerate(regions[:N_REGIONS]):
        x, y, z = region.centre.tolist()
        size = " x ".join(f"{length:.1f}" for length in ((region.high - region.low) * unit).tolist())
        apart = "" if region.displacement != region.displacement else f", surfaces {region.displacement:.2f} m apart"
        n_patches = f"{len(region.patches)} patch{'' if len(region.patches) == 1 else 'es'}"
        cause = "" if result.visits is None else f", {next(iter(result.area_by_cause(region.patches)))}"
        where = f"{region.area:.1f} m2 in {size} m at {x:.1f} {y:.1f} {z:.1f}"
        yield f"  region {number:<5} {n_patches}, {where}{apart}{cause.replace('unknown', 'cause unknown')}"


def _percent(counts: dict[str, Any], of: str) -> str:
    share = counts[f"share_of_{of}"]
    return "" if share != share else f" ({share:.1%})"
