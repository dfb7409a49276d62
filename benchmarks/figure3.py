"""The paper's figure 3 again: what a sonar sees in one cone, who returns the pulse, and the density of the range.

Run it from the repository's root::

    python -m benchmarks.figure3 [-o FOLDER]

Prints the features with their return probabilities, checks that these and the density come to one, leaves figure3.png.
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy import integrate

from benchmarks.commands import OUTPUT, write_table
from prf.kernels.readings.cones import READING
from prf.kernels.readings.sonar_features import BEARING, CORNER, DEPTH, KIND, PROJECTION, SUBTENDED
from prf.kernels.score.sonar import Scene, add_sonar_densities
from prf.model.coloring import Coloring, from_polygons
from prf.model.ranges import make_poses, return_probabilities, sonar_array
from prf.model.sensors import SonarModel
from prf.model.window import Window
from prf.output.pictures.posterior import fill_map
from prf.results.score.scene import features_seen, scene_of_coloring
from prf.shell.cli import pictures as style

WINDOW = Window(-0.3, -1.3, 3.9, 1.3)
VIEW = math.radians(30.0)
"""Wide enough for a few features at once."""
WALLS = shapely.union_all(
    [
        shapely.Polygon([(1.45, 0.18), (1.95, 0.38), (1.6, 1.0), (1.2, 0.7)]),  # a box, one corner ahead
        shapely.Polygon([(2.25, -2.0), (2.45, -2.0), (2.45, -0.3), (2.25, -0.3)]),  # the end of a wall: a door frame
        shapely.Polygon([(3.25, -2.0), (3.5, -2.0), (2.75, 2.0), (2.5, 2.0)]),  # behind, at a slant
    ]
)
PEAK_WIDTH = 0.15
"""Metres within which features make one peak for the eye."""
SURFACE_INK, CORNER_INK, NONE_INK = "#1971c2", "#e8590c", style.MUTED


class Sight(NamedTuple):
    """One cone in one map, and what is in it."""

    coloring: Coloring
    scene: Scene
    pose: np.ndarray
    features: np.ndarray
    model: SonarModel
    # alone, share, none: as of return_probabilities
    alone: np.ndarray
    share: np.ndarray
    none: float


def look(model: SonarModel) -> Sight:
    """Return what a sonar at the origin that looks along x sees."""
    coloring = from_polygons(WALLS, WINDOW)
    pose = make_poses(model, np.zeros((1, 2)), np.zeros(1), np.full(1, VIEW), np.full(1, math.inf))
    scene = scene_of_coloring(coloring, model.max_range)
    _, features = features_seen(scene, pose, model.max_range)
    return Sight(coloring, scene, pose, features, model, *return_probabilities(model, features))


def density(sight: Sight, readings: np.ndarray) -> np.ndarray:
    """Return the density of readings (inf: the probability of no return) as the kernels compute it."""
    pose = np.repeat(sight.pose, len(readings), axis=0)
    pose[:, READING] = readings
    total = np.zeros(len(readings))
    add_sonar_densities(sight.scene, sonar_array(sight.model), pose, np.zeros(len(readings), np.bool_), total)
    return total


def sums(sight: Sight) -> dict[str, float]:
    """Return what should be 1: all return probabilities, and the density with the mass of no return."""
    depths = np.unique(sight.features[:, DEPTH])
    near = (depths[:, None] + np.array([-0.3, -0.1, 0.0, 0.1, 0.3])).ravel()
    cuts = np.unique(np.clip([0.0, *near, sight.model.max_range], 0.0, sight.model.max_range))
    pieces = [
        integrate.quad(lambda r: density(sight, np.array([r]))[0], a, b, epsabs=1e-13)[0]
        for a, b in itertools.pairwise(cuts.tolist())
    ]
    silent = float(density(sight, np.array([math.inf]))[0])
    return {
        "returns": float(sight.share.sum() + sight.none),
        "density": sum(pieces) + silent,
        "no_return_reading": silent,
    }


def rows_of(sight: Sight) -> list[dict[str, Any]]:
    """Return one row a feature, nearest first."""
    pairs = zip(sight.features, sight.alone, sight.share, strict=True)
    return [
        {
            "kind": "corner" if feature[KIND] == CORNER else "surface",
            "depth_m": float(feature[DEPTH]),
            "bearing_deg": math.degrees(math.atan(feature[BEARING])),
            "projection_deg": math.degrees(feature[PROJECTION]),
            "subtended_deg": math.degrees(feature[SUBTENDED]),
            "alone": float(alone),
            "share": float(share),
        }
        for feature, alone, share in pairs
    ]


def show(rows: list[dict[str, Any]], none: float, checks: dict[str, float]) -> None:
    """Print the table."""
    print("  # kind     depth m  bearing  projection  subtended   q alone   r share")
    for number, row in enumerate(rows, start=1):
        angles = f"{row['bearing_deg']:7.1f}°"
        shape = " " * 23
        if row["kind"] == "surface":
            shape = f"  {row['projection_deg']:9.1f}°  {row['subtended_deg']:8.1f}°"
        print(
            f"{number:3d} {row['kind']:8} {row['depth_m']:7.3f} {angles}{shape} {row['alone']:9.4f} {row['share']:9.4f}"
        )
    print(f"    none {' ' * 56} {none:9.4f}")
    print(f"return probabilities come to 1 {checks['returns'] - 1.0:+.1e}")
    print(f"density and no return ({checks['no_return_reading']:.4f}) come to 1 {checks['density'] - 1.0:+.1e}")


def visible_parts(sight: Sight) -> list[np.ndarray]:
    """Return the two ends of each visible part of an edge, by a fan of rays: for the picture only."""
    turn = np.linspace(-0.5 * VIEW, 0.5 * VIEW, 3601)
    ray = np.exp(1j * turn)[:, None]
    ends = sight.coloring.segments().reshape(-1, 2, 2) @ np.array([1.0, 1j])
    along = (ends[:, 1] - ends[:, 0])[None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = (ray.conj() * along).imag
        depth = (ends[:, 0].conj() * along).imag / across
        place = (ends[:, 0].conj() * ray).imag / across
    depth = np.where((place >= 0.0) & (place <= 1.0) & (depth > 0.0) & (depth < sight.model.max_range), depth, np.inf)
    edge = np.where(np.isfinite(depth.min(axis=1)), depth.argmin(axis=1), -1)
    xy = depth.min(axis=1) * ray[:, 0]
    starts = np.flatnonzero(np.diff(edge, prepend=-2))
    runs = zip(starts, [*starts[1:], len(edge)], strict=True)
    return [np.array([[xy[k].real, xy[k].imag] for k in (a, b - 1)]) for a, b in runs if edge[a] >= 0]


def draw(sight: Sight, target: Path) -> None:
    """Write the picture: the cone on the left, the density of the range on the right."""
    width, height = style.drawn_size(WINDOW, 6.2, 6.2)
    page = style.new_page(width + 6.6, height + 1.5)
    axes = style.add_axes(page, 0.3, 0.6, width, height)
    draw_cone(axes, sight)
    style.show_window(axes, WINDOW)
    style.bare_axes(axes)
    style.scale_bar(axes, WINDOW, width, below=0.25)
    words = f"cone of {math.degrees(VIEW):.0f}°; numbers by distance, strength by return probability"
    style.add_title(axes, "What a sonar sees", words)
    curve = style.add_axes(page, width + 1.2, 0.6, 5.0, height)
    draw_density(curve, sight)
    style.add_title(curve, "What it may read", "density of the range; bar at the end: no return")
    target.parent.mkdir(parents=True, exist_ok=True)
    style.save(page, target)


def draw_cone(axes: Any, sight: Sight) -> None:
    """Draw map and cone, and every feature as strongly as it returns the pulse."""
    turn = np.linspace(-0.5 * VIEW, 0.5 * VIEW, 60)
    arc = sight.model.max_range * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    axes.fill(*np.vstack([[0.0, 0.0], arc]).T, color=style.BEAM, alpha=0.16, linewidth=0, zorder=1)
    fill_map(axes, sight.coloring, colour="#ced4da")
    axes.plot(0.0, 0.0, marker="o", markersize=6, color=style.PATH, zorder=5)
    parts = visible_parts(sight)
    for number, (feature, share) in enumerate(zip(sight.features, sight.share, strict=True), start=1):
        near = feature[DEPTH] * np.array([1.0, feature[BEARING]]) / math.hypot(1.0, feature[BEARING])
        strength = 0.25 + 0.75 * float(share) ** 0.5
        if feature[KIND] == CORNER:
            place, shift, ink = near, (14.0, -8.0), CORNER_INK
            axes.plot(*near, marker="o", markersize=8, color=ink, alpha=strength, markeredgewidth=0, zorder=4)
        else:
            part = min(parts, key=lambda ends: mismatch(ends, feature))
            place, shift, ink = part.mean(axis=0), (-9.0, 3.0), SURFACE_INK
            axes.plot(*part.T, color=ink, alpha=strength, linewidth=4, solid_capstyle="butt", zorder=3)
        axes.annotate(
            f"{number}", place, shift, textcoords="offset points", color=ink, fontsize=9, ha="right", va="center"
        )


def mismatch(ends: np.ndarray, feature: np.ndarray) -> float:
    """Return how far a visible part is from being that of a surface: its angle and its distance."""
    angle = abs(float(np.diff(np.arctan2(ends[:, 1], ends[:, 0]))[0]))
    distance = shapely.LineString(ends).distance(shapely.Point(0, 0))
    return float(abs(angle - feature[SUBTENDED]) + abs(distance - feature[DEPTH]))


def draw_density(axes: Any, sight: Sight) -> None:
    """Draw the density of the range, its share that no feature returned, and the mass of no return as a bar."""
    limit = sight.model.max_range
    r = np.unique(
        np.concatenate(
            [np.linspace(0.0, limit, 1500)[:-1], *(d + np.linspace(-0.2, 0.2, 200) for d in sight.features[:, DEPTH])]
        )
    )
    r = r[(r >= 0.0) & (r < limit)]
    total = density(sight, r)
    empty = sight._replace(scene=scene_of_coloring(Coloring.empty(WINDOW), limit))
    outlier = sight.none * density(empty, r)
    axes.fill_between(r, total, color=SURFACE_INK, alpha=0.12, linewidth=0)
    axes.plot(r, total, color=SURFACE_INK, linewidth=1.4)
    axes.plot(r, outlier, color=NONE_INK, linewidth=1.1, linestyle=(0, (3, 2)))
    axes.set_yscale("log")
    axes.set_ylim(outlier.min() / 3.0, 9.0 * total.max())
    axes.set_xlim(0.0, limit + 0.45)
    label_peaks(axes, sight)
    silent = float(density(sight, np.array([math.inf]))[0])
    axes.bar(limit + 0.2, silent, width=0.16, color=NONE_INK, linewidth=0)
    axes.annotate(
        f"no return\n{silent:.3f}", (limit + 0.2, silent * 1.25), color=NONE_INK, fontsize=8, ha="center", va="bottom"
    )
    axes.annotate("outlier", (0.5, float(np.interp(0.5, r, outlier)) * 0.55), color=NONE_INK, fontsize=8)
    axes.set_xlabel("range (m)", color=style.MUTED, fontsize=9)
    axes.set_ylabel("density (1/m); bar: probability", color=style.MUTED, fontsize=9)
    axes.tick_params(colors=style.MUTED, labelsize=8, color=style.FRAME, width=0.8, length=3, which="both")
    for spine in axes.spines.values():
        spine.set(color=style.FRAME, linewidth=0.8)


def label_peaks(axes: Any, sight: Sight) -> None:
    """Write number and return probability over the peak of each feature; those of one peak one over the other."""
    stacked, last = 0, -math.inf
    pairs = zip(sight.features, sight.share, strict=True)
    for number, (feature, share) in enumerate(pairs, start=1):
        ink = CORNER_INK if feature[KIND] == CORNER else SURFACE_INK
        depth = float(feature[DEPTH])
        stacked = stacked + 1 if depth - last < PEAK_WIDTH else 0
        last = depth if stacked == 0 else last
        top = float(density(sight, np.array([last])).max())
        axes.plot([depth] * 2, [axes.get_ylim()[0], density(sight, np.array([depth]))[0]], color=ink, linewidth=0.8)
        axes.annotate(
            f"{number}: {share:.2f}",
            (last, top),
            (0.0, 4.0 + 10.0 * stacked),
            textcoords="offset points",
            color=ink,
            fontsize=8,
            ha="center",
            va="bottom",
        )


def main() -> None:
    """Print the table and draw the picture."""
    asked = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    asked.add_argument("-o", "--output", type=Path, default=OUTPUT, help="where the picture and the table go")
    folder = asked.parse_args().output.resolve()
    sight = look(SonarModel(max_range=3.5))
    rows, checks = rows_of(sight), sums(sight)
    show(rows, sight.none, checks)
    draw(sight, folder / "figure3.png")
    write_table(folder / "figure3.json", {"features": rows, "none": sight.none, "sums": checks})
    if max(abs(checks["returns"] - 1.0) * 1e3, abs(checks["density"] - 1.0)) > 1e-9:
        raise SystemExit("a sum is not 1")


if __name__ == "__main__":
    main()
