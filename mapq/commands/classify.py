"""Label the patches of a map plausible or suspicious, and say why."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapq.commands._options import (
    BinColumns,
    Config,
    Frame,
    MaxFalseAlarms,
    Scheduler,
    TilePoints,
    Topic,
    Unit,
    Workers,
    beside,
    load_model,
    parse_share,
    tiling,
)
from prf.shell.options import Assignments, Force, Json, Output, Presets

if TYPE_CHECKING:
    from mapq.assess import Result
    from mapq.configuration import Configuration
    from mapq.io import ReadOptions
    from prf.shell.settings import Loaded

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq classify map.pcd --model city.model.json --json",
    "mapq classify survey.laz --preset survey-scanner -o survey.classified.laz",
    "mapq classify city.patches --fail-over 5%",
    "mapq classify city/ -o city.classified/ --workers 8",
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
        typer.Argument(
            metavar="PATCHES|CLOUD",
            help="What mapq segment wrote, or a cloud or folder of LAZ tiles, which is segmented first.",
        ),
    ],
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="MODEL", help="What mapq train wrote.  [that of the package]"),
    ] = None,
    max_false_alarms: MaxFalseAlarms = None,
    config: Config = None,
    preset: Presets = None,
    assignments: Assignments = None,
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
    min_coverage: Annotated[
        float | None,
        typer.Option(
            "--min-coverage",
            metavar="SHARE",
            parser=parse_share,
            help="With --fail-over, exit 1 too if fewer of the points on planes of any tilt are in judged patches.  "
            "[20%]",
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    tile_points: TilePoints = None,
    output: Output = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Label the patches of a map plausible or suspicious, and say why.

    RESULT.ply (or .las, .laz) has all points with all their fields, and patch, suspicious (0, 1, 255 = no patch),
    p_suspicious and colours: plausible blue, suspicious red. RESULT.json beside it has the regions of connected
    suspicious patches, worst first, and each patch with the reasons for its label in words, and the terms that led to
    it. Where points have a scan, a time or a pass, each has a cause too: a missed loop closure, or a local mapping
    error. Without -o they go beside the input: its stem + .classified.ply. With --fail-over a map fails too of which
    too little could be judged (--min-coverage), or nothing: nothing speaks for it.

    A folder of LAS or LAZ tiles, or any cloud with one of --workers, --scheduler and --tile-points, is worked on tile
    by tile and need not fit into memory. Of a folder the result is a folder: tiles of the same names, and result.json.
    """
    asked = locals()

    from mapq.api import classify as label
    from mapq.assess import MIN_COVERAGE
    from mapq.configuration import load_configuration, sources_of
    from mapq.io import ReadOptions
    from mapq.io.results import claim_result, json_beside, result_lines
    from prf.shell import jsonout
    from prf.shell.files import STREAM, refuse_inputs

    options = ReadOptions(bin_columns, unit, topic, frame)
    chosen = load_configuration(asked, "segment", "crf")
    max_false_alarms = chosen.settings.crf.max_false_alarms
    given = {"workers": workers, "scheduler": scheduler, "tile_points": tile_points}
    limits = fail_over, MIN_COVERAGE if min_coverage is None else min_coverage
    if _in_tiles(file, given):
        _classify_tiles(file, output, (model, max_false_alarms), (options, chosen, given), limits, json, force)
        return
    target = output or (beside(file, ".classified.ply") if file != STREAM else "map.classified.ply")
    claim_result(target, force)
    refuse_inputs([target, json_beside(target)], [file, model, config])
    result = label(
        file,
        model,
        max_false_alarms=max_false_alarms,
        segmentation=chosen.settings.segment.settings(),
        sources=sources_of(chosen, "segment"),
        options=options,
    )
    result.save(target, fail_over=limits[0], min_coverage=limits[1], force=True)
    if json:
        jsonout.emit_pieces(result_lines({"output": target, **result.head(*limits)}, result.patch_rows()))
    else:
        _show(result, target)
    _judge(file, result, limits)


def _in_tiles(file: str, given: dict[str, Any]) -> bool:
    """Return whether a map is worked on tile by tile: it is asked for, or the map is a folder of tiles."""
    if any(value is not None for value in given.values()):
        return True
    if not os.path.isdir(file):
        return False
    from mapq.tiled.source import is_tiled

    return is_tiled(file)


def _classify_tiles(
    file: str,
    output: str | None,
    model: tuple[str | None, float | None],
    how: tuple[ReadOptions, Loaded[Configuration], dict[str, Any]],
    limits: tuple[float | None, float],
    json: bool,
    force: bool,
) -> None:
    """Classify a map tile by tile; as :func:`classify`, but for what needs all points at once."""
    from mapq.assess import Origin
    from mapq.configuration import sources_of
    from mapq.io import is_patches
    from mapq.io.results import result_lines
    from mapq.tiled.run import classify_map
    from prf.shell import jsonout
    from prf.shell.errors import UsageError
    from prf.shell.files import refuse_inputs

    target = output or _default_target(file)
    if is_patches(file):
        raise UsageError(f"{file} is segmented already: tiles are for clouds. Leave --workers and the like out.")
    options, chosen, given = how
    inputs = [name for name in (file, model[0]) if name and os.path.isfile(name)]
    refuse_inputs([target, os.path.splitext(target)[0] + ".json"], inputs)
    origin = Origin(file, model[0] or "default", tuple(inputs))
    settings = tiling(given, chosen.settings.segment.settings(), options)
    sources = sources_of(chosen, "segment")
    result = classify_map(file, target, load_model(*model), settings, force, origin, limits, sources=sources)
    for warning in result.patches.report["warnings"]:
        logger.warning("%s: %s", file, warning)
    if json:
        jsonout.emit_pieces(result_lines({"output": target, **result.head(*limits)}, result.patch_rows()))
    else:
        _show(result, target)
    _judge(file, result, limits)


def _default_target(file: str) -> str:
    """Return where the result of a map in tiles goes: beside it, a cloud for a cloud and a folder for a folder."""
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    if file == STREAM:
        raise UsageError("a map in tiles is read more than once. Name a file or a folder, not standard input.")
    if os.path.isdir(file):
        return file.rstrip("/" + os.sep) + ".classified"
    return beside(file, ".classified.ply")


def _show(result: Result, target: str) -> None:
    from prf.shell import console

    for line in _lines(result, target):
        console.summarize(line)


def _judge(file: str, result: Result, limits: tuple[float | None, float]) -> None:
    """Raise CheckFailed if a map does not pass."""
    from prf.shell.errors import CheckFailed

    verdict = result.verdict(*limits)
    if verdict["passed"] is not False:
        return
    if not len(result.patches):
        raise CheckFailed(f"{file}: there is no patch to be judged by, so nothing speaks for this map.")
    share, fail_over = verdict["share_of_area"], verdict["fail_over"]
    if share > fail_over:
        raise CheckFailed(f"{file}: {share:.1%} of the area of patches is suspicious, more than {fail_over:.1%}.")
    raise CheckFailed(
        f"{file}: {verdict['coverage']:.1%} of the points on planes could be judged, less than {limits[1]:.1%}: too "
        "little speaks for this map. Judge more by --max-tilt, or allow it by --min-coverage."
    )


def _lines(result: Result, target: str) -> Iterator[str]:
    """Return the table for a person."""
    counts = result.counts
    yield f"judged          {_judged(counts['coverage'])}"
    yield f"patches         {counts['n_suspicious']} of {counts['n_patches']} suspicious{_percent(counts, 'patches')}"
    yield f"area            {counts['area_suspicious_m2']:.1f} of {counts['area_m2']:.1f} m2{_percent(counts, 'area')}"
    yield (
        f"points          {counts['n_points_suspicious']:,} of {counts['n_points_in_patches']:,} in patches"
        f"{_percent(counts, 'points')}; {counts['n_points']:,} in all"
    )
    if result.scans_apart == result.scans_apart:
        apart = f"{result.scans_apart:.3f} m in the median, {result.disagreement:.3f} m in the mean"
        yield f"scans apart     {apart}, over the area that several saw"
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


def _judged(coverage: float) -> str:
    """Return what share of the surface could be judged."""
    if coverage != coverage:
        return "an unknown share of the surface: these patches do not say what else was flat"
    return f"{coverage:.1%} of the surface: of the points on planes of any tilt"


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
