"""How well labels and probabilities agree with a truth: confusion matrix, scores, calibration."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from mapq.cloud import PointCloud
from mapq.crf import classify
from mapq.features import feature_settings, patch_features
from mapq.io.maps import StoredResult, read_map
from mapq.io.models import read_default_model
from mapq.io.results import RESULT_FIELDS
from mapq.labels import NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED, majority_labels, majority_of, truth_values, votes
from mapq.model import Model
from mapq.patches import Patches
from mapq.results.verdict import tolerance_of
from prf.shell.errors import InputError, UsageError

TRUTH_FIELD = "truth"
"""Point field that is taken for the truth where none is named."""
N_BINS = 10
"""Of the expected calibration error: equal steps of the probability."""


class Scores(NamedTuple):
    """How well labels agree with the truth; suspicious is positive, nan where a ratio has nothing to divide by."""

    n: int  # patches with a label and a truth
    n_without_truth: int  # patches left out because their truth is unknown
    # rows inferred, columns truth; plausible, then suspicious
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


def read_labelled(path: str, model: Model | None, truth_field: str | None, tolerance: float | None = None) -> Labelled:
    """Return the inferred and true labels of the patches of a RESULT or PATCHES file.

    A result carries its labels; PATCHES are classified with `model` (None: the one that ships with the package). The
    truth of a patch is that of most of its points in `truth_field`; without one it is the labels stored in PATCHES,
    else point field `TRUTH_FIELD`. Where the truth is metres apart, suspicious is more than the tolerance.
    `tolerance`: metres, of PATCHES; a result has its own. Raises InputError if the file is neither, or there is no
    truth; UsageError if a model or a tolerance is given for a result.
    """
    found = read_map(path)
    if isinstance(found, Patches):
        return _classified(found, path, model, truth_field, tolerance)
    if isinstance(found, PointCloud):
        missing = next(field for field in RESULT_FIELDS if field not in found.fields)
        raise InputError(f"{path}: neither PATCHES nor a result: no point field {missing}. Run mapq classify on it.")
    if model is not None or tolerance is not None:
        raise UsageError(
            f"{path} is not a PATCHES file, so it has labels of a model already. Leave out --model, --tolerance "
            "and --max-false-alarms."
        )
    return _stored(found, truth_field)


def _classified(
    patches: Patches, path: str, model: Model | None, truth_field: str | None, tolerance: float | None
) -> Labelled:
    """Return what a model infers about patches, and their truth."""
    model = model or read_default_model()
    features = patch_features(patches, feature_settings(model))
    used = tolerance_of(features, model, tolerance)
    truth, truth_from = patches.label, "labels of the patches"
    if patches.apart is not None:
        truth = patches.label_at(used)
    if truth_field is not None or not np.isin(truth, (PLAUSIBLE, SUSPICIOUS)).any():
        name = _truth_field(path, truth_field, tuple(patches.cloud.fields))
        values = truth_values(patches.cloud.fields, name, patches.patch, path, used)
        truth, truth_from = majority_labels(patches.patch, len(patches), values)[0], f"point field {name}"
    found = classify(features, model, used)
    return Labelled(found.label, truth, found.probability, truth_from)


def _stored(result: StoredResult, truth_field: str | None) -> Labelled:
    """Return the labels of the patches that have points in a result; the votes of its pieces are added up."""
    name = _truth_field(result.path, truth_field, result.fields)
    tolerance = result.tolerance
    parts = [_piece(cloud, result.path, name, tolerance) for cloud in result.pieces(name)]
    number, label, probability, counts = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    numbers, first, place = np.unique(number, return_index=True, return_inverse=True)
    sums = np.column_stack([np.bincount(place, column, len(numbers)) for column in counts.T])
    truth, _ = majority_of(sums.astype(np.int64))
    return Labelled(label[first].astype(np.uint8), truth, probability[first].astype(np.float64), f"point field {name}")


def _piece(cloud: PointCloud, path: str, name: str, tolerance: float) -> tuple[NDArray[Any], ...]:
    """Return numbers (k,), labels and probabilities of the patches of a piece, and their votes (k, 3) for the truth."""
    number, label, probability = (np.asarray(cloud.fields[field]) for field in RESULT_FIELDS)
    inside = number != NO_PATCH
    numbers, first, of_point = np.unique(number[inside], return_index=True, return_inverse=True)
    label, probability = label[inside][first], probability[inside][first]
    if not (np.isin(label, (PLAUSIBLE, SUSPICIOUS)) & (probability >= 0.0) & (probability <= 1.0)).all():
        raise InputError(f"{path}: expected labels of mapq classify. Run it again.")
    patch = np.full(len(cloud), NO_PATCH, np.int32)
    patch[inside] = of_point
    values = truth_values(cloud.fields, name, patch, path, tolerance)
    return numbers, label, probability, votes(patch, len(numbers), values)


def _truth_field(path: str, name: str | None, fields: tuple[str, ...]) -> str:
    """Return the point field that has the truth."""
    if (name or TRUTH_FIELD) in fields:
        return name or TRUTH_FIELD
    known = ", ".join(fields) or "none"
    if name is not None:
        raise InputError(f"{path}: no point field {name}; there are {known}.")
    raise InputError(f"{path}: no truth is known. Name a 0/1 point field with --truth-field (fields: {known}).")


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else math.nan
