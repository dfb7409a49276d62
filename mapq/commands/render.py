"""Draw a map in plan view and in 3D, plausible blue and suspicious red."""

from __future__ import annotations

import logging
from pathlib import PurePath
from typing import Annotated, Literal

import typer

from mapq.commands._options import cloud_options
from mapq.configuration import Configuration
from prf.shell.cli.options import Force, Output, with_settings
from prf.shell.cli.settings import Loaded

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq render city.classified.ply -o city.png",
    "mapq render city.classified.ply --colour probability --view plan -o city.pdf",
    "mapq render city.patches --colour patch --view 3d -o patches.png",
)


@with_settings(Configuration, "cloud")
def render(
    file: Annotated[
        str,
        typer.Argument(metavar="RESULT|PATCHES|CLOUD", help="What mapq classify or mapq segment wrote, or a cloud."),
    ],
    colour: Annotated[
        Literal["label", "probability", "patch", "field"] | None,
        typer.Option("--colour", help="What the colour shows.  [label where there are labels, else patch]"),
    ] = None,
    field: Annotated[
        str | None,
        typer.Option(
            "--field", metavar="NAME", help="For --colour field: a 0/1 point field, 1 is drawn as suspicious."
        ),
    ] = None,
    view: Annotated[
        Literal["both", "plan", "3d"], typer.Option("--view", help="Plan view, 3D view, or one above the other.")
    ] = "both",
    *,
    settings: Loaded[Configuration],
    output: Output = None,
    force: Force = False,
) -> None:
    """Draw a map in plan view and in 3D, plausible blue and suspicious red.

    The suffix of the output chooses PNG, SVG or PDF; without -o the picture is a PNG beside the input.
    """
    from mapq.report.drawing import read_picture
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import beside, claim_output
    from prf.shell.cli.pictures import picture_format, save
    from prf.shell.errors import UsageError

    if (colour == "field") != (field is not None):
        raise UsageError("--colour field and --field NAME go together.")
    target = output or beside(file, f"{PurePath(file).stem if file != STREAM else 'map'}.png")
    picture_format(target)
    claim_output(target, force, inputs=[file])
    picture = read_picture(file, colour, field, cloud_options(file, settings))
    save(picture.draw(("plan", "3d") if view == "both" else (view,)), target)
    if target != STREAM:
        logger.info("wrote %s", target)
