"""Libraries that only some formats need, and that an installation may lack."""

from __future__ import annotations

import importlib
from typing import Any

from prf.shell.errors import UsageError


def require(module: str, extra: str, what: str) -> Any:
    """Return the module, imported by name: it may be absent, and then has no types either.

    Parameters
    ----------
    module : str
    extra : str
        Extra of this distribution that brings it.
    what : str
        What needs it, for the message, say ``--format dxf`` or ``map.bag: reading a ROS bag``.

    Raises
    ------
    UsageError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UsageError(f"{what} needs {module}, which is not installed. pip install 'prf-mapq[{extra}]'") from error
