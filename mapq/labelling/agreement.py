"""How far two people agree who labelled the same patches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import xlogy

from mapq.io.journal import fingerprint
from mapq.patches import FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED, Patches
from prf.shell.errors import InputError

DROP = 1.920729410347062
"""Nats below the best at which a 95 % interval ends: half the quantile of chi-squared with one degree."""
GRID = 41
N_ZOOMS = 5
N_HALVINGS = 24

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Agreement:
    """What two label files have in common.

    Attributes
    ----------
    n_patches : int
    n_common : int
        Patches that both call plausible or suspicious.
    n_unsure : (int, int)
        Patches of which each file says unsure.
    by_hand : (bool, bool)
        Whether each file's labels were set by hand, or come from a field of the points.
    confusion : (2, 2) int64
        Rows the first file, columns the second, plausible first.
    agreement : float
        Share of the common patches; nan of none.
    kappa : float
        Cohen's: 1 is perfect, 0 what chance gives; nan where both say one and the same of every patch.
    interval : (float, float)
        95 %, by profile likelihood.
    disagreeing : (k,) int64
        Patches of different labels, the largest first.
    first_says : (k,) uint8
        What the first file says of them; the second says the other.
    """

    n_patches: int
    n_common: int
    n_unsure: tuple[int, int]
    by_hand: tuple[bool, bool]
    confusion: Counts
    agreement: float
    kappa: float
    interval: tuple[float, float]
    disagreeing: NDArray[np.int64]
    first_says: NDArray[np.uint8]

    def content(self) -> dict[str, Any]:
        """Return the agreement as JSON; its numbers that do not exist are nan."""
        names = ("plausible", "suspicious")
        return {
            "n_patches": self.n_patches,
            "n_common": self.n_common,
            "n_unsure": list(self.n_unsure),
            "labels": ["by hand" if hand else "from a field" for hand in self.by_hand],
            "agreement": self.agreement,
            "kappa": self.kappa,
            "kappa_interval": list(self.interval),
            "confusion": self.confusion,
            "disagreeing": [
                {"patch": int(patch), "first": names[first], "second": names[1 - first]}
                for patch, first in zip(self.disagreeing, self.first_says.tolist(), strict=True)
            ],
        }


def compare_labels(first: Patches, second: Patches, names: tuple[str, str]) -> Agreement:
    """Return how far the labels of two files agree.

    Labels set by hand count; of a file without any, those from a field.

    Raises
    ------
    InputError
        If the files do not hold the same patches, or one has no labels; `names` are theirs.
    """
    if fingerprint(first) != fingerprint(second):
        raise InputError(
            f"{names[0]} and {names[1]} hold different patches. Segment once, and label copies of the file."
        )
    said, by_hand = zip(
        *(_said(patches, name) for patches, name in zip((first, second), names, strict=True)), strict=True
    )
    known = [np.isin(each, (PLAUSIBLE, SUSPICIOUS)) for each in said]
    common = known[0] & known[1]
    confusion = np.bincount(2 * said[0][common].astype(np.int64) + said[1][common], minlength=4).reshape(2, 2)
    differ = np.flatnonzero(common & (said[0] != said[1]))
    differ = differ[np.argsort(-first.counts[differ], kind="stable")]
    kappa, interval = cohen_kappa(confusion)
    n_common = int(common.sum())
    return Agreement(
        len(first),
        n_common,
        (_n_unsure(first), _n_unsure(second)),
        (by_hand[0], by_hand[1]),
        confusion,
        float(np.trace(confusion)) / n_common if n_common else float("nan"),
        kappa,
        interval,
        differ,
        said[0][differ],
    )


def _said(patches: Patches, name: str) -> tuple[NDArray[np.uint8], bool]:
    by_hand = patches.label_source == FROM_HAND
    said = np.where(by_hand, patches.label, UNLABELLED) if by_hand.any() else patches.label
    if (said == UNLABELLED).all():
        raise InputError(f"{name}: no patch has a label. Label it with mapq label.")
    return said, bool(by_hand.any())


def _n_unsure(patches: Patches) -> int:
    return int(np.count_nonzero((patches.label_source == FROM_HAND) & (patches.label == UNLABELLED)))


def cohen_kappa(confusion: Counts) -> tuple[float, tuple[float, float]]:
    """Return Cohen's kappa of a table (2, 2) of counts and its 95 % interval, nan where it is not defined.

    The interval holds every kappa whose log-likelihood, maximised over the base rates of both, is at most `DROP` below
    the best (profile likelihood): it stays within -1 and 1, and says something of few patches and of perfect agreement,
    where the usual standard error is 0. Cohen 1960, A Coefficient of Agreement for Nominal Scales.
    """
    n = int(confusion.sum())
    rows, columns = confusion.sum(axis=1) / max(n, 1), confusion.sum(axis=0) / max(n, 1)
    chance = float(rows @ columns)
    if n == 0 or chance == 1.0:
        return float("nan"), (float("nan"), float("nan"))
    kappa = (float(np.trace(confusion)) / n - chance) / (1.0 - chance)
    best = float(xlogy(confusion, confusion / n).sum())
    return kappa, (_end(confusion, kappa, -1.0, best), _end(confusion, kappa, 1.0, best))


def _end(confusion: Counts, inside: float, outside: float, best: float) -> float:
    """Return where the profile log-likelihood falls `DROP` below the best, between kappa and an end of its range."""
    if best - _profile(confusion, outside) <= DROP:
        return outside
    for _ in range(N_HALVINGS):
        middle = 0.5 * (inside + outside)
        if best - _profile(confusion, middle) <= DROP:
            inside = middle
        else:
            outside = middle
    return 0.5 * (inside + outside)


def _profile(confusion: Counts, kappa: float) -> float:
    """Return the largest log-likelihood of any base rates under a given kappa, on a grid that is refined."""
    low, high = np.full(2, 1e-6), np.full(2, 1.0 - 1e-6)
    found = -np.inf
    for _ in range(N_ZOOMS):
        a, b = (np.linspace(low[axis], high[axis], GRID) for axis in range(2))
        values = _log_likelihood(confusion, kappa, a[:, None], b[None, :])
        place = np.unravel_index(int(np.argmax(values)), values.shape)
        found = max(found, float(values[place]))
        step, middle = (high - low) / (GRID - 1), np.array([a[place[0]], b[place[1]]])
        low, high = np.maximum(middle - 2.0 * step, 1e-9), np.minimum(middle + 2.0 * step, 1.0 - 1e-9)
    return found


def _log_likelihood(
    confusion: Counts, kappa: float, a: NDArray[np.float64], b: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the log-likelihood (k, k) of a table, a and b being the shares that either calls suspicious.

    kappa = 2 D / (a (1 - b) + b (1 - a)), D the covariance of the two labels; -inf where a cell is negative.
    """
    covariance = 0.5 * kappa * (a * (1.0 - b) + b * (1.0 - a))
    cells = (
        (1.0 - a) * (1.0 - b) + covariance,
        (1.0 - a) * b - covariance,
        a * (1.0 - b) - covariance,
        a * b + covariance,
    )
    total = np.zeros(np.broadcast(a, b).shape)
    for count, cell in zip(confusion.ravel().tolist(), cells, strict=True):
        cell = np.where(np.abs(cell) < 1e-15, 0.0, cell)
        with np.errstate(divide="ignore"):
            total += np.where(cell < 0.0, -np.inf, xlogy(count, np.maximum(cell, 0.0)))
    return total
