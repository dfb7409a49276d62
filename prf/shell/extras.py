"""Libraries that only some formats need, and that an installation may lack."""

from __future__ import annotations

import importlib
from typing import Any

from prf.shell.errors import UsageError


def require(module: str, extra: str, what: str) -> Any:
    """Return the module, imported by name, or raise UsageError if it is not installed.

    `extra`: of this distribution, which brings it. `what`: needs it, say ``--format dxf`` or ``map.bag: a ROS bag``.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UsageError(f"{what} needs {module}, which is not installed. pip install 'prf-mapq[{extra}]'") from error
