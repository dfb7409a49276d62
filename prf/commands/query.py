"""Query how probably points, squares or a path are occupied or free."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.shell.cli.options import Json

if TYPE_CHECKING:
    from prf.output.run import Run
    from prf.results.estimate import Estimates, PointEstimates
    from prf.results.occupancy import OccupancyGrid

logger = logging.getLogger(__name__)

WANTED_FREE = 0.95
"""A path that is free less often than this has what blocks it named."""
MAX_RHAT = 1.1
"""Above it a warning reports that the chains disagree on the answer."""

EXAMPLES = (
    "prf query office --points points.csv > answers.csv",
    "echo 2.0,3.5 | prf query office --points - --square 0.2",
    "prf query office --path path.csv --radius 0.25 --json",
    "prf query office.grid.npz --points points.csv",
)


def query(
    run: Annotated[str, typer.Argument(metavar="RUN|GRID", help="What prf sample or prf grid wrote.")],
    points: Annotated[
        str | None, typer.Option("--points", metavar="FILE.csv", help="Points, x,y; - is standard input.")
    ] = None,
    square: Annotated[
        float | None,
        typer.Option(
            "--square", metavar="METRES", help="Whether any part of the square of this side round a point is black."
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
    """Query how probably points, squares or a path are occupied or free.

    With --points: CSV rows x,y,p_occupied,low,high,seen,p_return in the order of the input. p_occupied is the share of
    draws that are black at the point, or in which the square is not completely white, and nan outside the window; seen
    is 1 where a reading crossed the cell of the image that holds the point, or ended in it; p_return is the probability
    that a beam which reaches the square (0.2 m without --square) ends in it, at a wall or at what no wall explains.
    With --path: p_free, the share of draws in which a disc can follow the whole path, nan if the path leaves the
    window; what the disc alone covers beyond it is taken as free. Of a path that is free in less than 0.95 of the draws
    the piece that blocks it is named. low and high bound the probability at 95 % for the Monte Carlo error alone, from
    ESS and R-hat of the very question. A GRID has no such error, and answers for its cells, taken as independent: that
    not all cells with their centres in a square, or all cells that the disc touches, are free.
    """
    from prf.output.run import read_run
    from prf.results import names
    from prf.results.occupancy import is_grid, read_grid
    from prf.shell.errors import UsageError

    if (points is None) == (path is None):
        raise UsageError("give either --points FILE.csv or --path FILE.csv.")
    if (path is None) != (radius is None):
        raise UsageError("--path and --radius METRES go together.")
    if path is not None and square is not None:
        raise UsageError("--square goes with --points.")
    source = read_grid(run) if is_grid(run) else read_run(run, parts=(names.POSTERIOR, names.READINGS, names.POSES))
    if points is not None:
        _answer_points(source, points, square or 0.0, json)
    elif path is not None and radius is not None:
        _answer_path(source, path, radius, json)


def _answer_points(source: Run | OccupancyGrid, points: str, square: float, json: bool) -> None:
    from prf.readings.points import read_points
    from prf.results import occupancy
    from prf.results.score.heldout import SQUARE
    from prf.shell.cli import console, storage

    xy = read_points(points)
    columns = {"x": xy[:, 0].tolist(), "y": xy[:, 1].tolist()}
    found: PointEstimates | None = None
    if isinstance(source, occupancy.OccupancyGrid):
        p = occupancy.occupied_probability(source, xy, square).tolist()
        n_draws, seen = None, source.image().seen_at(xy)
        columns |= {"p_occupied": p, "low": p, "high": p}
        returned = occupancy.occupied_probability(source, xy, square or SQUARE)
    else:
        n_draws, found = len(source.draws), source.query(xy, square, interval=True)
        seen, errors = found.seen, {"ess": found.ess.tolist(), "rhat": found.rhat.tolist()} if json else {}
        bounds = {"low": found.low.tolist(), "high": found.high.tolist()}
        columns |= {"p_occupied": found.probability.tolist(), **bounds, **errors}
        returned = source.return_probability(xy, square)
    columns["seen"] = (seen if json else seen.astype(int)).tolist()
    columns["p_return"] = returned.tolist()
    rows = zip(*columns.values(), strict=True)
    if json:
        content = [dict(zip(columns, row, strict=True)) for row in rows]
        storage.emit_object("prf.query.points/1", {"points": content, "square": square, "n_draws": n_draws})
    else:
        console.emit("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]))
    if found is not None:  # below the rows, where it stays in sight
        _warn(points, "point", found)


def _answer_path(source: Run | OccupancyGrid, path: str, radius: float, json: bool) -> None:
    from prf.readings.points import read_points
    from prf.results import occupancy
    from prf.shell.cli import console, storage

    xy, blocked = read_points(path), None
    if isinstance(source, occupancy.OccupancyGrid):
        p = occupancy.path_free(source, xy, radius)
        answer: dict[str, float | None] = {"p_free": p, "low": p, "high": p, "ess": None, "rhat": None, "n_draws": None}
    else:
        found = source.paths(xy, radius, interval=True)
        values = [float(column[0]) for column in found]
        answer = {**dict(zip(("p_free", *found._fields[1:]), values, strict=True)), "n_draws": len(source.draws)}
        _warn(path, "path", found)
        if values[0] < WANTED_FREE:
            blocked = _what_blocks(source, path, xy, radius)
    if answer["p_free"] != answer["p_free"]:
        logger.warning("%s: the path leaves the window, so nothing is known about it: p_free is nan.", path)
    if json:
        storage.emit_object("prf.query.path/1", answer | {"blocked": blocked})
    else:
        shown = {name: value for name, value in answer.items() if value is not None}
        shown |= {name: round(shown[name], 2) for name in ("ess", "rhat") if name in shown}
        console.emit("\n".join(f"{name:7}  {value!r}" for name, value in shown.items()))


def _what_blocks(source: Run, path: str, xy: Any, radius: float) -> dict[str, Any]:
    """Name on stderr the piece of a path that keeps it from being free; return it for --json."""
    found = source.what_blocks(xy, radius)
    (x0, y0), (x1, y1) = found.piece.tolist()
    counted = "1 return lies" if found.n_returns == 1 else f"{found.n_returns or 'no'} returns lie"
    driven = "it is part of the way driven" if found.is_driven else "it is not part of the way driven"
    logger.warning(
        f"{path}: from ({x0:.2f}, {y0:.2f}) to ({x1:.2f}, {y1:.2f}) is free in {found.p_free:.2f} of the draws; "
        f"{counted} within {radius:g} m of it, and {driven} (docs/driven-way.md)."
    )
    return {**found._asdict(), "piece": found.piece.tolist()}


def _warn(file: str, kind: str, found: Estimates | PointEstimates) -> None:
    """Warn where chains are too short, or disagree, for the answer."""
    from prf.results.convergence import FEWEST_DRAWS, MIN_ESS

    known = found.probability == found.probability
    weak = known & ~((found.ess >= MIN_ESS) & (found.rhat <= MAX_RHAT))
    if not weak.any():
        return
    ess, rhat = found.ess[weak].min(), found.rhat[weak].max()
    worst = f"ESS {ess:.0f}, R-hat {rhat:.2f}" if ess == ess else f"fewer than {FEWEST_DRAWS} draws a chain"
    which = f"the {kind}" if len(weak) == 1 else f"{weak.sum()} of {len(weak)} {kind}s, at worst"
    bounds = f"(wanted: ESS {MIN_ESS:.0f} or more, R-hat {MAX_RHAT} or less)"
    logger.warning(f"{file}: {worst} for {which} {bounds}. Sample longer: prf sample --resume.")
