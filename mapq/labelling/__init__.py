"""Labels set by hand: a page on this machine."""

from __future__ import annotations

from mapq.labelling.session import label_by_hand
from mapq.labelling.store import Store, open_store

__all__ = ["Store", "label_by_hand", "open_store"]
