"""Options that several verbs of `mapq` share, beside those of :mod:`prf.shell.cli.options`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mapq.model import Model

Config = Annotated[
    str | None,
    typer.Option("--config", metavar="FILE.toml", help="Settings; --set and options override the file."),
]


def parse_unit(text: str) -> float:
    """Return the metres in a unit; see :func:`mapq.io.options.parse_unit`, which is imported when it is needed."""
    from mapq.io.options import parse_unit as parse

    return parse(text)


def parse_share(text: str) -> float:
    """Return the share in ``0.05`` or ``5%``.

    Raises ValueError if it is neither, or not between 0 and 1; typer makes a usage error of it.
    """
    number = text.strip().removesuffix("%").rstrip()
    try:
        share = float(number) / (100.0 if number != text.strip() else 1.0)
    except ValueError:
        share = -1.0
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"{text}: must be a share between 0 and 1 such as 0.05 or 5%")
    return share


Unit = Annotated[
    float | None,
    typer.Option(
        "--unit",
        metavar="UNIT",
        parser=parse_unit,
        help="Unit of a cloud's coordinates: m, cm, mm, ft, us-ft, or metres as 0.01.  [that of a LAS file, else m]",
    ),
]
Topic = Annotated[
    str | None, typer.Option("--topic", metavar="NAME", help="Topic of the clouds in a ROS bag.  [the only one]")
]
Poses = Annotated[
    str | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="Poses of the scans: TUM, KITTI, g2o, graph.txt, JSON or other rows.  [the file beside the scans]",
    ),
]
Calibration = Annotated[
    str | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="KITTI's calib.txt; none: poses are the laser's.  [beside poses or scans]",
    ),
]
Pattern = Annotated[
    str | None, typer.Option("--scans", metavar="PATTERN", help="Which files of a folder are scans: 'planes_*'.")
]
Every = Annotated[int, typer.Option("--every", metavar="K", min=1, help="Take scans 0, K, 2K and so on.")]
Submaps = Annotated[bool, typer.Option("--submaps", help="Scans are sub-maps of a drive, without a single sensor.")]
Workers = Annotated[
    int | None,
    typer.Option("--workers", metavar="N", help="Processes that work on tiles of the map side by side.  [1]"),
]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler for the tiles, tcp://HOST:8786."),
]
TilePoints = Annotated[
    int | None,
    typer.Option("--tile-points", metavar="N", help="Points of a tile, about; memory grows with it.  [2500000]"),
]
MaxTilt = Annotated[
    float | None,
    typer.Option("--max-tilt", metavar="DEG", help="Drop planes farther from vertical; 90 keeps all.  [30]"),
]
ModelFile = Annotated[
    str | None,
    typer.Option("--model", metavar="MODEL", help="A file of mapq train.  [the model of the package]"),
]
TruthField = Annotated[
    str | None,
    typer.Option(
        "--truth-field",
        metavar="NAME",
        help="Point field with the truth: 1 suspicious, 0 plausible, 255 unknown.  [labels of PATCHES, else truth]",
    ),
]
MaxFalseAlarms = Annotated[
    float | None,
    typer.Option(
        "--max-false-alarms",
        metavar="SHARE",
        parser=parse_share,
        help="Largest share of plausible patches called suspicious, on regions kept out of training: 0.02 or 2%.",
    ),
]


def load_model(path: str | None, max_false_alarms: float | None) -> Model | None:
    """Return the model of a file, at another operating point if one is given; None for that of the package.

    Raises InputError if the model cannot be read; UsageError if it has no operating points.
    """
    from mapq.crf.calibration import with_false_alarms
    from mapq.io.models import read_default_model, read_model

    model = None if path is None else read_model(path)
    if max_false_alarms is None:
        return model
    return with_false_alarms(model or read_default_model(), max_false_alarms, path or "the model of the package")


def beside(path: str, suffix: str) -> str:
    """Return the default name of an output: that of `path` with another suffix; "." has the name of its folder."""
    file = Path(path if Path(path).name not in ("", "..") else os.path.abspath(path))
    return str(file.with_name(file.name.removesuffix(".gz")).with_suffix(suffix))
