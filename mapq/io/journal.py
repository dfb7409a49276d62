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

from mapq.io.content import damage_in_one_line
from mapq.labels import FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.patches import Patches
from prf.shell.cli.files import open_input
from prf.shell.cli.storage import check_schema
from prf.shell.errors import InputError, cannot_write

logger = logging.getLogger(__name__)

SCHEMA = "mapq.labels/1"
SUFFIX = ".labels.jsonl"

WORDS = {"plausible": PLAUSIBLE, "suspicious": SUSPICIOUS, "unsure": UNLABELLED}
"""Labels as a person sets them; an unsure patch has no label, but was seen."""


class Event(NamedTuple):
    """One line of a journal: the label of a patch, `UNLABELLED` for unsure; None undoes the last label."""

    patch: int
    label: int | None

    def line(self) -> str:
        """Return the event as it is written, with the time."""
        word = next((word for word, label in WORDS.items() if label == self.label), None)
        what = {"undo": True} if word is None else {"label": word}
        return json.dumps({"patch": self.patch, **what, "time": datetime.now(UTC).isoformat(timespec="seconds")}) + "\n"


class Replayed(NamedTuple):
    """Labels and their sources (m,) after a journal; `undoable` has patch, label and source before each label."""

    label: NDArray[np.uint8]
    source: NDArray[np.uint8]
    undoable: list[tuple[int, int, int]]

    def apply(self, event: Event) -> None:
        """Apply one event, in place."""
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
    """Return what identifies a segmentation: a digest of every point's patch and of the centroids."""
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

    The journal of another segmentation is ignored, with a warning.
    """
    journal = journal_beside(path)
    if not journal.is_file():
        return patches
    mark, events = read_journal(journal)
    if mark != fingerprint(patches):
        logger.warning("%s belongs to other patches than %s now holds: its labels are not used", journal, path)
        return patches
    with damage_in_one_line(str(journal)):
        found = replay(patches, events)
    return replace(patches, label=found.label, label_source=found.source)


def read_journal(journal: Path) -> tuple[str, list[Event]]:
    """Return the fingerprint in a journal, and its events; a last line that is cut off was never confirmed."""
    with open_input(journal) as stream:
        lines = stream.read().decode("utf-8", "replace").split("\n")[:-1]
    if not lines:
        return "", []
    with damage_in_one_line(str(journal)):
        head = dict(json.loads(lines[0]))
        check_schema(journal, str(head.get("schema", "")), SCHEMA)
        events = [_event(json.loads(line)) for line in lines[1:]]
    return str(head.get("fingerprint", "")), events


def _event(row: dict[str, Any]) -> Event:
    patch = int(row["patch"])
    if patch < 0:
        raise ValueError(f"patch {patch}")
    return Event(patch, None if "undo" in row else WORDS[row["label"]])


class Journal:
    """A journal beside a PATCHES file, of which the caller holds the lock, that events are added to.

    `events` are those of this session and of sessions that ended without being merged.
    """

    def __init__(self, path: str | os.PathLike[str], patches: Patches) -> None:
        self.file = journal_beside(path)
        self.events: list[Event] = []
        mark = fingerprint(patches)
        head = {"schema": SCHEMA, "patches": Path(path).name, "n_patches": len(patches), "fingerprint": mark}
        self._head = json.dumps(head) + "\n"
        if self.file.is_file():
            found, self.events = read_journal(self.file)
            if found not in ("", mark):
                raise InputError(f"{self.file}: labels of other patches than {path} now holds. Move it out of the way.")
            whole = self.file.read_bytes().rfind(b"\n") + 1  # a killed writer may have left more
            if whole < self.file.stat().st_size:
                os.truncate(self.file, whole)

    def add(self, event: Event) -> None:
        """Write an event to the disk, whole or not at all; OutputError if that fails."""
        is_new = not self.file.exists() or self.file.stat().st_size == 0
        text = (self._head if is_new else "") + event.line()
        try:
            _append(self.file, text.encode())
            if is_new:
                _sync(self.file.parent)
        except OSError as error:
            raise cannot_write(self.file, error) from error
        self.events.append(event)

    def remove(self) -> None:
        """Remove the journal, whose labels are in PATCHES."""
        self.file.unlink(missing_ok=True)
        self.events.clear()


def _append(file: Path, data: bytes) -> None:
    """Write at the end of a file and onto the disk; on an error the file is cut to its length before."""
    with file.open("ab", buffering=0) as stream:
        before = os.fstat(stream.fileno()).st_size
        try:
            while data:
                data = data[stream.write(data) :]
            os.fsync(stream.fileno())
        except OSError:
            os.ftruncate(stream.fileno(), before)
            raise


def _sync(folder: Path) -> None:
    """Make the name of a new file outlast a power cut too."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
