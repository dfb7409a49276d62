"""The tables of `benchmarks.unseen`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

POINTS, SCANS = "points alone", "scans known"
MODEL, FOREST, THICKNESS, SPREAD, ENTROPY, BEFORE = "mapq", "forest", "thickness", "spread", "entropy", "before"
METHODS = (MODEL, FOREST, THICKNESS, SPREAD, ENTROPY, BEFORE)
"""Spread: from the lowest to the highest median of scans along the normal; before: another model, of `--before`."""
FALSE_ALARMS = 0.03
BINS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Metres: bounds between which patches are counted by how far they are displaced along their normal."""


def lines(found: dict[str, Any]) -> Iterator[str]:
    """Yield the tables."""
    rows = [(place, variant, each[variant]) for place, each in found.items() for variant in (POINTS, SCANS)]
    yield "false alarms on right maps at the model's threshold, % of patches / of area, one of so many points kept"
    densities = sorted({int(key) for _, _, row in rows for key in row["false_alarms"]})
    yield f"{'':29}{'patches':>9}" + "".join(f"{f'1/{each}':>14}" for each in densities) + f"{'in patches':>12}"
    for place, variant, row in rows:
        alarms = row["false_alarms"]
        cells = "".join(f"{_alarms(alarms.get(each)):>14}" for each in densities)
        n = sum(each["n"] for each in alarms.values())
        yield f"{_mark(row)}{place:14}{variant:14}{n:>9}{cells}{row['judged']:>12.1%}"
    yield ""
    yield f"suspicious against plausible patches: AUC, and recall at {FALSE_ALARMS:.0%} false alarms of the row"
    yield (
        f"{'':34}{'n':>6}{'bad':>6}"
        + "".join(f"{method:>14}" for method in METHODS)
        + "    recall, alarms, ECE as shipped"
    )
    for place, variant, row in rows:
        for thinned, rank in row["ranks"].items():
            if rank is not None:
                cells = "".join(f"{_rank(rank.get(method)):>14}" for method in METHODS)
                shipped = f"{rank['recall_shipped']:>10.2f}{rank['alarms_shipped']:>8.3f}{rank['ece']:>6.2f}"
                head = f"{_mark(row)}{place:14}{variant:14}1/{thinned:<3}"
                yield f"{head}{rank['n']:>6}{rank['base_rate']:>6.0%}{cells}{shipped}"
    yield ""
    yield "at 0.1 m: patches truly 0.12 to 0.3 m apart (n) that are found, and those below 0.05 m that are called;"
    yield "at 0.3 m: the former that are called; AUC of above 0.2 m against below 0.1 m; ECE at 0.1, 0.2 and 0.3 m"
    for place, variant, row in rows:
        each = row["tolerances"]
        shares = "".join(f"{each[name]:>8.3f}" for name in ("found", "alarms", "called_at_last", "auc"))
        errors = "".join(f"{error:>7.3f}" for error in each["ece"])
        yield f"{_mark(row)}{place:14}{variant:14}{each['n_between']:>6}{shares}{errors}"
    yield ""
    yield from _of_kinds(rows)
    yield "whole maps: right before wrong by compare, and by mean map entropy at one density; larger error has larger"
    yield "share; most that a share moves from 1/1 to 1/6; disagreement: known, median error, in bounds, width"
    for place, variant, row in rows:
        if row["compare"][1] or row["disagreement"]:
            ranked = "".join(
                f"{good:>5} of {n:<4}" for good, n in map(row.get, ("compare", "compare_entropy", "growth"))
            )
            yield f"{_mark(row)}{place:14}{variant:14}{ranked}{row['thinning']:>8.1%}{_metres(row['disagreement'])}"
    yield ""
    bounds = [f"<{BINS[0]:g}", *(f"{low:g}-{high:g}" for low, high in pairwise(BINS)), f">{BINS[-1]:g}"]
    yield "share of patches called suspicious (and how many there are), by metres displaced along the normal"
    yield f"{'':30}" + "".join(f"{each:>13}" for each in bounds)
    for place, variant, row in rows:
        bins = zip(row["curve"]["called"], row["curve"]["n"], strict=True)
        cells = "".join(f"{f'{share:.2f} ({n:.0f})' if n else '-':>13}" for share, n in bins)
        yield f"{_mark(row)}{place:14}{variant:14}{cells}"
    yield ""
    yield "share of area called suspicious, by error"
    for place, variant, row in rows:
        parts = [f"{name.removeprefix(place + '-')} {share:.0%}" for name, share in row["shares"].items()]
        yield f"{_mark(row)}{place:14}{variant:14}" + ", ".join(parts)
    yield "* for development; all others for judging alone"


def _of_kinds(rows: list[tuple[str, str, dict[str, Any]]]) -> Iterator[str]:
    """Yield how kinds of surfaces are judged."""
    yield "kinds of surfaces; scans known at 0.1 m, points alone at 0.3 m: share of points; patches truly apart (n),"
    yield "their AUC against those that are not, found; patches of right maps (n), called; at 0.3 m above 0.3 m against"
    yield f"below 0.1 m: AUC, recall at {FALSE_ALARMS:.0%} false alarms; at 0.1 m: found of 0.12 to 0.3 m,"
    yield "called of below 0.05 m"
    for place, variant, row in rows:
        for name, each in row["kinds"].items():
            cells = f"{each['share_of_points']:>8.2f}{each['n_far']:>7}{each['auc']:>8.3f}{each['found']:>7.2f}"
            cells += (
                f"{each['n_right']:>7}{each['alarms']:>8.3f}{each['auc_at_last']:>10.3f}{each['recall_at_last']:>7.2f}"
            )
            cells += f"{each['found_between']:>9.2f}{each['called_below']:>8.3f}"
            yield f"{_mark(row)}{place:14}{variant:14}{name:9}{cells}"
    yield ""


def _mark(row: dict[str, Any]) -> str:
    return "* " if row["role"] == "development" else "  "


def _alarms(row: dict[str, float] | None) -> str:
    return "-" if row is None or not row["n"] else f"{100 * row['patches']:.1f} / {100 * row['area']:.1f}"


def _rank(row: dict[str, float] | None) -> str:
    return "-" if row is None else f"{row['auc']:.3f} {row['recall']:.2f}"


def _metres(row: dict[str, float] | None) -> str:
    if row is None:
        return ""
    return f"{row['known']:>8.0%}{row['error']:>8.3f}{row['coverage']:>7.0%}{row['width']:>8.3f}"
