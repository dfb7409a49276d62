"""What `mapq classify` prints of a result for a person."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from prf.shell.cli.console import is_verbose

if TYPE_CHECKING:
    from mapq.posed.check_scans import ScanMotion
    from mapq.results.reasons import Region
    from mapq.results.result import Result

N_POSES = 10
"""Scans, and edges, that -v lists."""


def summary_lines(result: Result, target: str, limits: Mapping[str, Any]) -> Iterator[str]:
    """Yield the summary for a person, the verdict last; -v lists more regions, patches and reasons."""
    from mapq.patches import apart_words

    n_regions, n_worst, n_reasons = (5, 10, 3) if is_verbose() else (3, 1, 2)
    if result.regions:
        shown = "" if len(result.regions) <= n_regions else f", the worst {n_regions}"
        yield f"regions         {len(result.regions)} of connected suspicious patches{shown}:"
    for number, region in enumerate(result.regions[:n_regions]):
        yield f"  region {number:<5} {_region(result, region)}"
    worst = result.worst(n_worst)
    if worst:
        yield "most severe by area times p, with reasons (log-odds):"
    for patch in worst:
        yield from _patch_lines(result, patch, n_reasons)
    areas = result.area_by_cause()
    if result.visits is not None and any(areas.values()):
        named = ", ".join(f"{name} {area / sum(areas.values()):.0%}" for name, area in areas.items() if area)
        yield f"causes          {named} of the suspicious area"
    if result.scans_apart_surface is not None:
        median, mean = (apart_words(each, result.resolution) for each in (result.scans_apart, result.disagreement))
        kind = f"{result.scans_apart_surface} surfaces, the worst kind"
        yield f"scans disagree  {median} in the median of {kind}; {mean} in the mean of all, where several saw them"
    yield from _pose_lines(result)
    yield f"judged          {_judged(result)}"
    yield f"tolerance       {_tolerance(result, limits)}"
    yield f"verdict         {_verdict(result, limits)}"
    yield f"result          {target} and .json"


def _pose_lines(result: Result) -> Iterator[str]:
    """Yield which scans and edges are wrong; -v lists more of either, whatever their probability."""
    from mapq.posed.check_poses import WRONG
    from mapq.results.causes import WRONG_SCAN
    from mapq.results.content import scans_of

    found, rows = result.poses, scans_of(result)
    wrong = sum(scan.p_wrong > WRONG for scan, _ in rows)
    if len(rows) == 2 and not wrong and result.area_by_cause()[WRONG_SCAN]:
        one, other = rows[1][0], rows[0][0]
        shift = f"{other.dx:+.2f} {other.dy:+.2f} {other.dz:+.2f} m"
        yield f"scans           the two disagree, which is wrong they do not show: scan {other.scan} would lie on scan"
        yield f"                {one.scan} if moved by {shift} and turned by {math.degrees(other.yaw):+.2f} deg"
    elif rows and rows[0][1] and not wrong:
        most = max(scan.p_wrong for scan, _ in rows)
        blame = f"{rows[0][1]:.1f} m2 are put down to scan {rows[0][0].scan}"
        yield f"scans           none of {len(rows)} is surely displaced (p {most:.2f} at most); {blame}"
    elif rows:
        yield f"scans           {wrong} of {len(rows)} probably displaced"
    for scan, area in rows[: N_POSES if is_verbose() else min(wrong, 1)]:
        blame = f", blamed for {area:.1f} m2" if area else ""
        yield f"  p {scan.p_wrong:.3f}  {scan.file} {_motion_words(scan)}{blame}"
    if found.drift is not None:
        value, low, high = (100.0 * part for part in found.drift[:3])
        of = "metre driven" if found.drift.unit == "m/m" else "minute"
        rise = f"{100.0 * found.drift.rise:+.2f} of it upwards"
        yield f"drift           {value:.2f} cm a {of} ({low:.2f} to {high:.2f}), {rise}"
    if found.edges:
        yield f"edges           {len(found.wrong_rows)} of {len(found.edges)} probably wrong"
    elif found.scans and is_verbose():
        yield "edges           the poses have none"
    for edge in found.edges[: N_POSES if is_verbose() else min(len(found.wrong_rows), 1)]:
        off = "cannot be checked: its ends share no surface"
        if edge.error_m is not None and edge.error_rad is not None:
            off = f"is {edge.error_m:.2f} m and {math.degrees(edge.error_rad):.2f} deg off"
        yield f"  p {edge.p_wrong:.3f}  from {edge.ids[0]} to {edge.ids[1]} {off}"


def _motion_words(scan: ScanMotion) -> str:
    """Return the motion that the other scans ask of a scan; of one that may be right only how far it is off at most."""
    if not scan.low:
        return f"may be right: it is {scan.high:.2f} m off at most"
    shift = f"{scan.dx:+.2f} {scan.dy:+.2f} {scan.dz:+.2f} m ({scan.low:.2f} to {scan.high:.2f})"
    return f"should move by {shift} and turn by {math.degrees(scan.yaw):+.2f} deg"


def _judged(result: Result) -> str:
    """Return how much of the map lies in patches that are large enough to judge, and what of these was judged."""
    from mapq.patches import large_share

    counts = result.counts
    large = large_share(counts)
    share = f"{large:.1%} of all points lie in patches large enough, {counts['coverage']:.1%} of these in judged ones"
    if large != large:
        share = f"{counts['n_points_in_patches'] / counts['n_points']:.1%} of all points"
    parts = [
        f"{name} {each['area_m2']:.1f} m2, {each['share_of_area']:.1%} suspicious"
        for name, each in counts["by_surface"].items()
    ]
    return share + (": " if parts else "") + "; ".join(parts)


def _tolerance(result: Result, limits: Mapping[str, Any]) -> str:
    """Return the tolerance, what scans resolve, and how much of the area they do not decide at it."""
    verdict, words = result.verdict(**limits), f"{result.tolerance:.2f} m"
    if verdict["resolution_m"] != verdict["resolution_m"]:
        n_scans = len(result.poses.scans)
        unknown = "scans are not known, so copies are found by points alone"
        if n_scans > 1:
            unknown = f"no two of the {n_scans} scans see the same surface, so nothing was compared"
        return f"{words}; {unknown}{_advice(result)}"
    left = f"{verdict['unresolved_share_of_area']:.1%} of the area one scan alone saw, or several too little to compare"
    return f"{words}; scans resolve {verdict['resolution_m']:.3f} m; {left}"


def _advice(result: Result) -> str:
    """Return where to look next if points alone leave much of a map in doubt; else nothing."""
    from mapq.patches import in_doubt
    from mapq.results.verdict import LEAST_TOLERANCE

    words = in_doubt(result.labelling.label, result.probability, result.area)
    finer = result.model.tolerances[0] <= LEAST_TOLERANCE < result.tolerance
    return f"; {words}, try --tolerance {LEAST_TOLERANCE:g}" if words and finer else ""


def _verdict(result: Result, limits: Mapping[str, Any]) -> str:
    """Return how much of what was judged is suspicious, and whether the map passes."""
    from mapq.patches import caveat

    counts, verdict = result.counts, result.verdict(**limits)
    passed = {None: "", True: ": the map passes", False: ": the map does not pass"}[verdict["passed"]]
    patches = f"{counts['n_suspicious']} of {counts['n_patches']} patches"
    if not counts["n_patches"]:
        return f"nothing was judged, {patches}{caveat(verdict)}{passed}"
    share = f"{counts['share_of_area']:.1%} of the area judged is suspicious at {result.tolerance:.2f} m"
    patches = f"{counts['area_suspicious_m2']:.1f} of {counts['area_m2']:.1f} m2, {patches}"
    return f"{share} ({patches}; {result.patches.cloud.unit_words}){caveat(verdict)}{passed}"


def _region(result: Result, region: Region) -> str:
    """Return size, place and cause of a region."""
    from mapq.patches import WIDE_REGION

    cloud, words = result.patches.cloud, [f"{len(region.patches)} patch{'' if len(region.patches) == 1 else 'es'}"]
    lengths = ((region.high - region.low) * cloud.unit).tolist()
    size = " x ".join(f"{length:.1f}" for length in lengths)
    words.append(f"{_area(region.area)} m2 in {size} m at {cloud.place_words(region.centre)}")
    if region.displacement == region.displacement:
        words.append(f"surfaces {region.displacement:.2f} m apart")
    if max(lengths) > WIDE_REGION:
        worst = cloud.place_words(cloud.world_of(result.patches.centroid[region.worst]))
        apart = region.worst_displacement
        words.append(f"worst at {worst}" + (f" ({apart:.2f} m apart)" if apart == apart else ""))
    if result.visits is not None:
        words.append(next(iter(result.area_by_cause(region.patches))).replace("unknown", "cause unknown"))
    return ", ".join(words)


def _area(area: float) -> str:
    """Return an area in square metres, of small ones another digit."""
    return f"{area:.2f}" if area < 0.1 else f"{area:.1f}"


def _patch_lines(result: Result, patch: int, n_reasons: int) -> Iterator[str]:
    cloud, p = result.patches.cloud, result.probability[patch]
    place = cloud.place_words(cloud.world_of(result.patches.centroid[patch]))
    yield f"  patch {patch:<6} p {p:.3f}  {_area(result.area[patch])} m2 at {place}"
    for reason in result.reasons(patch, n_reasons):
        yield f"      {reason.log_odds:+.2f}  {reason.text}"
    if result.visits is not None:
        yield f"      cause  {result.causes[patch].kind}: {result.causes[patch].text}"
