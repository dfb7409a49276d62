"""`Store`: the labels of one PATCHES file while a person sets them; none is lost, however the program ends."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mapq.io.content import Content
from mapq.io.journal import Event, Journal, fingerprint, journal_beside, read_journal, replay
from mapq.io.patches import parse_stored, read_patches, write_patches
from mapq.labels import FROM_FIELD, FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.patches import Patches
from prf.shell.cli.files import open_input
from prf.shell.cli.outputs import exclusive, refuse_existing
from prf.shell.errors import OutputError

T = TypeVar("T")

NOTHING_YET = np.uint8(254)
"""The page's code of a patch that nobody has looked at; ``NOTHING`` of label.js is the same number."""


class Store:
    """Labels of a PATCHES file, one writer at a time; made by :func:`open_store`.

    Parameters
    ----------
    path : str

    Attributes
    ----------
    patches : Patches
        As the file has them.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._stamp = _stamp(path)
        self.patches = parse_stored(Content(path).data(), path)
        self._journal = Journal(path, self.patches)
        self._now = replay(self.patches, self._journal.events)
        self._is_open = True

    @property
    def label(self) -> NDArray[np.uint8]:
        """Present labels (m,)."""
        return self._now.label

    @property
    def source(self) -> NDArray[np.uint8]:
        """Source of each label (m,)."""
        return self._now.source

    @property
    def can_undo(self) -> bool:
        """Whether there is a label to take back."""
        return bool(self._now.undoable)

    @property
    def n_recovered(self) -> int:
        """Events that a session left which did not end in good order; read it before the first label."""
        return len(self._journal.events)

    def set(self, patch: int, label: int) -> None:
        """Set the label of a patch, `UNLABELLED` for unsure; on return it is on the disk."""
        if not 0 <= patch < len(self.patches) or label not in (PLAUSIBLE, SUSPICIOUS, UNLABELLED):
            raise IndexError(patch)
        self._add(Event(patch, label))

    def undo(self) -> int | None:
        """Take back the last label, and return its patch; None if there is none."""
        with self._lock:
            patch = self._now.undoable[-1][0] if self._now.undoable else None
        if patch is not None:
            self._add(Event(patch, None))
        return patch

    def _add(self, event: Event) -> None:
        with self._lock:
            if not self._is_open:
                raise OutputError(f"{self.path}: labelling has ended.")
            self._journal.add(event)
            self._now.apply(event)

    def by_hand(self) -> NDArray[np.uint8]:
        """Return a person's judgement of each patch (m,): a label, `UNLABELLED` for unsure, or `NOTHING_YET`."""
        return np.where(self.source == FROM_HAND, self.label, NOTHING_YET)

    def counts(self) -> dict[str, int]:
        """Return how many patches there are, and how many have which label of a person."""
        said = self.by_hand()
        kinds = (("n_plausible", PLAUSIBLE), ("n_suspicious", SUSPICIOUS), ("n_unsure", UNLABELLED))
        counts = {name: int(np.count_nonzero(said == kind)) for name, kind in kinds}
        from_field = int(np.count_nonzero(self.source == FROM_FIELD))
        return {"n_patches": len(said), "n_by_hand": sum(counts.values()), **counts, "n_from_field": from_field}

    def merge(self) -> None:
        """Write the labels into PATCHES, whole or not at all, and remove the journal; later labels are refused."""
        with self._lock:
            self._is_open = False
            if self._journal.events:
                patches = self._as_it_is_now()
                found = replay(patches, self._journal.events)
                write_patches(self.path, replace(patches, label=found.label, label_source=found.source))
            self._journal.remove()

    def _as_it_is_now(self) -> Patches:
        """Return what the file holds, read again if another program wrote it."""
        if _stamp(self.path) == self._stamp:
            return self.patches
        patches = parse_stored(Content(self.path).data(), self.path)
        if fingerprint(patches) != fingerprint(self.patches):
            raise OutputError(
                f"{self.path} was replaced by other patches while it was labelled. The labels are in "
                f"{self._journal.file}; move it out of the way to label the new ones."
            )
        return patches


@contextmanager
def open_store(path: str) -> Iterator[Store]:
    """Hold the labels of a PATCHES file for this process, as long as the block lasts."""
    with open_input(path):
        pass
    refuse_existing(path, force=True)
    with exclusive(path):
        yield Store(path)


def relabel(path: str, rule: Callable[[Patches], tuple[Patches, T]]) -> T:
    """Hold a PATCHES file while a rule replaces its labels, and return what the rule returns beside the patches.

    The rule is given the labels of the journal too; these are in PATCHES then, and the journal is removed.
    """
    with open_input(path):
        pass
    with exclusive(path):
        patches, journal = read_patches(path), journal_beside(path)
        is_ours = journal.is_file() and read_journal(journal)[0] in ("", fingerprint(patches))
        labelled, found = rule(patches)
        write_patches(path, labelled)
        if is_ours:
            journal.unlink()
    return found


def _stamp(path: str) -> tuple[int, int, int]:
    """Return what changes when a file is replaced or written."""
    state = os.stat(path)
    return state.st_ino, state.st_size, state.st_mtime_ns
