"""The journal beside a PATCHES file: labels set by hand that are not in it yet, a line each; docs/file-formats.md.

A label is on the disk before the page that set it is answered, without a cloud of a gigabyte being written anew.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.patches import FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED, Patches
from prf.shell.errors import InputError, cannot_write
from prf.shell.files import open_input
from prf.shell.storage import check_schema, damaged

logger = logging.getLogger(__name__)

SCHEMA = "mapq.labels/1"
SUFFIX = ".labels.jsonl"

WORDS = {"plausible": PLAUSIBLE, "suspicious": SUSPICIOUS, "unsure": UNLABELLED}
"""Labels as a person sets them; an unsure patch has no label, and was seen all the same."""
_WORD_OF = {value: word for word, value in WORDS.items()}

Labels = NDArray[np.uint8]


class Event(NamedTuple):
    """One line of a journal.

    Attributes
    ----------
    patch : int
    label : int or None
        `PLAUSIBLE`, `SUSPICIOUS`, or `UNLABELLED` for unsure; None takes back the last label that stands.
    """

    patch: int
    label: int | None

    def line(self) -> str:
        """Return the event as it stands in the journal, with the time."""
        what = {"undo": True} if self.label is None else {"label": _WORD_OF[self.label]}
        return json.dumps({"patch": self.patch, **what, "time": datetime.now(UTC).isoformat(timespec="seconds")}) + "\n"


class Replayed(NamedTuple):
    """Labels after a journal.

    Attributes
    ----------
    label, source : (m,) uint8
        As in :class:`mapq.patches.Patches`.
    undoable : list of (int, int, int)
        Patch, and the label and source that it had before; the last one is undone first.
    """

    label: Labels
    source: Labels
    undoable: list[tuple[int, int, int]]

    def apply(self, event: Event) -> None:
        """Take up one event, in place."""
        if event.label is None:
            if self.undoable:
                patch, self.label[patch], self.source[patch] = self.undoable.pop()
            return
        self.undoable.append((event.patch, int(self.label[event.patch]), int(self.source[event.patch])))
        self.label[event.patch], self.source[event.patch] = event.label, FROM_HAND


def journal_beside(path: str | os.PathLike[str]) -> Path:
    """Return the name of the journal of the PATCHES file `path`."""
    file = Path(os.path.realpath(path))
    return file.with_name(file.name + SUFFIX)


def fingerprint(patches: Patches) -> str:
    """Return what tells one segmentation from another: a digest of every point's patch and of where patches lie."""
    digest = hashlib.sha256(f"{len(patches)} ".encode())
    digest.update(np.ascontiguousarray(patches.patch, "<i4").data)
    digest.update(np.ascontiguousarray(patches.centroid, "<f8").data)
    return digest.hexdigest()


def replay(patches: Patches, events: Iterable[Event]) -> Replayed:
    """Return the labels of patches after the events of a journal."""
    replayed = Replayed(patches.label.copy(), patches.label_source.copy(), [])
    for event in events:
        replayed.apply(event)
    return replayed


def with_journal(patches: Patches, path: str | os.PathLike[str]) -> Patches:
    """Return the patches of the file `path` with the labels of the journal beside it, if there is one.

    The journal of another segmentation is left alone, with a warning.

    Raises
    ------
    InputError
        If the journal is damaged, or of another version.
    """
    journal = journal_beside(path)
    if not journal.is_file():
        return patches
    mark, events = read_journal(journal, len(patches))
    if mark != fingerprint(patches):
        logger.warning("%s belongs to other patches than %s now holds: its labels are not used", journal, path)
        return patches
    found = replay(patches, events)
    return replace(patches, label=found.label, label_source=found.source)


def read_journal(journal: Path, n_patches: int) -> tuple[str, list[Event]]:
    """Return the fingerprint in a journal, and its events; a last line that is cut off was never confirmed.

    Raises
    ------
    InputError
        If it cannot be read, is damaged, or of another version.
    """
    with open_input(journal) as stream:
        lines = stream.read().decode("utf-8", "replace").split("\n")[:-1]
    if not lines:
        return "", []
    head = _object(journal, 1, lines[0])
    check_schema(journal, str(head.get("schema", "")), SCHEMA)
    events = []
    for number, line in enumerate(lines[1:], start=2):
        row = _object(journal, number, line)
        patch, label = _number(row.get("patch")), WORDS.get(str(row.get("label")))
        if not 0 <= patch < max(n_patches, 1) or (label is None and "undo" not in row):
            if head.get("n_patches") == n_patches:
                raise damaged(journal, f"line {number} is no label of a patch")
            continue
        events.append(Event(patch, None if "undo" in row else label))
    return str(head.get("fingerprint", "")), events


def _number(value: object) -> int:
    """Return a value that is a whole number, else -1; truth values are numbers to Python."""
    return value if isinstance(value, int) and not isinstance(value, bool) else -1


def _object(journal: Path, number: int, line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):  # whole numbers or nesting without end too
        found = None
    if not isinstance(found, dict):
        raise damaged(journal, f"line {number} is no JSON object")
    return found


class Journal:
    """A journal that events are added to; the caller holds the lock of the PATCHES file.

    Parameters
    ----------
    path : path
        The PATCHES file.
    patches : Patches
        What it holds.

    Attributes
    ----------
    events : list of Event
        Of this session and of those that ended without being merged.

    Raises
    ------
    InputError
        If there is a journal that is damaged, or belongs to other patches.
    OutputError
        If it cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], patches: Patches) -> None:
        self.file = journal_beside(path)
        self.events: list[Event] = []
        mark = fingerprint(patches)
        self._head = {
            "schema": SCHEMA,
            "patches": Path(path).name,
            "n_patches": len(patches),
            "fingerprint": mark,
        }
        if self.file.is_file():
            found, self.events = read_journal(self.file, len(patches))
            if found not in ("", mark):
                raise InputError(f"{self.file}: labels of other patches than {path} now holds. Move it out of the way.")
            self._cut_torn_line()

    def _cut_torn_line(self) -> None:
        """Take away what a killed writer left after the last whole line."""
        with open_input(self.file) as stream:
            content = stream.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            os.truncate(self.file, whole)

    def add(self, event: Event) -> None:
        """Write an event to the disk, whole or not at all.

        Raises
        ------
        OutputError
            If it cannot be written; the journal is as it was.
        """
        is_new = not self.file.exists() or self.file.stat().st_size == 0
        text = (json.dumps(self._head) + "\n" if is_new else "") + event.line()
        try:
            descriptor = os.open(self.file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
            try:
                _append(descriptor, text.encode())
            finally:
                os.close(descriptor)
            if is_new:
                _sync_folder(self.file.parent)
        except OSError as error:
            raise cannot_write(self.file, error) from error
        self.events.append(event)

    def remove(self) -> None:
        """Remove the journal: its labels stand in PATCHES."""
        self.file.unlink(missing_ok=True)
        self.events.clear()


def _append(descriptor: int, data: bytes) -> None:
    """Write at the end of a file and onto the disk; on an error the file is cut to what it was."""
    before = os.fstat(descriptor).st_size
    try:
        while data:
            data = data[os.write(descriptor, data) :]
        os.fsync(descriptor)
    except OSError:
        os.ftruncate(descriptor, before)
        raise


def _sync_folder(folder: Path) -> None:
    """Make the name of a new file last through a power cut too."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
