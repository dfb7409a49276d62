"""Cut a cloud into plane patches by region growing."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.commands._options import are_scans, default_name, read_scans
from mapq.configuration import Configuration, sources_of
from prf.shell.cli.console import is_verbose
from prf.shell.cli.options import Force, Json, Output, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from mapq.patches import Patches

EXAMPLES = (
    "mapq segment map.ply",
    "mapq segment map.pcd -o walls.patches --surfaces upright --json",
    "mapq segment scans --poses trajectory.tum",
    "mapq segment survey.laz --preset survey-scanner --set segment.min_points=100",
)
LENGTHS = ("resolution", "noise", "max_distance", "max_gap", "min_extent")


@with_settings(Configuration, "cloud", "scans", "segment")
def segment(
    clouds: Annotated[
        list[str],
        typer.Argument(
            metavar="CLOUD|SCANS...",
            help="PLY, PCD, LAS/LAZ, E57, PTX, XYZ, CSV, .npy, .npz, .3d, .bin, ROS bag; or a folder or files of scans "
            "with poses.",
        ),
    ],
    *,
    settings: Loaded[Configuration],
    output: Output = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Cut a cloud into plane patches by region growing.

    Lengths and angles that are not given are estimated from the spacing and the noise of the points, and printed. The
    patches do not depend on the order of the points. Scans are merged where their poses put them. Default output: the
    stem of CLOUD, or the folder of the scans, + .patches. Maps that do not fit into memory are input of mapq classify
    itself.
    """
    from mapq.api import read_cloud
    from mapq.api import segment as cut
    from mapq.features import measure_shapes
    from mapq.io.patches import write_patches
    from prf.shell.cli import storage
    from prf.shell.cli.console import say_beside
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim_output
    from prf.shell.errors import UsageError

    chosen = settings.settings
    if output is None and STREAM in clouds:
        raise UsageError("a cloud from standard input has no name to put .patches to. Name the output with -o.")
    target = output or default_name(clouds, ".patches")
    claim_output(
        target, force, inputs=[*clouds, chosen.scans.poses, settings.file], suffixes=(".patches", ".npz"), json=json
    )
    cloud = read_scans(clouds, chosen) if are_scans(clouds, settings) else read_cloud(clouds[0], chosen.cloud)
    patches = cut(cloud, chosen.segment)
    report = {**patches.report, "area": float(measure_shapes(patches).area.sum())}
    patches = dataclasses.replace(patches, report={**report, "sources": sources_of(settings, "segment")})
    write_patches(target, patches)
    if json:
        content = {"cloud": " ".join(clouds), "output": target, "parameters": patches.parameters, "report": report}
        storage.emit_object("mapq.segment/1", {**content, "n_points": patches.counts})
        return
    # Standard output belongs to the patches if they are written there.
    say = say_beside(target)
    for name, value in _rows(cloud.source, target, patches):
        say(f"{name:<16}{value}")


def _rows(cloud: str, target: str, patches: Patches) -> Iterator[tuple[str, object]]:
    """Yield the table for a person; -v adds the other parameters."""
    report, used = patches.report, patches.parameters
    looked = "all" if report["points_looked_at"] == report["points"] else report["points_looked_at"]
    points = f"{report['points']}, {report['points_not_finite']} not finite, {report['points_repeated']} repeated"
    yield "cloud", cloud
    yield "points", f"{points}, {looked} looked at first"
    yield "spacing", f"{used['spacing']:.3g} m"
    for name in LENGTHS if is_verbose() else ("noise", "max_distance"):
        yield name.replace("_", " "), f"{used[name]:.3g} m"
    if is_verbose():
        yield "max angle", f"{used['max_angle']:.3g} degrees"
        for name in ("max_variation", "neighbours", "min_points"):
            yield name.replace("_", " "), f"{used[name]:.3g}"
    yield "surfaces", f"{', '.join(used['surfaces'])}; up {used['up']}"
    for why, dropped in (*report["not_judged"].items(), ("too small", report["dropped_as_small"])):
        yield "dropped", f"{dropped['patches']} {why}: {dropped['points']} points, {dropped['area']:.1f} m2"
    yield "largest", ", ".join(str(n) for n in patches.counts[:8].tolist()) or "none"
    yield "patches", f"{report['patches']} of {report['points_in_patches']} points, {report['area']:.1f} m2"
    yield "output", target
