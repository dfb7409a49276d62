"""How well labels and probabilities agree with a truth: confusion matrix, scores, calibration."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from mapq import assess
from mapq.cloud import PointCloud
from mapq.io.result_folder import is_result_folder, open_result_folder
from mapq.io.results import RESULT_FIELDS
from mapq.labels import majority_labels, majority_of, truth_values, votes
from mapq.model import Model
from mapq.patches import NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED, Patches
from prf.shell.errors import InputError, UsageError

TRUTH_FIELD = "truth"
"""Point field that is taken for the truth where none is named."""
N_BINS = 10
"""Of the expected calibration error: equal steps of the probability."""


class Scores(NamedTuple):
    """How well labels agree with the truth; suspicious is positive, nan where a ratio has nothing to divide by."""

    n: int  # patches with a label and a truth
    n_without_truth: int  # patches left out because their truth is unknown
    # (int, int), (int, int) rows inferred, columns truth; plausible, then suspicious
    confusion: tuple[tuple[int, int], tuple[int, int]]
    accuracy: float  # recall is the share of suspicious patches that are called so, specificity that of plausible ones
    precision: float
    recall: float
    specificity: float
    f1: float
    mcc: float
    balanced_accuracy: float
    base_rate: float  # share of suspicious patches in truth
    ece: float  # expected calibration error: mean difference of probability and share of suspicious over `N_BINS` bins
    auc: float  # probability that a suspicious patch has a higher p than a plausible one, ties half
    # mean negative log-probability of the truth in nats, p within 1e-6 of 0 and 1 cut; mean squared error of p
    log_loss: float
    brier: float


class Bin(NamedTuple):
    """Patches of like probability."""

    low: float  # bounds of the probability
    high: float
    n: int
    # mean of the probability, and share that is suspicious in truth: alike where p can be trusted. nan without patches.
    p_suspicious: float
    suspicious: float


class Labelled(NamedTuple):
    """Inferred and true labels of patches."""

    label: NDArray[np.uint8]  # (m,) `UNLABELLED` where not known
    truth: NDArray[np.uint8]  # (m,)
    probability: NDArray[np.floating]  # (m,) of being suspicious
    truth_from: str  # source of the truth, for people


def score_labels(label: NDArray[np.uint8], truth: NDArray[np.uint8], probability: NDArray[np.floating]) -> Scores:
    """Return the scores of labels (m,) with probabilities (m,) against the truth (m,), 255 = not known."""
    known = (truth != UNLABELLED) & (label != UNLABELLED)
    inferred, true, p = label[known] == SUSPICIOUS, truth[known] == SUSPICIOUS, probability[known].astype(np.float64)
    counts = np.bincount(2 * inferred.astype(np.int64) + true, minlength=4).reshape(2, 2)
    (pp, ps), (sp, ss) = counts.tolist()
    recall, specificity = _ratio(ss, ps + ss), _ratio(pp, pp + sp)
    cut = np.clip(p, 1e-6, 1.0 - 1e-6)
    n = int(np.count_nonzero(known))
    return Scores(
        n=n,
        n_without_truth=int(np.count_nonzero((truth == UNLABELLED) & (label != UNLABELLED))),
        confusion=((pp, ps), (sp, ss)),
        accuracy=_ratio(pp + ss, n),
        precision=_ratio(ss, sp + ss),
        recall=recall,
        specificity=specificity,
        f1=_ratio(2 * ss, 2 * ss + ps + sp),
        mcc=_ratio(pp * ss - ps * sp, math.sqrt((pp + ps) * (sp + ss) * (pp + sp) * (ps + ss))),
        balanced_accuracy=0.5 * (recall + specificity),
        base_rate=_ratio(ps + ss, n),
        ece=calibration_error(p, true),
        auc=area_under_curve(p, true),
        log_loss=_ratio(-float(np.log(np.where(true, cut, 1.0 - cut)).sum()), n),
        brier=_ratio(float(((p - true) ** 2).sum()), n),
    )


def reliability(truth: NDArray[np.uint8], probability: NDArray[np.floating]) -> list[Bin]:
    """Return the reliability of probabilities (m,) against the truth (m,), 255 = not known, in `N_BINS` equal steps."""
    known = (truth != UNLABELLED) & np.isfinite(probability)
    p, true = probability[known].astype(np.float64), truth[known] == SUSPICIOUS
    bins = _bins(p)
    counts, means, shares = (np.bincount(bins, weight, N_BINS).tolist() for weight in (None, p, true))
    edges = np.linspace(0.0, 1.0, N_BINS + 1).tolist()
    rows = zip(edges[:-1], edges[1:], counts, means, shares, strict=True)
    return [Bin(low, high, int(n), _ratio(mean, n), _ratio(share, n)) for low, high, n, mean, share in rows]


def calibration_error(p: NDArray[np.float64], true: NDArray[np.bool_]) -> float:
    """Return the mean over patches (n,) of |mean p - share of suspicious| of the bin of p that each is in."""
    gaps = np.bincount(_bins(p), p - true, N_BINS)
    return _ratio(float(np.abs(gaps).sum()), len(p))


def _bins(p: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.minimum((p * N_BINS).astype(np.int64), N_BINS - 1)


def area_under_curve(p: NDArray[np.float64], true: NDArray[np.bool_]) -> float:
    """Return the area under the receiver operating characteristic (Mann-Whitney U over the number of pairs)."""
    n_true = int(np.count_nonzero(true))
    n_pairs = n_true * (len(true) - n_true)
    ranks = rankdata(p)
    return _ratio(float(ranks[true].sum()) - 0.5 * n_true * (n_true + 1), n_pairs)


def read_labelled(path: str, model: Model | None, truth_field: str | None) -> Labelled:
    """Return the inferred and true labels of the patches of a RESULT or PATCHES file.

    A result carries its labels, and one in tiles is read a piece at a time; PATCHES are classified with `model` (None:
    the one that ships with the package). The truth of a patch is that of most of its points in `truth_field`; without
    one it is the labels stored in PATCHES, else point field `TRUTH_FIELD`.

    Raises InputError if the file is neither, or there is no truth; UsageError if a model is given for a result.
    """
    if is_result_folder(path):
        _refuse_model(path, model)
        folder = open_result_folder(path)
        wanted = truth_field or TRUTH_FIELD
        if wanted not in folder.fields:
            raise _no_truth(path, wanted if truth_field else None, folder.fields)
        return _labelled_result(folder.pieces((*RESULT_FIELDS, wanted)), path, wanted)
    found = assess.read_input(path)
    if isinstance(found, Patches):
        truth, truth_from = _patches_truth(found, path, truth_field)
        result = assess.assess(found, model)
        return Labelled(result.labelling.label, truth, result.labelling.probability, truth_from)
    _refuse_model(path, model)
    return _labelled_result([found], path, truth_field)


def _refuse_model(path: str, model: Model | None) -> None:
    if model is not None:
        raise UsageError(
            f"{path} is not a PATCHES file, so it has labels of a model already. Leave out --model "
            "and --max-false-alarms."
        )


def _labelled_result(pieces: Iterable[PointCloud], path: str, truth_field: str | None) -> Labelled:
    """Return the labels of the patches that have points in a result, which is read in pieces; votes are added up."""
    parts, name = [], truth_field
    for cloud in pieces:
        name = name or _default_truth(path, cloud)
        parts.append(_counted(cloud, path, name))
    numbers, first, place = np.unique(
        np.concatenate([part.number for part in parts]), return_index=True, return_inverse=True
    )
    label, probability, counts = (
        np.concatenate([getattr(part, column) for part in parts]) for column in ("label", "probability", "counts")
    )
    sums = np.column_stack([np.bincount(place, column, len(numbers)) for column in counts.T])
    truth, _ = majority_of(sums.astype(np.int64))
    return Labelled(label[first].astype(np.uint8), truth, probability[first].astype(np.float64), f"point field {name}")


class _Counted(NamedTuple):
    """Numbers (k,) of the patches of a piece, their labels, and votes (k, 3) for the truth."""

    number: NDArray[Any]
    label: NDArray[Any]
    probability: NDArray[Any]
    counts: NDArray[np.int64]


def _counted(cloud: PointCloud, path: str, name: str) -> _Counted:
    """Return labels and votes of the patches of a piece of a result."""
    missing = [field for field in RESULT_FIELDS if field not in cloud.fields]
    if missing:
        raise InputError(
            f"{path}: neither PATCHES nor a result: no point field {', '.join(missing)}. Run mapq classify on it."
        )
    number, label, probability = (np.asarray(cloud.fields[field]) for field in RESULT_FIELDS)
    inside = number != NO_PATCH
    _check_result(path, number[inside], label[inside], probability[inside])
    numbers, first, of_point = np.unique(number[inside], return_index=True, return_inverse=True)
    patch = np.full(len(cloud), NO_PATCH, np.int32)
    patch[inside] = of_point
    counts = votes(patch, len(numbers), truth_values(cloud, name, patch, path))
    return _Counted(numbers, label[inside][first], probability[inside][first], counts)


def _check_result(path: str, number: NDArray[Any], label: NDArray[Any], probability: NDArray[Any]) -> None:
    """Refuse fields of a result, at the points of patches, that mapq classify cannot have written."""
    with np.errstate(invalid="ignore"):
        kept = {
            "patch": number.ndim == 1 and bool(np.all((number >= 0) & (number < 2**31) & (np.floor(number) == number))),
            "suspicious": label.ndim == 1 and bool(np.isin(label, (PLAUSIBLE, SUSPICIOUS)).all()),
            "p_suspicious": probability.ndim == 1 and bool(np.all((probability >= 0.0) & (probability <= 1.0))),
        }
    for name, is_kept in kept.items():
        if not is_kept:
            raise InputError(f"{path}: field {name} is not what mapq classify writes. Run it again.")


def _patches_truth(patches: Patches, path: str, truth_field: str | None) -> tuple[NDArray[np.uint8], str]:
    if truth_field is None and np.isin(patches.label, (PLAUSIBLE, SUSPICIOUS)).any():
        return patches.label, "labels of the patches"
    name = truth_field or _default_truth(path, patches.cloud)
    values = truth_values(patches.cloud, name, patches.patch, path)
    return majority_labels(patches.patch, len(patches), values)[0], f"point field {name}"


def _default_truth(path: str, cloud: PointCloud) -> str:
    if TRUTH_FIELD in cloud.fields:
        return TRUTH_FIELD
    raise _no_truth(path, None, tuple(cloud.fields))


def _no_truth(path: str, name: str | None, fields: tuple[str, ...]) -> InputError:
    known = ", ".join(fields) or "none"
    if name is not None:
        return InputError(f"{path}: no point field {name}; there are {known}.")
    return InputError(f"{path}: no truth is known. Name a 0/1 point field with --truth-field (fields: {known}).")


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else math.nan
