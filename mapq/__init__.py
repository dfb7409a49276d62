"""How plausible a point cloud map is, plane patch by plane patch.

Names are imported when they are first used, so that `import mapq` is quick (docs/python-api.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from prf import __version__ as __version__

if TYPE_CHECKING:
    from mapq.api import (
        classify,
        classify_scans,
        patch_features,
        point_cloud,
        read_cloud,
        read_scans,
        segment,
        train,
        write_model,
        write_patches,
    )
    from mapq.cloud import PointCloud
    from mapq.configuration import (
        FeatureSettings,
        FindSettings,
        MergeSettings,
        ReadOptions,
        SegmentSettings,
        TrainSettings,
    )
    from mapq.io.models import read_model
    from mapq.io.patches import read_patches
    from mapq.model import Model
    from mapq.patches import Patches
    from mapq.results.result import Result
    from prf.shell.errors import PrfError

__all__ = [
    "FeatureSettings",
    "FindSettings",
    "MergeSettings",
    "Model",
    "Patches",
    "PointCloud",
    "PrfError",
    "ReadOptions",
    "Result",
    "SegmentSettings",
    "TrainSettings",
    "classify",
    "classify_scans",
    "patch_features",
    "point_cloud",
    "read_cloud",
    "read_model",
    "read_patches",
    "read_scans",
    "segment",
    "train",
    "write_model",
    "write_patches",
]

_HOMES = {
    "mapq.api": (
        "classify",
        "classify_scans",
        "patch_features",
        "point_cloud",
        "read_cloud",
        "read_scans",
        "segment",
        "train",
        "write_model",
        "write_patches",
    ),
    "mapq.cloud": ("PointCloud",),
    "mapq.configuration": (
        "FeatureSettings",
        "FindSettings",
        "MergeSettings",
        "ReadOptions",
        "SegmentSettings",
        "TrainSettings",
    ),
    "mapq.io.models": ("read_model",),
    "mapq.io.patches": ("read_patches",),
    "mapq.model": ("Model",),
    "mapq.patches": ("Patches",),
    "mapq.results.result": ("Result",),
    "prf.shell.errors": ("PrfError",),
}
"""Module to the names that it lends to this package; a test holds them to what type checkers see above."""


if not TYPE_CHECKING:  # which would take any misspelt name for one of these

    def __getattr__(name: str) -> object:
        """Import what is used for the first time."""
        from importlib import import_module  # noqa: PLC0415

        for module, names in _HOMES.items():
            if name in names:
                value = globals()[name] = getattr(import_module(module), name)
                return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the names that this package offers."""
    return sorted({*globals(), *__all__})
