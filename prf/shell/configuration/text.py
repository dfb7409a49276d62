"""Writing the text of a settings file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

NO_COMMENTS: Mapping[str, str] = MappingProxyType({})


def settings_text(tables: Mapping[str, Mapping[str, Any]], comments: Mapping[str, str] = NO_COMMENTS) -> str:
    """Return the text of a settings file; its numbers are read back to the last bit.

    Parameters
    ----------
    tables : mapping of str to mapping
        Table to key to value.
    comments : mapping of str to str, optional
        For ``""`` (the head of the file), ``"TABLE"`` or ``"TABLE.KEY"``. The first two may have several lines.
    """
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
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_written, value))}]"
    return str(value).lower() if isinstance(value, bool | int) else repr(float(value))
