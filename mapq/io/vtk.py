"""Legacy VTK: the points of a data set, as text or big endian, with what stands at each of them."""

from __future__ import annotations

import logging

import numpy as np

from mapq.io.fields import Array
from mapq.io.rows import as_count
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

TYPES = {
    **{"char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4", "unsigned_int": "u4"},
    **{"long": "i8", "unsigned_long": "u8", "vtktypeint64": "i8", "vtktypeuint64": "u8", "float": "f4", "double": "f8"},
    "vtkidtype": "i4",
}
"""Types of numpy by those of VTK, which writes its numbers of points and cells as int."""

WITH_POINTS = ("POLYDATA", "UNSTRUCTURED_GRID", "STRUCTURED_GRID")
CELLS = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS", "CELLS")
POINT_DATA = "POINT_DATA"
DATA = (POINT_DATA, "CELL_DATA")
TRIPLES = ("VECTORS", "NORMALS")
HEADER_LINES = 3


class _Walk:
    """A way through the file, from one section to the next."""

    def __init__(self, data: bytes, source: str) -> None:
        self.data, self.source, self.place = data, source, 0
        self.is_text = True

    def line(self) -> list[str]:
        """Return the words of the next line that has some, none at the end."""
        while self.place < len(self.data):
            end = self.data.find(b"\n", self.place)
            end = len(self.data) if end < 0 else end
            words = self.data[self.place : end].decode("latin-1").split()
            self.place = end + 1
            if words:
                return words
        return []

    def skip_block(self) -> None:
        """Pass over lines up to one that is blank, or the end."""
        while self.place < len(self.data):
            end = self.data.find(b"\n", self.place)
            end = len(self.data) if end < 0 else end
            is_blank = not self.data[self.place : end].strip()
            self.place = end + 1
            if is_blank:
                return

    def values(self, n_values: int, kind: str) -> Array:
        """Return the next values, of a type by its name in VTK."""
        if kind.lower() not in TYPES:
            raise self.fault(f"type {kind[:24]!r} is not one of VTK")
        dtype = np.dtype(TYPES[kind.lower()])
        rest = len(self.data) - self.place
        if n_values * (2 if self.is_text else dtype.itemsize) > rest + self.is_text:
            raise self.fault(f"cut off: {n_values} values of type {kind} are promised, {max(rest, 0)} bytes follow")
        if self.is_text:
            return self._text_values(n_values, dtype)
        values = np.frombuffer(self.data, dtype.newbyteorder(">"), n_values, self.place)
        self.place += values.nbytes
        return values

    def _text_values(self, n_values: int, dtype: np.dtype[np.generic]) -> Array:
        words = self.data[self.place :].split(None, n_values)
        if len(words) > n_values:
            self.place = len(self.data) - len(words.pop())
        else:
            self.place = len(self.data)
        try:
            values = np.array(words, "S").astype(dtype)
        except (ValueError, OverflowError):
            values = np.empty(0, dtype)
        if len(values) < n_values:
            raise self.fault(f"not {n_values} values of type {dtype} where they are promised")
        return values

    def count(self, words: list[str], place: int) -> int:
        """Return the count at a place of a line."""
        number = as_count(words[place]) if place < len(words) else None
        if number is None:
            raise self.fault(f"no count in the line {' '.join(words)[:60]!r}")
        return number

    def fault(self, what: str) -> InputError:
        """Return the error for what is wrong with the file."""
        return InputError(f"{self.source}: {what}. Copy the VTK file again, or save it as PLY.")


def read_vtk(data: bytes, source: str) -> dict[str, Array]:
    """Return the points of a legacy VTK file and the numbers at each of them; cells are passed over.

    Raises
    ------
    InputError
        For a data set without points of its own, and data that are cut off or cannot be read.
    """
    walk = _Walk(data, source)
    encoding = next((words for _ in range(HEADER_LINES) if (words := walk.line()) in (["ASCII"], ["BINARY"])), [])
    if not encoding:
        raise walk.fault("neither ASCII nor BINARY in the header of this VTK file")
    walk.is_text = encoding == ["ASCII"]
    kind = walk.line()
    if len(kind) != 2 or kind[1].upper() not in WITH_POINTS:
        raise walk.fault(f"{' '.join(kind)[:60]!r} is no data set with points")
    fields: dict[str, Array] = {}
    while words := walk.line():
        if words[0].upper() in DATA:
            break
        _read_section(walk, words, fields)
    if "x" not in fields:
        raise walk.fault("no POINTS")
    while words and words[0].upper() != POINT_DATA:
        # VTK itself writes what stands at the cells first.
        words = _read_data(walk, walk.count(words, 1), {})
    if words:
        n_rows = walk.count(words, 1)
        if n_rows != len(fields["x"]):
            raise walk.fault(f"{len(fields['x'])} points, but data of {n_rows}")
        _read_data(walk, n_rows, fields)
    return fields


def _read_section(walk: _Walk, words: list[str], fields: dict[str, Array]) -> None:
    """Read the points, or pass over a section of the geometry."""
    match words[0].upper():
        case "POINTS" if len(words) == 3:
            xyz = walk.values(3 * walk.count(words, 1), words[2]).reshape(-1, 3)
            fields |= {axis: xyz[:, column] for column, axis in enumerate("xyz")}
        case "OFFSETS" | "CONNECTIVITY":
            raise walk.fault("cells of VTK 5 are not read")
        case name if name in CELLS:
            walk.values(walk.count(words, 2), "int")
        case "CELL_TYPES":
            walk.values(walk.count(words, 1), "int")
        case "FIELD" if len(words) == 3:
            _read_arrays(walk, walk.count(words, 2), None, {})  # of the whole file: its time and the like
        case "METADATA":
            walk.skip_block()
        case "DIMENSIONS":
            pass
        case _:
            raise walk.fault(f"section {words[0][:24]!r} is not known")


def _read_data(walk: _Walk, n_rows: int, fields: dict[str, Array]) -> list[str]:
    """Read what stands at each point, or cell; return the words of the line that begins data of the other.

    It ends at a section that is not known, with a warning.
    """
    while words := walk.line():
        match [words[0].upper(), *words[1:]]:
            case [key, _] if key in DATA:
                return words
            case ["SCALARS", name, kind, *rest]:
                width = walk.count(rest, 0) if rest else 1
                walk.line()  # the name of a lookup table
            case [key, name, kind] if key in TRIPLES:
                width = 3
            case ["FIELD", _, _]:
                _read_arrays(walk, walk.count(words, 2), n_rows, fields)
                continue
            case ["METADATA"]:
                walk.skip_block()
                continue
            case _:
                logger.warning("%s: what follows on %s is not read", walk.source, words[0][:24])
                return []
        _add(walk, name, kind, (n_rows, width), fields)
    return []


def _read_arrays(walk: _Walk, n_arrays: int, n_rows: int | None, fields: dict[str, Array]) -> None:
    """Read the arrays of a field: of `n_rows` rows each, or (None) of as many as each says."""
    for _ in range(n_arrays):
        words = walk.line()
        if words == ["METADATA"]:  # of the array before
            walk.skip_block()
            words = walk.line()
        n_found = walk.count(words, 2)
        if len(words) != 4 or n_rows not in (None, n_found):
            of = "" if n_rows is None else f" of {n_rows} points"
            raise walk.fault(f"{' '.join(words)[:60]!r} is no array{of}")
        _add(walk, words[0], words[3], (n_found, walk.count(words, 1)), fields)


def _add(walk: _Walk, name: str, kind: str, shape: tuple[int, int], fields: dict[str, Array]) -> None:
    if name in fields or shape[1] == 0:
        raise walk.fault(f"field {name[:24]} stands twice, or has no values")
    values = walk.values(shape[0] * shape[1], kind)
    fields[name] = values if shape[1] == 1 else values.reshape(shape)
