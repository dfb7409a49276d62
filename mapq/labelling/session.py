"""`label_by_hand`: from a PATCHES file to a page in the browser, and back to the file."""

from __future__ import annotations

import logging

import numpy as np

from mapq.features.compute import N_STEPS
from mapq.labelling.page import Page
from mapq.labelling.server import LabelServer
from mapq.labelling.store import open_store
from mapq.model import Model
from mapq.patches import Patches
from mapq.results.result import Result, assess
from prf.shell.cli.console import progress
from prf.shell.cli.run import graceful_stop
from prf.shell.cli.server import LOOK, running
from prf.shell.errors import ConfigError, InputError

logger = logging.getLogger(__name__)


def label_by_hand(path: str, model: Model | None = None, port: int = 0, browser: bool = True) -> dict[str, int]:
    """Serve the labelling page of a PATCHES file until it is finished or a signal arrives, and store the labels in it.

    Returned is how many patches there are, and how many a person or a field has labelled (:meth:`Store.counts`).

    Parameters
    ----------
    path : str
    model : Model, optional
        By which patches are uncertain; that of the package if absent.
    port : int
        0 takes a free one.
    browser : bool
        Open the page; its address is printed on standard error in any case.

    Raises
    ------
    InputError
        If `path` is not a PATCHES file, has no patches, or `model` cannot measure it.
    OutputError
        If another process labels it, or the labels cannot be stored in it; they are in its journal then.
    UsageError
        If the port is taken.
    Interrupted
        If a signal ended it; all labels are stored.
    """
    with open_store(path) as store:
        if not len(store.patches):
            raise InputError(f"{path}: there are no patches to label.")
        if store.n_recovered:
            logger.info("%s: labelling resumes after %d labels of an earlier session", path, store.n_recovered)
        server = LabelServer(Page(store, _assessed(store.patches, model, path)), port)
        with graceful_stop() as flag:
            words = "Ctrl-C ends, every label is kept as it is set; labelling page"
            with running(server, words, browser):
                while not flag.requested and not server.done.wait(LOOK):
                    pass
            store.merge()
            counts = store.counts()
            flag.raise_if_requested(f"labelling was stopped; all {counts['n_by_hand']} labels are in {path}")
        return counts


def _assessed(patches: Patches, model: Model | None, path: str) -> Result | None:
    """Return the result of a model; None where that of the package cannot judge these patches."""
    with progress(N_STEPS, "measuring") as reporter:
        try:
            result = assess(patches, model, reporter)
        except (InputError, ConfigError) as error:
            if model is not None:
                raise
            logger.warning("%s: no probabilities (%s) The largest patches are first.", path, error)
            return None
    return result if np.isfinite(result.labelling.probability).any() else None
