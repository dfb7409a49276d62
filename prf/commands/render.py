"""Draw a picture of a run, of a grid, or of draws from the prior."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from prf.shell.cli.options import Force, Output
from prf.shell.errors import UsageError

if TYPE_CHECKING:
    from prf.model.coloring import Coloring
    from prf.results import PosteriorImage

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf render office -o posterior.png",
    "prf render office --what draws --draws 6 -o draws.svg",
    'prf render p1.geojsonl p10.geojsonl --caption "p = 1" --caption "p = 10" -o prior.png',
)


What = Literal["posterior", "squares", "best", "draws", "beams"]
"""What of a run to draw."""


def render(
    inputs: Annotated[
        list[str],
        typer.Argument(metavar="RUN|GRID|DRAWS...", help="What prf sample, prf grid or prf prior wrote."),
    ],
    what: Annotated[
        What,
        typer.Option(
            "--what",
            help="Of a run: probability that points are occupied, or squares not free; best map; some draws; readings.",
        ),
    ] = "posterior",
    draws: Annotated[
        int | None, typer.Option("--draws", metavar="N", min=1, help="How many draws; of several DRAWS, of each.")
    ] = None,
    outline: Annotated[
        bool | None, typer.Option("--outline/--no-outline", help="Edges of the best map (default: over the posterior).")
    ] = None,
    path: Annotated[
        bool | None, typer.Option("--path/--no-path", help="Path of the sensor (default: over posterior and readings).")
    ] = None,
    title: Annotated[str | None, typer.Option("--title", metavar="TEXT", help="Instead of the default title.")] = None,
    caption: Annotated[
        list[str] | None, typer.Option("--caption", metavar="TEXT", help="Caption of a map of DRAWS; once for each.")
    ] = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Draw a picture of a run, of a grid, or of draws from the prior.

    The suffix of the output chooses PNG, SVG or PDF; without -o the picture is a PNG beside the input.
    White is free, black occupied, mid-grey unknown.
    """
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import beside, claim_output
    from prf.shell.cli.pictures import picture_format

    is_run, is_grid = Path(inputs[0]).is_dir(), _is_grid(inputs[0])
    if (is_run or is_grid) and len(inputs) > 1:
        raise UsageError("one RUN or GRID gives one picture; only DRAWS go side by side.")
    if is_grid and (what != "posterior" or draws or outline or path):
        raise UsageError("a GRID has cells only: leave --what, --draws, --outline and --path out.")
    name = Path(inputs[0]).resolve().name + f"-{what}" if is_run else Path(inputs[0]).stem
    target = output or beside(inputs[0], f"{'draws' if inputs[0] == STREAM else name}.png")
    picture_format(target)
    claim_output(target, force, inputs=inputs)
    if is_run:
        _render_run(inputs[0], target, what, draws or 4, outline, path, title)
    elif is_grid:
        _render_grid(inputs[0], target, title)
    else:
        _render_draws(inputs, target, draws, title, caption or [])
    if target != STREAM:
        logger.info("wrote %s", target)


def _render_run(
    source: str,
    target: str,
    what: What,
    n_draws: int,
    outline: bool | None,
    path: bool | None,
    title: str | None,
) -> None:
    from prf.output import pictures as render
    from prf.output.run import read_run

    run = read_run(source)
    if what == "best":
        render.render_best(run, target, path=bool(path), title=title)
    elif what == "draws":
        render.render_draws(run, target, n_draws=n_draws, title=title)
    elif what == "beams":
        render.render_beams(run, target, outline=bool(outline), path=path is not False, title=title)
    else:
        render.render_posterior(
            run,
            target,
            squares=what == "squares",
            outline=outline is not False,
            path=path is not False,
            title=title,
        )


def _is_grid(source: str) -> bool:
    from prf.results import occupancy

    return occupancy.is_grid(source)


def _render_grid(source: str, target: str, title: str | None) -> None:
    from prf.output import pictures as render

    image, head, words = _grid_picture(source, title)
    render.render_cells(image, target, title=head, words=words)


def _grid_picture(source: str, title: str | None) -> tuple[PosteriorImage, str, str]:
    """Return the cells of a grid, the title and the small print over them."""
    from prf.results import occupancy

    grid = occupancy.read_grid(source)
    words = f"{Path(source).stem}  ·  {grid.settings.get('method', 'unknown method')}"
    return grid.image(), title or "Occupancy grid", words


def _render_draws(sources: list[str], target: str, n_draws: int | None, title: str | None, captions: list[str]) -> None:
    from prf.output.pictures import render_maps

    render_maps(*_read_draws(sources, n_draws, captions), target, title=title)


def _read_draws(sources: list[str], n_draws: int | None, captions: list[str]) -> tuple[list[Coloring], list[str]]:
    """Return the maps and their captions."""
    from prf.model.coloring import check, read_geojsonl
    from prf.shell.errors import InputError

    maps, names = [], []
    for source in sources:
        drawn = list(read_geojsonl(source))[: n_draws or (4 if len(sources) == 1 else 1)]
        maps += drawn
        stem = f"{Path(source).stem}, " if len(sources) > 1 else ""
        names += [f"{stem}draw {number}" for number in range(1, len(drawn) + 1)]
        for number, coloring in enumerate(drawn, 1):
            try:
                check(coloring)
            except InputError as error:
                raise InputError(f"{source}: draw {number}: {error}") from error
    if captions and len(captions) != len(maps):
        raise UsageError(f"{len(captions)} captions for {len(maps)} maps. Give one --caption a map, or none.")
    if not maps:
        raise UsageError("no map to draw.")
    return maps, captions or names
