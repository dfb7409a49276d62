"""Ask a run or a grid how probably points, squares or a path are occupied or free."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated

import typer

from prf.shell.options import Json

if TYPE_CHECKING:
    from prf.api.run import Run
    from prf.occupancy import OccupancyGrid

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf query office --points points.csv > answers.csv",
    "echo 2.0,3.5 | prf query office --points - --square 0.2",
    "prf query office --path path.csv --radius 0.25 --json",
    "prf query office.grid.npz --points points.csv",
)


def query(
    run: Annotated[str, typer.Argument(metavar="RUN|GRID", help="What prf sample or prf grid wrote.")],
    points: Annotated[
        str | None, typer.Option("--points", metavar="FILE.csv", help="Points to ask for, x,y; - is standard input.")
    ] = None,
    square: Annotated[
        float | None,
        typer.Option(
            "--square", metavar="METRES", help="Ask whether any part of the square of this side round a point is black."
        ),
    ] = None,
    path: Annotated[
        str | None,
        typer.Option("--path", metavar="FILE.csv", help="Corners of a path, x,y, all inside the window."),
    ] = None,
    radius: Annotated[
        float | None, typer.Option("--radius", metavar="METRES", help="Radius of the disc that follows the path.")
    ] = None,
    json: Json = False,
) -> None:
    """Ask a run or a grid how probably points, squares or a path are occupied or free.

    With --points: CSV rows x,y,p_occupied in the order of the input; p_occupied is the share of draws that are black
    at the point, or in which the square is not completely white, and nan outside the window. With --path: p_free, the
    share of draws in which a disc can follow the whole path, nan if the path leaves the window; what the disc alone
    covers beyond it is taken as free. A GRID answers for its cells, taken as independent: that not all cells with
    their centres in a square, or all cells that the disc touches, are free.
    """
    from prf.api.run import open_run
    from prf.occupancy import is_grid, read_grid
    from prf.shell.errors import UsageError

    if (points is None) == (path is None):
        raise UsageError("give either --points FILE.csv or --path FILE.csv.")
    if (path is None) != (radius is None):
        raise UsageError("--path and --radius METRES go together.")
    if path is not None and square is not None:
        raise UsageError("--square goes with --points.")
    source = read_grid(run) if is_grid(run) else open_run(run, parts=())
    if points is not None:
        _answer_points(source, points, square or 0.0, json)
    elif path is not None and radius is not None:
        _answer_path(source, path, radius, json)


def _answer_points(source: Run | OccupancyGrid, points: str, square: float, json: bool) -> None:
    from prf import occupancy
    from prf.run import read_points
    from prf.shell import console, jsonout

    xy = read_points(points)
    if isinstance(source, occupancy.OccupancyGrid):
        n_draws, answers = None, occupancy.occupied_probability(source, xy, square).tolist()
    else:
        n_draws, answers = len(source.draws), source.query(xy, square).tolist()
    rows = [(x, y, p) for (x, y), p in zip(xy.tolist(), answers, strict=True)]
    if json:
        content = [dict(zip(("x", "y", "p_occupied"), row, strict=True)) for row in rows]
        jsonout.emit_object("prf.query.points/1", {"points": content, "square": square, "n_draws": n_draws})
    else:
        console.emit("\n".join(["x,y,p_occupied", *(f"{x!r},{y!r},{p!r}" for x, y, p in rows)]))


def _answer_path(source: Run | OccupancyGrid, path: str, radius: float, json: bool) -> None:
    from prf import occupancy
    from prf.run import read_points
    from prf.shell import console, jsonout

    xy = read_points(path)
    if isinstance(source, occupancy.OccupancyGrid):
        found = {"p_free": occupancy.path_free(source, xy, radius), "n_draws": None}
    else:
        found = {"p_free": float(source.paths(xy, radius)[0]), "n_draws": len(source.draws)}
    if found["p_free"] != found["p_free"]:
        logger.warning("%s: the path leaves the window, so nothing is known of it: p_free is nan.", path)
    if json:
        jsonout.emit_object("prf.query.path/1", found)
    else:
        console.emit("\n".join(f"{name:7}  {value!r}" for name, value in found.items() if value is not None))
