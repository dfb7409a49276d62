"""Options that several verbs of `mapq` share, beside those of :mod:`prf.shell.options`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from mapq.model import Model

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
        "--tile-points", metavar="N", help="Cut the map into tiles of so many points: memory follows them.  [2500000]"
    ),
]


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


def chosen_context(names: Sequence[str] | None) -> dict[str, Any]:
    """Return the feature setting that ``--context`` makes; nothing where it is absent."""
    if not names:
        return {}
    return {"context": tuple(name for name in dict.fromkeys(names) if name != "none")}


def beside(path: str, suffix: str) -> str:
    """Return the name of what is made of the file `path`: beside it, its stem with another suffix."""
    file = Path(path)
    return str(file.with_name(file.name.removesuffix(".gz")).with_suffix(suffix))


def refuse_inputs(outputs: Sequence[str], inputs: Sequence[str]) -> None:
    """Raise UsageError if an output is an input, even under --force: a slip would cost labels set by hand.

    Raises
    ------
    UsageError
    """
    from prf.shell.errors import UsageError

    for output in outputs:
        for given in inputs:
            if os.path.isfile(output) and os.path.isfile(given) and os.path.samefile(output, given):
                raise UsageError(f"{output} is an input and would be overwritten. Name another output with -o.")
