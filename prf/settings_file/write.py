"""Writing a settings file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import MappingProxyType

from prf.settings_file.tables import SCHEMA, Tables
from prf.shell.configuration import checked_tables, settings_text
from prf.shell.files import open_output

NO_COMMENTS: Mapping[str, str] = MappingProxyType({})


def write_settings(path: str | os.PathLike[str], tables: Tables, comments: Mapping[str, str] = NO_COMMENTS) -> None:
    """Write a settings file, whole or not at all; ``-`` is standard output.

    Parameters
    ----------
    path : path
    tables : dict of str to dict
        As :func:`prf.settings_file.read_settings` returns them: numbers are written in full, and read back to the last
        bit.
    comments : dict of str to str, optional
        For ``""`` (the head of the file), ``"TABLE"`` or ``"TABLE.KEY"``. The first two may have several lines.

    Raises
    ------
    ConfigError
        If :func:`prf.settings_file.read_settings` would refuse the file.
    OutputError
        If it cannot be written.
    """
    checked = checked_tables(tables, lambda table, key: os.fspath(path), SCHEMA)
    with open_output(path) as stream:
        stream.write(settings_text(checked, comments))
