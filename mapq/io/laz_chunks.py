"""Whether the chunks of a LAZ file hold what they promise, before its decompressor takes memory for them.

LAZ is cut into chunks that can be decoded each by itself. A table behind them says how long each is; from point format
6 on a chunk is made of layers, one a dimension, and begins with their lengths. The decompressor believes both.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, BinaryIO

from prf.shell.errors import InputError

if TYPE_CHECKING:
    from laspy import LasHeader

POINT14, RGB14, RGBNIR14, WAVE14, BYTES14 = 10, 11, 12, 13, 14
"""Items of a record, by their numbers in the laszip record."""
LAYERS = {POINT14: 9, RGB14: 1, RGBNIR14: 2, WAVE14: 1}
"""Layers of an item; extra bytes have one each."""

CHUNKED = (2, 3)
"""Compressors that cut points into chunks."""


def check_chunks(stream: BinaryIO, header: LasHeader, source: str) -> int:
    """Return how many points the largest chunk of a LAZ file may have; leaves the stream anywhere.

    Parameters
    ----------
    stream : file
        Seekable.
    header : LasHeader
        Of compressed points.
    source : str
        Name of the file, for messages.

    Raises
    ------
    InputError
        If chunks are longer or fewer than the file and its header say.
    """
    import lazrs  # noqa: PLC0415 - with laspy, when there is a LAZ to read

    record = bytes(header.vlrs.get("LasZipVlr")[0].record_data)
    (compressor,) = struct.unpack_from("<H", record)
    items = _items(record)
    length = sum(size for _, size in items)
    start = int(header.offset_to_point_data)
    if length != header.point_format.size or compressor not in CHUNKED:
        raise _damaged(source, "its compression is not known, or of points of another length")
    table = _table_place(stream, start, source)
    stream.seek(table + 4)
    (n_chunks,) = struct.unpack("<I", stream.read(4))
    if n_chunks > (table - start - 8) // length + 1:
        raise _damaged(source, f"{n_chunks} chunks do not fit into {table - start} bytes")
    stream.seek(start)
    chunks: Sequence[tuple[int, int]] = lazrs.read_chunk_table(stream, lazrs.LazVlr(record)) or ()
    if sum(size for _, size in chunks) > table - start - 8:
        raise _damaged(source, "its chunks are longer than the file")
    if sum(count for count, _ in chunks) < header.point_count:
        raise InputError(
            f"{source}: cut off: {header.point_count} points are promised, its {n_chunks} chunks hold fewer. Copy or "
            f"download the file again."
        )
    n_layers = sum(LAYERS.get(kind, size if kind == BYTES14 else 0) for kind, size in items)
    if n_layers:
        _check_layers(stream, start + 8, _needed(chunks, header.point_count), (length, n_layers), source)
    return max((count for count, _ in chunks), default=0)


def _items(record: bytes) -> list[tuple[int, int]]:
    """Return type and length of each item that a compressed record is made of."""
    (n_items,) = struct.unpack_from("<H", record, 32)
    return [struct.unpack_from("<HH", record, 34 + 6 * number) for number in range(n_items)]


def _table_place(stream: BinaryIO, start: int, source: str) -> int:
    """Return where the table of chunks is; programs that cannot go back write that at the end of the file."""
    end = stream.seek(0, 2)
    for where in (start, end - 8):
        stream.seek(where)
        head = stream.read(8)
        place = struct.unpack("<q", head)[0] if len(head) == 8 else -1
        if place != -1:
            break
    if not start + 8 <= place <= end - 8:
        raise _damaged(source, "the table of its chunks is not in the file")
    return int(place)


def _needed(chunks: Sequence[tuple[int, int]], n_points: int) -> Iterator[tuple[int, int]]:
    """Give points and bytes of the chunks that the points of a file are read from, which are not always all."""
    for count, size in chunks:
        if n_points <= 0:
            return
        yield count, size
        n_points -= count


def _check_layers(
    stream: BinaryIO, start: int, chunks: Iterable[tuple[int, int]], record: tuple[int, int], source: str
) -> None:
    """Refuse a chunk that is not as long as its layers; `record` is the length of a point and its number of layers.

    A decompressor that reads one chunk after the other would take what follows for the lengths of the next layers.
    """
    length, n_layers = record
    for number, (count, size) in enumerate(chunks):
        stream.seek(start + length)
        head = stream.read(4 + 4 * n_layers)
        sizes = struct.unpack(f"<{n_layers}I", head[4:]) if len(head) == 4 + 4 * n_layers else ()
        is_empty = count == size == 0
        if not is_empty and (not sizes or length + len(head) + sum(sizes) != size):
            raise _damaged(source, f"chunk {number} is not as long as its layers")
        start += size


def _damaged(source: str, what: str) -> InputError:
    return InputError(f"{source}: damaged: {what}. Copy or download the LAZ file again.")
