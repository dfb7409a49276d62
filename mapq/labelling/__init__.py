"""Labels set by hand: a page on this machine, and how far two people agree."""

from __future__ import annotations

from mapq.labelling.agreement import Agreement, compare_labels
from mapq.labelling.session import HandCounts, label_by_hand
from mapq.labelling.store import Store, open_store

__all__ = ["Agreement", "HandCounts", "Store", "compare_labels", "label_by_hand", "open_store"]
