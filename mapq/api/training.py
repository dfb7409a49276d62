"""`train`: from labelled patches to a model."""

from __future__ import annotations

import os
from collections.abc import Sequence

from numpy.typing import ArrayLike

from mapq import patches as plain
from mapq.api.clouds import Path
from mapq.api.patches import Patches
from mapq.crf import TrainSettings
from mapq.features import FeatureSettings
from mapq.io.models import write_model as write_file
from mapq.model import Model
from mapq.training import train_maps
from prf.shell.errors import ArgumentError
from prf.shell.files import refuse_existing
from prf.shell.notebook import ProgressCallback, reported

Map = plain.Patches | Path


def train(
    maps: Map | Sequence[Map],
    labels: Sequence[ArrayLike] | None = None,
    settings: TrainSettings | None = None,
    features: FeatureSettings | None = None,
    *,
    max_patches: int | None = None,
    seed: int = 0,
    conservative: bool = False,
    progress: bool | ProgressCallback = True,
) -> Model:
    """Return the model that labelled patches teach.

    Without a regularisation in the settings its strength is chosen by cross-validation over regions of the maps, which
    also calibrates the probabilities; ``model.training["held_out"]`` has the scores on regions kept out.

    Parameters
    ----------
    maps : Patches, path of a PATCHES file, or a sequence of these
    labels : sequence of (m,) arrays, optional
        For each map the labels of its patches, 1 suspicious, 0 plausible, 255 not known. None: those they have.
    settings : TrainSettings, optional
    features : FeatureSettings, optional
        Stored in the model, which measures other maps in the same way.
    max_patches : int, optional
        Use about so many labelled patches: whole regions, drawn with `seed`.
    seed : int
    conservative : bool
        Patches without a label count as suspicious.
    progress : bool or callable
        As :func:`mapq.segment`.

    Raises
    ------
    ArgumentError
        If there are no maps, or the labels do not go with them.
    InputError
        If a file is no PATCHES file, or there are not labels of both kinds.
    ConfigError
        If the settings ask for an edge feature that there is not.
    """
    given = [maps] if isinstance(maps, plain.Patches | str | os.PathLike) else list(maps)
    if not given:
        raise ArgumentError("maps: there are none.")
    if labels is not None:
        given = _with_labels(given, labels)
    with reported(progress, len(given), "maps") as reporter:
        return train_maps(given, settings, features, max_patches, seed, reporter, conservative)[0]


def write_model(path: Path, model: Model, *, force: bool = False) -> None:
    """Write a model as readable JSON, to the last bit.

    Raises
    ------
    OutputError
        If the file stands already and may not be replaced (`force`), or cannot be written.
    """
    refuse_existing(path, force)
    write_file(path, model)


def _with_labels(maps: Sequence[Map], labels: Sequence[ArrayLike]) -> list[Map]:
    if len(labels) != len(maps):
        raise ArgumentError(f"labels: there are {len(labels)} arrays for {len(maps)} maps.")
    if not all(isinstance(each, plain.Patches) for each in maps):
        raise ArgumentError("labels: go with patches in memory. Read files by mapq.read_patches.")
    pairs = zip(maps, labels, strict=True)
    return [Patches.of(each).labelled(label) for each, label in pairs if isinstance(each, plain.Patches)]
