"""JSON as other programs want it: one object, with the name of its schema, and null where there is no number."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any


def jsonable(value: Any) -> Any:
    """Return `value` as plain JSON types: nan and infinities become null, arrays lists, paths text.

    Arrays and scalars of numpy are recognised by their ``tolist``, so that numpy need not be imported.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return jsonable(value.tolist())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: jsonable(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return jsonable(value._asdict())
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def dump_object(schema: str, content: Mapping[str, Any], indent: int | None = None) -> str:
    """Return one JSON object whose first key is ``"schema"``, e.g. ``prf.info/1``."""
    return json.dumps(jsonable({"schema": schema, **content}), indent=indent, allow_nan=False, ensure_ascii=False)


def emit_object(schema: str, content: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output, as ``--json`` promises."""
    print(dump_object(schema, content))


def emit_pieces(pieces: Iterable[str]) -> None:
    """Print the pieces of one JSON object as one line, as :func:`emit_object`; they need not be held at once.

    Line feeds between values are left out; in strings JSON has none.
    """
    for piece in pieces:
        print(piece.replace("\n", ""), end="")
    print()
