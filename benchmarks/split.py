"""Parting a map by place, with a buffer: neighbours share their errors, so random patches would leak."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from prf.shell.errors import InputError


class Parts(NamedTuple):
    """A map parted by a straight strip across x (axis 0) or y (1), which begins and ends there, world metres.

    `n_dropped` counts the points in it, and points without coordinates.
    """

    train: PointCloud
    test: PointCloud
    axis: int
    strip: tuple[float, float]
    n_dropped: int


def split_by_place(cloud: PointCloud, share: float, buffer: float, axis: int | None = None) -> Parts:
    """Part a map into two pieces with an empty strip between them.

    Parameters
    ----------
    cloud : PointCloud
    share : float
        Of the points outside the strip that go to the test part, about: between 0 and 1, the far end of the axis.
    buffer : float
        Metres: width of the strip.
    axis : {0, 1}, optional
        Across which axis to cut; None: that along which the middle 98 % of the points reach farther.

    Raises
    ------
    InputError
        If a part would be empty.
    """
    finite = cloud.finite()
    if not finite.any():
        raise InputError(f"{cloud.source or 'the map'}: no point to part.")
    low, high = np.quantile(cloud.xyz[finite, :2], (0.01, 0.99), axis=0)
    across = int(np.argmax(high - low)) if axis is None else axis
    place = np.where(finite, cloud.xyz[:, across], np.nan)
    begin = _strip(np.sort(place[finite]), share, buffer)
    with np.errstate(invalid="ignore"):
        is_train, is_test = place < begin, place > begin + buffer
    if not (is_train.any() and is_test.any()):
        raise InputError(
            f"{cloud.source or 'the map'}: {high[across] - low[across]:.3g} m long, a buffer of {buffer:g} m leaves no "
            f"two parts. Lower the buffer."
        )
    shift = float(cloud.shift[across] * cloud.unit[across])
    strip = (begin + shift, begin + buffer + shift)
    n_dropped = len(cloud) - int(np.count_nonzero(is_train)) - int(np.count_nonzero(is_test))
    return Parts(cloud.take(is_train), cloud.take(is_test), across, strip, n_dropped)


def _strip(sorted_place: NDArray[np.float64], share: float, buffer: float) -> float:
    """Return where the strip begins, so that about `share` of the points outside it lie beyond it."""
    candidates = np.quantile(sorted_place, np.linspace(0.0, 1.0, 201))
    before = np.searchsorted(sorted_place, candidates, side="left")
    beyond = len(sorted_place) - np.searchsorted(sorted_place, candidates + buffer, side="right")
    with np.errstate(invalid="ignore", divide="ignore"):
        miss = np.abs(beyond / (before + beyond) - share)
    miss[(before == 0) | (beyond == 0)] = np.inf
    return float(candidates[int(np.argmin(miss))])
