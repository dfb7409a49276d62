"""Cut a cloud into plane patches by region growing."""

from __future__ import annotations

import dataclasses
import logging
import os
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mapq.commands._options import (
    BinColumns,
    Config,
    Frame,
    Scheduler,
    TilePoints,
    Topic,
    Unit,
    Workers,
    beside,
    tiling,
)
from prf.shell.options import Assignments, Force, Json, Output, Presets

if TYPE_CHECKING:
    from mapq.io import ReadOptions
    from mapq.patches import Patches
    from mapq.segmentation import SegmentationScore, SegmentSettings

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq segment map.ply",
    "mapq segment map.pcd -o walls.patches --max-tilt 15 --json",
    "mapq segment city.ply --max-tilt 90 --truth-field plane",
    "mapq segment survey.laz --preset survey-scanner --workers 4",
)
LENGTHS = ("resolution", "spacing", "noise", "max_distance", "max_gap", "min_extent")


def segment(
    cloud: Annotated[
        str,
        typer.Argument(metavar="CLOUD", help="PLY, PCD, LAS/LAZ, E57, PTX, XYZ, CSV, .npy, .npz, .3d, .bin, ROS bag."),
    ],
    output: Output = None,
    config: Config = None,
    preset: Presets = None,
    assignments: Assignments = None,
    neighbours: Annotated[
        int | None, typer.Option("--neighbours", metavar="N", help="Neighbours of each point.  [16]")
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(
            "--resolution",
            metavar="METRES",
            help="Side of cells, of each of which one point is looked at first; 0: all.  [estimated]",
        ),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option("--noise", metavar="METRES", help="Standard deviation of points off their surface.  [estimated]"),
    ] = None,
    max_angle: Annotated[
        float | None,
        typer.Option("--max-angle", metavar="DEG", help="Between a point's normal and its patch's.  [estimated]"),
    ] = None,
    max_distance: Annotated[
        float | None,
        typer.Option("--max-distance", metavar="METRES", help="From a point to its patch's plane.  [estimated]"),
    ] = None,
    max_gap: Annotated[
        float | None, typer.Option("--max-gap", metavar="METRES", help="Patches end at wider gaps.  [estimated]")
    ] = None,
    max_variation: Annotated[
        float | None,
        typer.Option("--max-variation", metavar="SHARE", help="Of normals that count: 0 plane, 1/3 ball.  [estimated]"),
    ] = None,
    min_points: Annotated[
        int | None, typer.Option("--min-points", metavar="N", help="Smaller patches are dropped.  [50]")
    ] = None,
    min_extent: Annotated[
        float | None, typer.Option("--min-extent", metavar="METRES", help="Narrower patches are dropped.  [estimated]")
    ] = None,
    max_tilt: Annotated[
        float | None,
        typer.Option("--max-tilt", metavar="DEG", help="Planes farther from vertical are dropped; 90 keeps all.  [30]"),
    ] = None,
    up: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--up", metavar="X Y Z", help="The vertical, of any length.  [0 0 1]"),
    ] = None,
    truth_field: Annotated[
        str | None,
        typer.Option("--truth-field", metavar="NAME", help="Score against this point field: planes, negative none."),
    ] = None,
    min_iou: Annotated[
        float, typer.Option("--min-iou", metavar="SHARE", min=0.5, max=1.0, help="Overlap that counts as a match.")
    ] = 0.75,
    bin_columns: BinColumns = 4,
    unit: Unit = None,
    topic: Topic = None,
    frame: Frame = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    tile_points: TilePoints = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Cut a cloud into plane patches by region growing.

    Lengths and angles that are not given are estimated from the spacing and the noise of the points, and printed. The
    patches do not depend on the order of the points. Without -o they go beside CLOUD: its stem + .patches. With
    --workers tiles of the cloud are cut side by side; PATCHES themselves hold all points, as does memory. Maps that do
    not fit go straight to mapq classify.
    """
    options = locals()

    from mapq.configuration import load_configuration, sources_of
    from mapq.features import measure_shapes
    from mapq.io import ReadOptions
    from mapq.io.patches import write_patches
    from prf.shell.files import refuse_inputs
    from prf.shell.lock import claim_output
    from prf.shell.output_names import refuse_other_format

    target = output or _beside(cloud)
    claim_output(target, force)
    refuse_other_format(target, (".npz",), "patches are written as a .patches file. Name one; mapq render draws it.")
    refuse_inputs([target], [cloud, config])
    loaded = load_configuration(options, "segment")
    settings = loaded.settings.segment.settings()
    read_options = ReadOptions(bin_columns, unit, topic, frame)
    given = {"workers": workers, "scheduler": scheduler, "tile_points": tile_points}
    if any(value is not None for value in given.values()):
        patches, score = _run_tiles((cloud, target), read_options, settings, given, (truth_field, min_iou))
    else:
        patches, score = _run(cloud, read_options, settings, truth_field, min_iou)
    measured = {**patches.report, "area": float(measure_shapes(patches).area.sum())}
    patches = dataclasses.replace(patches, report=measured)
    write_patches(target, dataclasses.replace(patches, report={**measured, "sources": sources_of(loaded, "segment")}))
    _show(cloud, target, patches, score, json)


def _beside(cloud: str) -> str:
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    if cloud == STREAM:
        raise UsageError("a cloud from standard input has no name to put .patches to. Name the output with -o.")
    return beside(cloud, ".patches")


def _run(
    cloud: str, options: ReadOptions, settings: SegmentSettings, truth_field: str | None, min_iou: float
) -> tuple[Patches, SegmentationScore | None]:
    from mapq.api import read_cloud, segment
    from mapq.segmentation import score_segmentation, truth_of

    read = read_cloud(cloud, options)
    truth = truth_of(read, truth_field) if truth_field else None
    patches = segment(read, settings)
    return patches, None if truth is None else score_segmentation(patches.patch, truth, min_iou)


def _run_tiles(
    names: tuple[str, str],
    options: ReadOptions,
    settings: SegmentSettings,
    given: dict[str, Any],
    truth: tuple[str | None, float],
) -> tuple[Patches, SegmentationScore | None]:
    """Cut a cloud into patches tile by tile; `truth` is the field to score against, if any, and the overlap asked."""
    from mapq.segmentation import score_segmentation, truth_of
    from mapq.tiled.run import segment_map
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    cloud, target = names
    if STREAM in names or os.path.isdir(cloud):
        raise UsageError("tiles need files: name a CLOUD and an output. A folder of tiles goes to mapq classify.")
    patches = segment_map(cloud, target, tiling(given, settings, options))
    for warning in patches.report["warnings"]:
        logger.warning(warning)
    name, min_iou = truth
    if name is None:
        return patches, None
    return patches, score_segmentation(patches.patch, truth_of(patches.cloud, name), min_iou)


def _show(cloud: str, target: str, patches: Patches, score: SegmentationScore | None, json: bool) -> None:
    from prf.shell import jsonout
    from prf.shell.files import STREAM
    from prf.shell.streams import say_beside

    if json and target != STREAM:
        head = {"cloud": cloud, "output": target, "parameters": patches.parameters, "report": patches.report}
        scored = {} if score is None else {"score": score._asdict()}
        jsonout.emit_object("mapq.segment/1", {**head, "n_points": patches.counts, **scored})
        return
    # Standard output belongs to the patches if they go there.
    say = say_beside(target)
    for line in (*_lines(cloud, target, patches), *_score_lines(score)):
        say(line)


def _lines(cloud: str, target: str, patches: Patches) -> Iterator[str]:
    """Yield the table for a person."""
    report, used = patches.report, patches.parameters
    yield f"{'cloud':<16}{cloud}"
    yield f"{'points':<16}{report['points']}, {report['points_not_finite']} not finite, {_others(report)}"
    for name in LENGTHS:
        yield f"{name.replace('_', ' '):<16}{used[name]:.3g} m"
    yield f"{'max angle':<16}{used['max_angle']:.3g} degrees"
    yield f"{'max variation':<16}{used['max_variation']:.3g}"
    yield f"{'neighbours':<16}{used['neighbours']}"
    yield f"{'min points':<16}{used['min_points']}"
    yield f"{'max tilt':<16}{used['max_tilt']:g} degrees from vertical, up {used['up']}"
    yield f"{'patches':<16}{report['patches']} of {report['points_in_patches']} points, {report['area']:.1f} m2"
    yield f"{'largest':<16}{', '.join(str(n) for n in patches.counts[:8].tolist()) or 'none'}"
    for name, why in (("dropped_for_tilt", "too far from vertical"), ("dropped_as_small", "too small")):
        dropped = report[name]
        yield f"{'dropped':<16}{dropped['patches']} {why}: {dropped['points']} points, {dropped['area']:.1f} m2"
    yield f"{'output':<16}{target}"


def _others(report: Mapping[str, Any]) -> str:
    looked = "all" if report["points_looked_at"] == report["points"] else report["points_looked_at"]
    return f"{report['points_repeated']} repeated, {looked} looked at first"


def _score_lines(score: SegmentationScore | None) -> Iterator[str]:
    if score is None:
        return
    yield f"{'true planes':<16}{score.n_planes}, {score.n_matched} matched"
    for name in ("precision", "recall", "mean_iou", "mean_dice"):
        yield f"{name.replace('_', ' '):<16}{getattr(score, name):.3f}"
    for name in ("over_segmented", "under_segmented", "missed", "noise"):
        yield f"{name.replace('_', ' '):<16}{getattr(score, name)}"
