"""What is assessed, and with which features: files, and the feature settings of a model."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import NamedTuple

from pydantic import TypeAdapter, ValidationError

from mapq.cloud import PointCloud
from mapq.features import FeatureSettings
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.patches import holds_patches, parse_patches
from mapq.model import Model
from mapq.patches import Patches
from prf.shell.errors import ConfigError, InputError


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
    try:
        # As JSON: arrays may become tuples there, and no word becomes a number.
        return TypeAdapter(FeatureSettings).validate_json(json.dumps(dict(model.features)), strict=True)
    except (ValidationError, ConfigError) as error:
        what = error.errors()[0] if isinstance(error, ValidationError) else {"loc": (), "msg": str(error)}
        where = "".join(f" {place}" for place in what["loc"][:1])
        raise InputError(
            f"the model's feature setting{where} cannot be used ({what['msg']}). Train the model anew."
        ) from None


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
