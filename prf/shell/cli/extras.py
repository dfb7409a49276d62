"""Libraries that only some formats need, and that an installation may lack."""

from __future__ import annotations

import importlib
import shlex
from importlib import metadata
from typing import Any

from prf.shell.errors import PrfError, UsageError

DISTRIBUTION = "prf-mapq"


def require(module: str, extra: str, what: str, error: type[PrfError] = UsageError) -> Any:
    """Return the module, imported by name, or raise `error` if it is not installed.

    `extra`: of this distribution, which brings it. `what`: needs it, say ``--format dxf`` or ``map.bag: a ROS bag``.
    """
    try:
        return importlib.import_module(module)
    except ImportError as cause:
        raise error(f"{what} needs {module}, which is not installed. {install_hint(extra)}") from cause


def install_hint(extra: str) -> str:
    """Return how to install an extra: in a checkout by its name, elsewhere (from a wheel) by what it consists of."""
    try:
        wanted = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:  # the tree itself, not installed
        wanted = []
    parts = [shlex.quote(one.partition(";")[0].strip()) for one in wanted if f"extra == '{extra}'" in one]
    return f"In a checkout: pip install '.[{extra}]'" + (f"; elsewhere: pip install {' '.join(parts)}" if parts else "")
