"""Cut a cloud into plane patches by region growing."""

from __future__ import annotations

import dataclasses
import logging
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.commands._options import (
    BinColumns,
    Config,
    Frame,
    MaxTilt,
    Topic,
    Unit,
    Workers,
    beside,
    is_verbose,
)
from prf.shell.options import Assignments, Force, Json, Output, Presets

if TYPE_CHECKING:
    from mapq.configuration import Configuration
    from mapq.io import ReadOptions
    from mapq.patches import Patches
    from mapq.segmentation import SegmentationScore
    from prf.shell.settings import Loaded

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq segment map.ply",
    "mapq segment map.pcd -o walls.patches --max-tilt 15 --json",
    "mapq segment city.ply --max-tilt 90 --truth-field plane",
    "mapq segment survey.laz --preset survey-scanner --set segment.min_points=100 --workers 4",
)
LENGTHS = ("resolution", "noise", "max_distance", "max_gap", "min_extent")
MIN_IOU = 0.75
"""Overlap with a true plane from which a patch is its match."""


def segment(
    cloud: Annotated[
        str,
        typer.Argument(metavar="CLOUD", help="PLY, PCD, LAS/LAZ, E57, PTX, XYZ, CSV, .npy, .npz, .3d, .bin, ROS bag."),
    ],
    output: Output = None,
    config: Config = None,
    preset: Presets = None,
    assignments: Assignments = None,
    max_tilt: MaxTilt = None,
    truth_field: Annotated[
        str | None,
        typer.Option("--truth-field", metavar="NAME", help="Score against this point field: planes, negative none."),
    ] = None,
    bin_columns: BinColumns = 4,
    unit: Unit = None,
    topic: Topic = None,
    frame: Frame = None,
    workers: Workers = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Cut a cloud into plane patches by region growing.

    Lengths and angles that are not given are estimated from the spacing and the noise of the points, and printed. The
    patches do not depend on the order of the points. Default output: the stem of CLOUD + .patches. With --workers tiles
    of the cloud are cut side by side; PATCHES have all points, and so has memory. Maps that do not fit are input of
    mapq classify itself.
    """
    from mapq.configuration import load_configuration, sources_of
    from mapq.features import measure_shapes
    from mapq.io import ReadOptions
    from mapq.io.patches import write_patches
    from mapq.segmentation import score_segmentation, truth_of
    from prf.shell.files import refuse_inputs
    from prf.shell.lock import claim_output
    from prf.shell.output_names import refuse_other_format
    from prf.shell.streams import refuse_json_beside

    target = output or _default_target(cloud)
    refuse_json_beside(target, json)
    claim_output(target, force)
    refuse_other_format(target, (".npz",), "patches are written as a .patches file. Name one; mapq render draws it.")
    refuse_inputs([target], [cloud, config])
    given = {"config": config, "preset": preset, "assignments": assignments, "max_tilt": max_tilt}
    chosen = load_configuration(given, "segment")
    options = ReadOptions(bin_columns, unit, topic, frame)
    patches = _patches(cloud, target, chosen, options, workers, truth_field)
    score = None
    if truth_field:
        score = score_segmentation(patches.patch, truth_of(patches.cloud, truth_field), MIN_IOU)
    measured = {**patches.report, "area": float(measure_shapes(patches).area.sum())}
    patches = dataclasses.replace(patches, report=measured)
    write_patches(target, dataclasses.replace(patches, report={**measured, "sources": sources_of(chosen, "segment")}))
    _show(cloud, target, patches, score, json)


def _default_target(cloud: str) -> str:
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    if cloud == STREAM:
        raise UsageError("a cloud from standard input has no name to put .patches to. Name the output with -o.")
    return beside(cloud, ".patches")


def _patches(
    cloud: str,
    target: str,
    chosen: Loaded[Configuration],
    options: ReadOptions,
    workers: int | None,
    truth_field: str | None,
) -> Patches:
    """Return the patches of a cloud, cut as a whole, or in tiles by several workers."""
    from mapq.api import read_cloud
    from mapq.api import segment as cut
    from mapq.segmentation import truth_of
    from mapq.tiled.run import TileSettings, segment_map
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    settings = chosen.settings.segment.settings()
    if workers is None:
        read = read_cloud(cloud, options)
        if truth_field:
            truth_of(read, truth_field)
        return cut(read, settings)
    if STREAM in (cloud, target) or os.path.isdir(cloud):
        raise UsageError("tiles need files: name a CLOUD and an output. A folder of tiles is for mapq classify.")
    patches = segment_map(cloud, target, TileSettings(segment=settings, options=options, n_workers=workers))
    for warning in patches.report["warnings"]:
        logger.warning(warning)
    return patches


def _show(cloud: str, target: str, patches: Patches, score: SegmentationScore | None, json: bool) -> None:
    from prf.shell import jsonout
    from prf.shell.streams import say_beside

    if json:
        head = {"cloud": cloud, "output": target, "parameters": patches.parameters, "report": patches.report}
        scored = {} if score is None else {"score": score._asdict()}
        jsonout.emit_object("mapq.segment/1", {**head, "n_points": patches.counts, **scored})
        return
    # Standard output belongs to the patches if they are written there.
    say = say_beside(target)
    for line in (*_lines(cloud, target, patches), *_score_lines(score)):
        say(line)


def _lines(cloud: str, target: str, patches: Patches) -> Iterator[str]:
    """Yield the table for a person; -v adds the other parameters."""
    report, used = patches.report, patches.parameters
    looked = "all" if report["points_looked_at"] == report["points"] else report["points_looked_at"]
    points = f"{report['points']}, {report['points_not_finite']} not finite, {report['points_repeated']} repeated"
    yield f"{'cloud':<16}{cloud}"
    yield f"{'points':<16}{points}, {looked} looked at first"
    yield f"{'spacing':<16}{used['spacing']:.3g} m"
    for name in LENGTHS if is_verbose() else ("noise", "max_distance"):
        yield f"{name.replace('_', ' '):<16}{used[name]:.3g} m"
    if is_verbose():
        yield f"{'max angle':<16}{used['max_angle']:.3g} degrees"
        yield f"{'max variation':<16}{used['max_variation']:.3g}"
        yield f"{'neighbours':<16}{used['neighbours']}"
        yield f"{'min points':<16}{used['min_points']}"
    yield f"{'max tilt':<16}{used['max_tilt']:g} degrees from vertical, up {used['up']}"
    for name, why in (("dropped_for_tilt", "too far from vertical"), ("dropped_as_small", "too small")):
        dropped = report[name]
        yield f"{'dropped':<16}{dropped['patches']} {why}: {dropped['points']} points, {dropped['area']:.1f} m2"
    yield f"{'largest':<16}{', '.join(str(n) for n in patches.counts[:8].tolist()) or 'none'}"
    yield f"{'patches':<16}{report['patches']} of {report['points_in_patches']} points, {report['area']:.1f} m2"
    yield f"{'output':<16}{target}"


def _score_lines(score: SegmentationScore | None) -> Iterator[str]:
    if score is None:
        return
    yield f"{'true planes':<16}{score.n_planes}, {score.n_matched} matched"
    for name in ("precision", "recall", "mean_iou", "mean_dice"):
        yield f"{name.replace('_', ' '):<16}{getattr(score, name):.3f}"
    for name in ("over_segmented", "under_segmented", "missed", "noise"):
        yield f"{name.replace('_', ' '):<16}{getattr(score, name)}"
