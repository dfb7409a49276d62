"""Options that several verbs of `mapq` share, beside those of :mod:`prf.shell.options`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from mapq.io import ReadOptions
    from mapq.model import Model
    from mapq.segmentation import SegmentSettings
    from mapq.tiled.run import TileSettings

BinColumns = Annotated[
    int,
    typer.Option("--bin-columns", metavar="N", min=3, max=4, help="Columns of a KITTI .bin: 4 with intensity, or 3."),
]

Config = Annotated[
    str | None,
    typer.Option("--config", metavar="FILE.toml", help="Parameters of the steps; options win over the file."),
]


def parse_unit(text: str) -> float:
    """Return the metres in a unit; see :func:`mapq.io.options.parse_unit`, which is imported when it is needed."""
    from mapq.io.options import parse_unit as parse

    return parse(text)


Unit = Annotated[
    float | None,
    typer.Option(
        "--unit",
        metavar="UNIT",
        parser=parse_unit,
        help="Unit of a cloud's coordinates: m, cm, mm, ft, us-ft, or metres as 0.01.  [as LAS says, else m]",
    ),
]

Topic = Annotated[
    str | None, typer.Option("--topic", metavar="NAME", help="Topic of the clouds in a ROS bag.  [the only one]")
]

Frame = Annotated[
    str | None, typer.Option("--frame", metavar="NAME", help="Frame of the map in a ROS bag, to which tf leads.  [map]")
]

Workers = Annotated[
    int | None,
    typer.Option("--workers", metavar="N", help="Processes that work on tiles of the map side by side.  [1]"),
]

Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers take the tiles, tcp://HOST:8786."
    ),
]

TilePoints = Annotated[
    int | None,
    typer.Option(
        "--tile-points",
        metavar="N",
        help="Points of a tile of the work, about: memory follows them.  [2500000]",
    ),
]


def tiling(given: Mapping[str, Any], segment: SegmentSettings, options: ReadOptions) -> TileSettings:
    """Return how a map is worked on in tiles and who does it.

    Parameters
    ----------
    given : mapping
        ``workers``, ``scheduler`` and ``tile_points`` as the options have them, None where not given.
    segment : SegmentSettings
    options : ReadOptions
    """
    from mapq.tiled.run import TileSettings

    named = {"tile_points": given["tile_points"], "n_workers": given["workers"], "scheduler": given["scheduler"]}
    chosen = {name: value for name, value in named.items() if value is not None}
    return TileSettings(**chosen, segment=segment, options=options)


def load_model(path: str | None, max_false_alarms: float | None) -> Model | None:
    """Return the model of a file, at another operating point if one is asked for; None for that of the package.

    Raises
    ------
    InputError
        If the model cannot be read.
    UsageError
        If it has no operating points.
    """
    from mapq.crf.operating import with_false_alarms
    from mapq.io.models import read_default_model, read_model

    model = None if path is None else read_model(path)
    if max_false_alarms is None:
        return model
    return with_false_alarms(model or read_default_model(), max_false_alarms, path or "the model of the package")


def parse_share(text: str) -> float:
    """Return the share that ``0.05`` or ``5%`` says.

    Raises
    ------
    ValueError
        If it is neither, or not between 0 and 1; typer makes a usage error of it.
    """
    number = text.strip().removesuffix("%").rstrip()
    try:
        share = float(number) / (100.0 if number != text.strip() else 1.0)
    except ValueError:
        share = -1.0
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"{text} is no share between 0 and 1. Give one such as 0.05 or 5%")
    return share


class Reading(StrEnum):
    """How equations 6 to 13 of the paper are read."""

    safe = "safe"
    literal = "literal"


Features = Annotated[
    Reading | None,
    typer.Option("--features", help="Bounded features in metres, or the paper's equations as printed.  [safe]"),
]

Radius = Annotated[
    float | None, typer.Option("--radius", metavar="METRES", help="Patches farther apart are no neighbours.  [3]")
]

Tau = Annotated[
    float | None,
    typer.Option("--tau", metavar="METRES", help="Distance over which a pair's weight falls to 1/e.  [2]"),
]

Neighbours = Annotated[
    int | None,
    typer.Option("--neighbours", metavar="N", help="Closest patches that each patch is joined to.  [4]"),
]

Watched = Annotated[
    int | None,
    typer.Option(
        "--watched", metavar="N", help="Of its N closest patches also join those that lie over it or cross it.  [16]"
    ),
]

Tolerance = Annotated[
    float | None,
    typer.Option("--tolerance", metavar="METRES", help="Distance at which surfaces count half as doubled.  [0.05]"),
]

Contexts = Annotated[
    list[str] | None,
    typer.Option(
        "--context",
        metavar="GROUP",
        help="Context that is measured, repeatable: outlines, moments, rays; none for the paper's features "
        "alone; all if absent.",
    ),
]


MaxFalseAlarms = Annotated[
    float | None,
    typer.Option(
        "--max-false-alarms",
        metavar="SHARE",
        parser=parse_share,
        help="Call as many suspicious as this share of the plausible patches allows, counted on regions kept out of "
        "training: 0.02 or 2%.",
    ),
]


def chosen_context(names: Sequence[str] | None) -> tuple[str, ...] | None:
    """Return the groups that ``--context`` names; None where it is absent."""
    return tuple(name for name in dict.fromkeys(names) if name != "none") if names else None


def beside(path: str, suffix: str) -> str:
    """Return the name of what is made of the file `path`: beside it, its stem with another suffix."""
    file = Path(path)
    return str(file.with_name(file.name.removesuffix(".gz")).with_suffix(suffix))
