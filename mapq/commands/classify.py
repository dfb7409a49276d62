"""Label the patches of a map plausible or suspicious, with reasons."""

from __future__ import annotations

import dataclasses
import logging
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapq.commands._options import ModelFile, are_scans, cloud_options, default_name, load_model
from mapq.commands._summary import summary_lines
from mapq.configuration import Configuration, TileSettings, parse_share, sources_of, typed_keys
from prf.shell.cli.options import Force, Json, Output, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from mapq.configuration import Configuration
    from mapq.results.result import Result

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq classify scans --poses trajectory.tum",
    "mapq classify survey.laz --preset survey-scanner -o survey.classified.laz",
    "mapq classify scans --poses slam.g2o --tolerance 0.1 --fail-over 5% --fail-apart 0.05",
    "mapq classify city/ -o city.classified/ --workers 8",
)

FailOver = Annotated[
    float | None,
    typer.Option(
        "--fail-over",
        metavar="SHARE",
        parser=parse_share,
        help="Exit 1 if more of the area is suspicious: 0.05 or 5%.",
    ),
]
FailApart = Annotated[
    float | None,
    typer.Option(
        "--fail-apart",
        metavar="METRES",
        help="Exit 1 if scans disagree by more in the median, of walls or of floors, or are not known.",
    ),
]
MinCoverage = Annotated[
    float | None,
    typer.Option(
        "--min-coverage",
        metavar="SHARE",
        parser=parse_share,
        help="With either, exit 1 too if fewer of the points on planes of any kind are in judged patches.  [20%]",
    ),
]
GraphOut = Annotated[
    str | None,
    typer.Option(
        "--graph-out",
        metavar="FILE",
        help="Of scans with --poses in g2o: write that graph without the edges that are probably wrong.",
    ),
]


@with_settings(Configuration, "cloud", "scans", "segment", "crf.tolerance", "crf.max_false_alarms", "tiles")
def classify(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="PATCHES|CLOUD|SCANS...",
            help="PATCHES; or a cloud, a folder of LAZ tiles, or a folder or files of scans with poses: these are "
            "segmented first.",
        ),
    ],
    *,
    settings: Loaded[Configuration],
    model: ModelFile = None,
    fail_over: FailOver = None,
    fail_apart: FailApart = None,
    min_coverage: MinCoverage = None,
    graph_out: GraphOut = None,
    output: Output = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Label the patches of a map plausible or suspicious, with reasons.

    Suspicious is what scans, or copies of a surface, put farther apart than the tolerance. RESULT (PLY, LAS, LAZ, PCD,
    XYZ or CSV, by its suffix) has all points with all their fields, and patch, suspicious (0, 1, 255 = no patch),
    p_suspicious and colours: plausible blue, suspicious red. RESULT.json beside it has the regions of connected
    suspicious patches, worst first, and each patch with reasons in words and the terms behind them. Where points have a
    scan, a time or a pass, each suspicious patch has a cause too: a missed loop closure, or a local mapping error; of
    scans with poses a wrong edge or scan, drift, or a missed loop closure. The default output is beside the input,
    my.classified.laz of my.laz; of PATCHES, scans and formats that are not written, such as E57, it is a PLY.

    Scans are merged where their poses put them, and the result knows which scan saw what and from where, by which far
    more errors are found. It names scans that the others want elsewhere, and of poses in g2o the edges that are wrong.
    E57, PTX, bags, and PCD with VIEWPOINT have poses of their own; an E57 of several scans is checked scan by scan.

    A folder of LAS or LAZ tiles, or any cloud with one of --workers, --scheduler and --tile-points, is worked on tile
    by tile and need not fit into memory. The result of a folder is a folder: tiles of the same names, and result.json.
    """
    from mapq.io.results import result_lines
    from mapq.io.tiles import is_tiled
    from mapq.results.verdict import MIN_COVERAGE
    from prf.shell.cli import console, storage

    least = MIN_COVERAGE if min_coverage is None else min_coverage
    limits = {"fail_over": fail_over, "min_coverage": least, "fail_apart": fail_apart}
    file, as_scans = inputs[0], are_scans(inputs, settings)
    in_tiles = _are_tiles_wanted(file, as_scans, settings)
    _refuse_mixed(as_scans, in_tiles, graph_out)
    if in_tiles or (is_tiled(file) and not as_scans):
        target = output or _tiled_target(file)
        result = _classify_tiles(file, target, model, settings, limits, force)
    else:
        target = output or _target(inputs)
        result = _classify(inputs, as_scans, model, target, settings, force, graph_out)
        result.save(target, force=True, **limits)
    if json:
        storage.emit_pieces(result_lines({"output": target, **result.head(**limits)}, result.patch_rows()))
    else:
        for line in summary_lines(result, target, limits):
            console.summarize(line)
    _check(file, result, limits)


def _are_tiles_wanted(file: str, as_scans: bool, settings: Loaded[Configuration]) -> bool:
    """Return whether a map shall be worked on in tiles; a file of settings may be for others, or hold the defaults."""
    from mapq.io import is_patches
    from prf.shell.cli.files import STREAM

    if typed_keys(settings, "tiles") or as_scans or settings.settings.tiles == TileSettings():
        return bool(typed_keys(settings, "tiles"))
    return file == STREAM or not is_patches(file)


def _refuse_mixed(as_scans: bool, in_tiles: bool, graph_out: str | None) -> None:
    """Refuse tiles of scans, and a graph of anything else."""
    from prf.shell.errors import UsageError

    if in_tiles and as_scans:
        raise UsageError("scans are merged in memory, not in tiles. Leave --workers and the like out; see --every.")
    if graph_out is not None and not as_scans:
        raise UsageError("--graph-out is for scans whose poses are a g2o file. Leave it out.")


def _classify(
    inputs: list[str],
    as_scans: bool,
    model: str | None,
    target: str,
    settings: Loaded[Configuration],
    force: bool,
    graph_out: str | None,
) -> Result:
    """Classify a map in memory, or scans."""
    from mapq.api import classify as label
    from mapq.api import classify_scans
    from mapq.io import is_patches
    from mapq.io.maps import read_input
    from mapq.io.results import claim_result, json_beside
    from mapq.patches import Patches
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim_output, refuse_inputs

    file, chosen = inputs[0], settings.settings
    if not as_scans and file != STREAM and is_patches(file):
        _refuse_for_patches(file, settings)
    read = [name for name in (*inputs, chosen.scans.poses, model) if name is not None]
    claim_result(target, force)
    refuse_inputs([target, json_beside(target)], [*read, settings.file])
    if graph_out is not None:
        claim_output(graph_out, force, inputs=[*read, settings.file])
    crf, scans, is_cut = chosen.crf, chosen.scans, False
    how: dict[str, Any] = {"tolerance": crf.tolerance, "max_false_alarms": crf.max_false_alarms}
    if as_scans:
        posed: dict[str, Any] = {"every": scans.every, "find": scans, "merging": scans, "options": chosen.cloud}
        posed |= {"segmentation": chosen.segment, "graph_out": graph_out, "force": force}
        result = classify_scans(inputs, None, model, **how, **posed)
    else:
        found = read_input(file, cloud_options(file, settings))
        is_cut = isinstance(found, Patches)
        result = label(found, model, **how, segmentation=None if is_cut else chosen.segment)
    if not is_cut:
        report = {**result.patches.report, "sources": sources_of(settings, "segment")}
        result = dataclasses.replace(result, patches=dataclasses.replace(result.patches, report=report))
    name = result.origin.name if as_scans else file
    return dataclasses.replace(result, origin=result.origin._replace(name=name, files=tuple(read)))


def _refuse_for_patches(file: str, settings: Loaded[Configuration]) -> None:
    """Refuse what the command line asks of a cloud, for PATCHES; what a file of settings has is for other maps."""
    from prf.shell.errors import UsageError

    for table, what in (
        ("segment", "settings of a segmentation are for clouds"),
        ("cloud", "it holds its unit and more"),
    ):
        typed = typed_keys(settings, table)
        if typed:
            raise UsageError(
                f"{file} is segmented already: {what}. Leave out {settings.sources[f'{table}.{typed[0]}']}."
            )


def _classify_tiles(
    file: str,
    target: str,
    model: str | None,
    settings: Loaded[Configuration],
    limits: Mapping[str, Any],
    force: bool,
) -> Result:
    """Classify a map tile by tile, and write the result."""
    from mapq.io import is_patches
    from mapq.io.results import json_beside
    from mapq.io.tiles import RESULT_JSON, is_tiled
    from mapq.posed.files import pose_names
    from mapq.results.result import Origin
    from mapq.tiled.output import CLOUD_SUFFIXES
    from mapq.tiled.run import classify_map
    from prf.shell.cli.outputs import refuse_inputs
    from prf.shell.errors import UsageError

    if is_patches(file):
        raise UsageError(f"{file} is segmented already: tiles are for clouds. Leave --workers and the like out.")
    inputs = [name for name in (file, model) if name and os.path.isfile(name)]
    is_folder = is_tiled(file) and not target.lower().endswith(CLOUD_SUFFIXES)
    refuse_inputs([os.path.join(target, RESULT_JSON)] if is_folder else [target, json_beside(target)], inputs)
    posed = pose_names(file) if is_folder else []
    if posed:
        logger.warning("%s: taken for tiles of one map. If these are scans: --poses %s", file, posed[0])
    used = load_model(model, settings.settings.crf.max_false_alarms)
    origin, sources = Origin(file, model or "default", tuple(inputs)), sources_of(settings, "segment")
    result = classify_map(file, target, used, settings.settings, force, origin, limits, sources)
    for warning in result.patches.report["warnings"]:
        logger.warning("%s: %s", file, warning)
    return result


def _tiled_target(file: str) -> str:
    """Return the default output of a map in tiles: a cloud for a cloud and a folder for a folder."""
    from prf.shell.cli.files import STREAM
    from prf.shell.errors import UsageError

    if file == STREAM:
        raise UsageError("a map in tiles is read more than once. Name a file or a folder, not standard input.")
    return default_name([file], ".classified") if os.path.isdir(file) else _target([file])


def _target(inputs: list[str]) -> str:
    """Return the default output of one map: of a file in its format where that is written, else a PLY."""
    from mapq.io.write import written_suffix
    from prf.shell.cli.files import STREAM

    if inputs[0] == STREAM:
        return "map.classified.ply"
    is_file = len(inputs) == 1 and not os.path.isdir(inputs[0])
    return default_name(inputs, ".classified" + (written_suffix(inputs[0]) if is_file else ".ply"))


def _check(file: str, result: Result, limits: Mapping[str, Any]) -> None:
    """Raise CheckFailed if a map does not pass."""
    from prf.shell.errors import CheckFailed

    verdict = result.verdict(**limits)
    if verdict["passed"] is not False:
        return
    if not len(result.patches):
        raise CheckFailed(f"{file}: no patch to judge, so the map does not pass.")
    share, fail_over = verdict["share_of_area"], verdict["fail_over"]
    if fail_over is not None and share > fail_over:
        raise CheckFailed(f"{file}: {share:.1%} of the area of patches is suspicious, more than {fail_over:.1%}.")
    apart, fail_apart = verdict["scans_apart_m"], verdict["fail_apart"]
    if fail_apart is not None and apart != apart:
        if len(result.poses.scans) > 1:
            raise CheckFailed(f"{file}: no two scans see the same surface, so how far they disagree is not known.")
        raise CheckFailed(f"{file}: scans are not known, so nor is how far they disagree. Classify SCANS with --poses.")
    if fail_apart is not None and apart > fail_apart:
        words = f"scans disagree by {apart:.3f} m in the median of {verdict['scans_apart_surface']} surfaces"
        raise CheckFailed(f"{file}: {words}, more than {fail_apart:g} m.")
    raise CheckFailed(
        f"{file}: only {verdict['coverage']:.1%} of the points on planes could be judged, less than "
        f"{verdict['min_coverage']:.1%}. Judge more by --surfaces, or lower --min-coverage."
    )
