"""`Page`: the content of the labelling page, and its actions."""

from __future__ import annotations

import threading
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.labelling.around import Surroundings
from mapq.labelling.store import NOTHING_YET, Store
from mapq.labels import FROM_FIELD, UNLABELLED
from mapq.report.scene import VIEWS
from mapq.results.result import Result
from prf.shell.cli.page import escape, page


class Page:
    """The labelling page of one PATCHES file.

    Parameters
    ----------
    store : Store
    result : Result, optional
        Of a model; without it the largest patch is first.

    Attributes
    ----------
    policy : str
        Its content security policy.
    """

    def __init__(self, store: Store, result: Result | None) -> None:
        self._store, self._result = store, result
        self._lock = threading.Lock()
        self._around = Surroundings(store.patches, result)
        document, self.policy = page(
            "mapq.labelling",
            "label",
            {"title": escape(PurePath(store.path).name)},
            (*VIEWS, ("mapq.labelling", "label.js")),
            more="; connect-src 'self'; frame-ancestors 'none'",
        )
        self._document = document.encode()
        probability = None if result is None else result.labelling.probability
        self._order = most_uncertain_first(store.patches.counts, probability, store.label != UNLABELLED)

    @property
    def n_patches(self) -> int:
        """How many patches there are."""
        return len(self._store.patches)

    def document(self) -> bytes:
        """Return the page itself."""
        return self._document

    def state(self) -> dict[str, Any]:
        """Return the order of the patches, the label of each so far, and the progress."""
        return {
            "order": self._order,
            "said": self._store.by_hand(),
            "from_field": np.where(self._store.source == FROM_FIELD, self._store.label, NOTHING_YET),
            "has_model": self._result is not None,
            "threshold": None if self._result is None else self._cut(),
            **self._progress(),
        }

    def patch(self, patch: int) -> dict[str, Any]:
        """Return what is shown of a patch."""
        # One at a time: measuring shares caches that are filled on first use.
        with self._lock:
            return self._around.of(patch)

    def label(self, patch: int, label: int) -> dict[str, Any]:
        """Set a label, and return the progress; it is on the disk by then."""
        self._store.set(patch, label)
        return {"patch": patch, "said": label, **self._progress()}

    def undo(self) -> dict[str, Any]:
        """Take the last label back, and return its patch (None: there was none), what it has now, and the progress."""
        patch = self._store.undo()
        said = None if patch is None else int(self._store.by_hand()[patch])
        return {"patch": patch, "said": said, **self._progress()}

    def _progress(self) -> dict[str, Any]:
        return {"counts": self._store.counts(), "can_undo": self._store.can_undo}

    def _cut(self) -> float:
        assert self._result is not None
        return float(self._result.head()["threshold"]["p_suspicious"])


def most_uncertain_first(
    counts: NDArray[np.int64], probability: NDArray[np.floating] | None, has_label: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the patches (m,) in the order in which to label them.

    Parameters
    ----------
    counts : (m,) int64
        Points of each patch: of equally uncertain ones the larger is first.
    probability : (m,) float, optional
        That each is suspicious. A half is most uncertain; without probabilities the largest patch is first.
    has_label : (m,) bool
        Patches with a label are last.
    """
    doubt = np.zeros(len(counts)) if probability is None else np.abs(np.nan_to_num(probability, nan=0.5) - 0.5)
    return np.lexsort((-counts, doubt, has_label)).astype(np.int64)
