"""Where chains agree: shares of the ground, and the places where they differ most."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

DIFFERS = 0.2
"""Two chains differ at a cell if their shares of black do by more than this."""
MOST_PLACES = 3


class Place(NamedTuple):
    """Connected cells at which chains differ: the cell of it nearest its middle, its area, the largest difference."""

    x: float  # metres
    y: float  # metres
    area: float  # square metres
    difference: float  # of shares of black, from 0 to 1


class Agreement(NamedTuple):
    """Where chains agree."""

    # share of the ground that readings saw at which no two chains differ by more than `DIFFERS`;
    # nan where there is no such ground, or nothing to compare
    seen: float
    unseen: float  # the same of the ground that no reading saw
    places: list[Place]  # on seen ground, largest area first; at most three

    def words(self) -> str:
        """Return the share of seen ground on which chains agree and where they differ most; empty if not known."""
        if math.isnan(self.seen):
            return ""
        share = f"chains agree on {math.floor(100.0 * self.seen)} % of the seen ground"
        where = ", ".join(f"({place.x:.1f}, {place.y:.1f})" for place in self.places)
        return f"{share}; they differ most round {where}" if where else share

    def document(self) -> dict[str, Any]:
        """Return it as JSON; an unknown share is null."""
        shares = {"seen": self.seen, "unseen": self.unseen}
        known = {name: None if math.isnan(share) else round(share, 4) for name, share in shares.items()}
        return {**known, "places": [[round(value, 3) for value in place] for place in self.places]}

    @classmethod
    def of_document(cls, content: Mapping[str, Any]) -> Agreement:
        """Return what :meth:`document` wrote."""
        seen, unseen = (math.nan if content[name] is None else float(content[name]) for name in ("seen", "unseen"))
        return cls(seen, unseen, [Place(*place) for place in content["places"]])


def agreement(
    disagreement: NDArray[np.float32], seen: NDArray[np.bool_], origin: NDArray[np.float64], resolution: float
) -> Agreement:
    """Return where chains agree; `disagreement` (ny, nx), `seen` (ny, nx), `origin` (2,)."""
    known, differs = np.isfinite(disagreement), disagreement > DIFFERS
    seen_share, unseen_share = (
        float(1.0 - differs[part].mean()) if part.any() else math.nan for part in (known & seen, known & ~seen)
    )
    return Agreement(seen_share, unseen_share, _places(disagreement, differs & seen, origin, resolution))


def _places(
    disagreement: NDArray[np.float32], differs: NDArray[np.bool_], origin: NDArray[np.float64], resolution: float
) -> list[Place]:
    """Return the largest sets of cells connected along their sides."""
    from scipy import ndimage  # noqa: PLC0415 - a fifth of a second

    label, _ = ndimage.label(differs)
    size = np.bincount(label.ravel())
    largest = 1 + np.argsort(-size[1:], kind="stable")[:MOST_PLACES]
    places = []
    for number in largest.tolist():
        cells = np.argwhere(label == number)
        middle = cells[np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1))]
        x, y = origin + (middle[::-1] + 0.5) * resolution
        most = float(disagreement[label == number].max())
        places.append(Place(float(x), float(y), float(size[number] * resolution**2), most))
    return places
