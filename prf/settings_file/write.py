"""Writing a settings file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from prf.settings_file.tables import Tables, checked_tables
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
    checked = checked_tables(tables, lambda table, key: os.fspath(path))
    with open_output(path) as stream:
        stream.write(settings_text(checked, comments))


def settings_text(tables: Tables, comments: Mapping[str, str] = NO_COMMENTS) -> str:
    """Return the text of a settings file; for the parameters see :func:`write_settings`."""
    parts = [_comment(comments.get("", ""))]
    for table, values in tables.items():
        lines = {key: f"{key} = {_written(value)}" for key, value in values.items()}
        width = max(map(len, lines.values()), default=0)
        notes = {key: comments.get(f"{table}.{key}", "") for key in lines}
        rows = [f"{line:<{width}}  # {notes[key]}" if notes[key] else line for key, line in lines.items()]
        parts.append(_comment(comments.get(table, "")) + "\n".join([f"[{table}]", *rows]) + "\n")
    return "\n".join(part for part in parts if part)


def _comment(text: str) -> str:
    return "".join(f"# {line}".rstrip() + "\n" for line in text.splitlines())


def _written(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return f"[{', '.join(map(_written, value))}]" if isinstance(value, list | tuple) else repr(float(value))
