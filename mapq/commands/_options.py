"""Options and inputs that several verbs of `mapq` share, beside those of :mod:`prf.shell.cli.options`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.configuration import AS_IT_IS, typed_keys
from prf.shell.cli.files import STREAM
from prf.shell.cli.outputs import beside

if TYPE_CHECKING:
    from mapq.cloud import PointCloud
    from mapq.configuration import Configuration, ReadOptions
    from mapq.model import Model
    from prf.shell.cli.settings import Loaded

BAG_FILES = (".yaml", ".db3", ".mcap", ".bag")
"""Suffixes of what is in the folder of a ROS bag."""

ModelFile = Annotated[
    str | None,
    typer.Option("--model", metavar="MODEL", help="A file of mapq train.  [the model of the package]"),
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


def named_after(path: str, suffix: str) -> str:
    """Return the default name of an output: that of `path` with another suffix; "." has the name of its folder."""
    file = Path(path if Path(path).name not in ("", "..") else os.path.abspath(path))
    return beside(file, Path(file.name.removesuffix(".gz")).with_suffix(suffix).name)


OF_SCANS = {"poses", "calibration", "pattern", "every", "submaps"}
"""Keys of [scans] that say, on the command line, that inputs are scans; a file of settings may be for other inputs."""


def are_scans(inputs: Sequence[str], settings: Loaded[Configuration]) -> bool:
    """Return whether inputs are scans: by flags, several files, or a folder of neither tiles of a map nor a bag.

    So is an E57 of several scans, unless the command line asks for tiles.
    """
    if len(inputs) > 1 or OF_SCANS & set(typed_keys(settings, "scans")):
        return True
    if not os.path.isdir(inputs[0]):
        from mapq.posed.files import E57_SUFFIX

        is_e57 = inputs[0].lower().endswith(E57_SUFFIX) and not typed_keys(settings, "tiles")
        return is_e57 and _holds_scans(inputs[0])
    from mapq.io.tiles import is_tiled

    return not (is_tiled(inputs[0]) or any(each.suffix in BAG_FILES for each in Path(inputs[0]).iterdir()))


def _holds_scans(path: str) -> bool:
    """Return whether a file called E57 is one, and holds scans from several places."""
    from mapq.io.clouds import recognise
    from mapq.io.content import Content
    from mapq.posed.find import find_scans

    return recognise(Content(path)) == "e57" and find_scans([path]).are_apart


def cloud_options(file: str, settings: Loaded[Configuration]) -> ReadOptions:
    """Return what is set for clouds; for PATCHES, which hold it themselves, only what the command line asks for."""
    from mapq.io import is_patches

    holds_it = file != STREAM and os.path.isfile(file) and is_patches(file)
    return AS_IT_IS if holds_it and not typed_keys(settings, "cloud") else settings.settings.cloud


def default_name(inputs: Sequence[str], suffix: str) -> str:
    """Return the default name of an output: the input's with another suffix; for a folder or its files beside it.

    "." has the name of its folder.
    """
    if len(inputs) == 1 and not os.path.isdir(inputs[0]):
        return named_after(inputs[0], suffix)
    folder = inputs[0] if len(inputs) == 1 else os.path.dirname(inputs[0]) or "."
    place = os.path.abspath(folder) if set(folder) <= {".", os.sep} else folder.rstrip(os.sep)
    return beside(place, os.path.basename(place) + suffix)


def read_scans(inputs: Sequence[str], settings: Configuration) -> PointCloud:
    """Return the map of scans."""
    from mapq.api import read_scans as merged

    scans = settings.scans
    return merged(inputs, find=scans, merging=scans, every=scans.every, options=settings.cloud)
