"""`Page`: the content of the labelling page, and its actions.

To label a patch a person needs to see it, its neighbours, and what lies about them.
"""

from __future__ import annotations

import threading
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.labelling.store import NOTHING_YET, Store
from mapq.labels import FROM_FIELD, NO_PATCH, UNLABELLED
from mapq.report.scene import VIEWS, build_scene
from mapq.results.reasons import Reason, Reasons, pair_words
from mapq.results.result import Result
from prf.shell.cli.page import escape, packed, page

MOST_NEIGHBOURS = 10
"""Of a patch: those that change its log-odds most, then the closest."""
MOST_POINTS = 24_000
"""Points of a view."""
N_REASONS = 3
"""Reasons shown for either label."""
MARGIN = 3.0
"""Metres around the patch that a view shows, at least; a third of its size if that is more."""
MOST_CONTEXT = 3_000_000
"""Points searched for what lies about a patch; of more, evenly spaced ones."""

SHAPES = ("n_points", "area_m2", "width_m", "height_m", "rms_m", "thickness_m", "tilt_deg")


class Page:
    """The labelling page of one PATCHES file.

    Parameters
    ----------
    store : Store
    result : Result, optional
        Of a model; without it the largest patch is first, and neighbours are the patches whose middles are closest.

    Attributes
    ----------
    policy : str
        Its content security policy.
    """

    def __init__(self, store: Store, result: Result | None) -> None:
        self._store, self._result = store, result
        self._lock = threading.Lock()
        self._patches = store.patches
        self._reasons = None if result is None else Reasons(result.features, result.terms)
        self._finite = np.flatnonzero(self._patches.cloud.finite())[
            :: -(-len(self._patches.cloud) // MOST_CONTEXT) or 1
        ]
        self._xyz = self._patches.cloud.xyz[self._finite]
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
        return len(self._patches)

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
        """Return a patch: its scene, its neighbours in the scene's order, its measures and reasons."""
        # One at a time: measuring shares caches that are filled on first use.
        with self._lock:
            return self._shown(patch)

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

    def _shown(self, patch: int) -> dict[str, Any]:
        neighbours = self._neighbours(patch)
        scene, content = self._scene([patch, *neighbours]).pack()
        world = self._patches.cloud.metric_of(self._patches.centroid[patch]).tolist()
        return {
            "patch": patch,
            "scene": scene,
            "content": packed(content),
            "neighbours": self._neighbour_rows(patch, neighbours),
            "measures": self._measures(patch),
            "normal": self._patches.normal[patch],
            "centre": world,
            **self._model_row(patch),
        }

    def _neighbours(self, patch: int) -> list[int]:
        """Return the neighbours shown with a patch, those of its reasons first, then the closest."""
        if self._result is None:
            far = np.linalg.norm(self._patches.centroid - self._patches.centroid[patch], axis=1)
            return [int(other) for other in np.argsort(far, kind="stable")[1 : MOST_NEIGHBOURS + 1] if other != patch]
        named = [reason.other for reason in self._largest_reasons(patch)]
        found = [other for other in dict.fromkeys(named) if other is not None]
        separation = self._result.features.edge_names.index("separation")
        pairs = self._pairs_of(patch)
        found += sorted(set(pairs) - set(found), key=lambda other: (pairs[other][separation], other))
        return found[:MOST_NEIGHBOURS]

    def _pairs_of(self, patch: int) -> dict[int, NDArray[np.float64]]:
        """Return the edge features of the pairs of a patch, by the other one; none without a model."""
        if self._result is None:
            return {}
        features = self._result.features
        rows = np.flatnonzero((features.pairs == patch).any(axis=1))
        return {int(features.pairs[row].sum()) - patch: features.edge[row] for row in rows}

    def _largest_reasons(self, patch: int) -> list[Reason]:
        """Return the reasons for suspicious, then those for plausible."""
        if self._reasons is None:
            return []
        return [reason for sign in (1.0, -1.0) for reason in self._reasons.of(patch, sign, N_REASONS)]

    def _scene(self, shown: list[int]) -> Any:
        patches = self._patches
        points, start = patches.members
        chosen = [points[start[each] : start[each + 1]] for each in shown]
        mine = patches.cloud.xyz[chosen[0]]
        margin = max(MARGIN, float((mine.max(axis=0) - mine.min(axis=0)).max()) / 3.0)
        low, high = mine.min(axis=0) - margin, mine.max(axis=0) + margin
        near = self._finite[((self._xyz >= low) & (self._xyz <= high)).all(axis=1)]
        near = near[~np.isin(patches.patch[near], shown)]
        index = np.concatenate([*chosen, near])
        group = np.repeat(np.arange(len(shown) + 1), [*map(len, chosen), len(near)])
        xyz, inside = patches.cloud.xyz[index], group == 0
        kept = inside | ((xyz >= low) & (xyz <= high)).all(axis=1)
        group = np.where(group == len(shown), NO_PATCH, group).astype(np.int32)[kept]
        return build_scene(xyz[kept], group, patches.normal[shown], np.zeros(len(shown), np.uint8), MOST_POINTS)

    def _measures(self, patch: int) -> dict[str, Any]:
        if self._result is None:
            return {"n_points": int(self._patches.counts[patch])}
        features = self._result.features
        shape = dict(zip(features.shape_names, features.shape[patch].tolist(), strict=True))
        return {name: shape[name] for name in SHAPES if name in shape}

    def _model_row(self, patch: int) -> dict[str, Any]:
        """Return the model's probability, label and reasons of a patch."""
        if self._result is None:
            return {"p": None, "model_label": None, "reasons": []}
        return {
            "p": float(self._result.labelling.probability[patch]),
            "model_label": int(self._result.labelling.label[patch]),
            "reasons": [[each.text, round(each.log_odds, 2), each.other] for each in self._largest_reasons(patch)],
        }

    def _neighbour_rows(self, patch: int, neighbours: list[int]) -> list[dict[str, Any]]:
        """Return the neighbours with how they lie to the patch, as far as that is known."""
        if self._result is None:
            return [{"patch": other, "text": "", "p": None} for other in neighbours]
        pairs, names = self._pairs_of(patch), self._result.features.edge_names
        rows = []
        for other in neighbours:
            words = pair_words(dict(zip(names, pairs[other].tolist(), strict=True)), other) if other in pairs else ""
            rows.append({"patch": other, "text": words, "p": float(self._result.labelling.probability[other])})
        return rows


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
