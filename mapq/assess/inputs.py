"""What is assessed, and with which features: files, and the feature settings of a model."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any, NamedTuple

from mapq.cloud import PointCloud
from mapq.features import FeatureSettings
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.patches import holds_patches, parse_patches
from mapq.model import Model
from mapq.patches import Patches
from prf.shell.errors import ConfigError, InputError

LARGEST_SETTING = 1e6
"""Of a model's feature settings, in metres or patches: a map is smaller."""


class Origin(NamedTuple):
    """Inputs of a result."""

    name: str = "the map"  # of the map, for messages
    model: str = "default"  # "default", the model's file, or "given"
    files: tuple[str, ...] = ()  # whose digests a written result has


def feature_settings(model: Model) -> FeatureSettings:
    """Return the settings with which the model's features were measured.

    Raises InputError if one is missing, unknown, or outside its domain.
    """
    known = {field.name for field in fields(FeatureSettings)}
    for name in sorted(known ^ set(model.features)):
        state = "is missing" if name in known else "is not known to this release"
        raise InputError(f"the model's feature setting {name} {state}. Train the model anew.")
    values: dict[str, Any] = dict(model.features)
    for name, default in asdict(FeatureSettings()).items():
        if not _is_of_kind(values[name], default):
            raise InputError(
                f"the model's feature setting {name} cannot be used ({values[name]!r}). Train the model anew."
            )
    try:
        values["context"] = tuple(values["context"])
        values["up"] = None if values["up"] is None else tuple(values["up"])
        return FeatureSettings(**values)
    except (TypeError, ConfigError) as error:
        raise InputError(f"the model's feature settings cannot be used ({error}). Train the model anew.") from error


def read_input(path: str, options: ReadOptions = AS_IT_IS) -> Patches | PointCloud:
    """Read PATCHES or a cloud, whichever `path` is; ``-`` is standard input.

    Raises InputError as :func:`mapq.io.read_patches` and :func:`mapq.io.read_cloud`; UsageError if a unit is given for
    PATCHES.
    """
    content = Content(path)
    if holds_patches(content):
        options.refuse_unit(path)
        return parse_patches(content.data(), path)
    return parse_cloud(content, options)[1]


def _is_of_kind(value: Any, default: Any) -> bool:
    """Return whether a setting of a model file has the type of its default; null, a length or direction or null."""
    if default is None:
        return value is None or isinstance(value, list | tuple) or _is_of_kind(value, 0.0)
    if isinstance(default, tuple):
        return isinstance(value, list | tuple) and all(isinstance(each, str) for each in value)
    if isinstance(default, bool | str):
        return isinstance(value, type(default))
    whole = isinstance(value, int) and not isinstance(value, bool)
    return (whole or (isinstance(default, float) and isinstance(value, float))) and abs(value) <= LARGEST_SETTING
