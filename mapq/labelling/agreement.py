"""How far two people agree who labelled the same patches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.io.journal import fingerprint
from mapq.patches import FROM_HAND, PLAUSIBLE, SUSPICIOUS, UNLABELLED, Patches
from prf.shell.errors import InputError

LEVELS = (0.025, 0.975)
"""Quantiles at which a 95 % interval ends."""
N_DRAWS = 50_000

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
        95 %, of the posterior under Jeffreys' prior.
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

    The interval is that of the posterior of kappa, the shares of the four cells having Jeffreys' prior, and holds kappa
    itself: it stays within -1 and 1, and says something of few patches and of perfect agreement, where the usual
    standard error is 0. Cohen 1960, A Coefficient of Agreement for Nominal Scales.
    """
    n = int(confusion.sum())
    kappa = float(_kappa(confusion / max(n, 1)))
    if np.isnan(kappa):
        return kappa, (np.nan, np.nan)
    drawn = np.random.default_rng(0).dirichlet(confusion.ravel() + 0.5, N_DRAWS).reshape(-1, 2, 2)
    low, high = np.quantile(_kappa(drawn), LEVELS).tolist()
    return kappa, (min(low, kappa), max(high, kappa))


def _kappa(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return kappa (...) of tables (..., 2, 2) of shares; nan where both call all the same, or there are none."""
    chance = (shares.sum(axis=-1) * shares.sum(axis=-2)).sum(axis=-1)
    agreed = np.trace(shares, axis1=-2, axis2=-1)
    is_defined = (chance > 0.0) & (chance < 1.0)
    return np.asarray(np.where(is_defined, (agreed - chance) / np.where(is_defined, 1.0 - chance, 1.0), np.nan))
