"""The noisy bitmap of Clifford and Nicholls (1994), which the first paper builds on: share of wrong pixels.

Run it from the repository's root::

    python -m benchmarks.bitmap [--seeds N] [--steps N] [-o PICTURE] [--json FILE]

Polygonal shapes and a letter are drawn on 96 x 96 pixels, of which a quarter is flipped. The posterior over polygonal
maps given the pixels as point observations, its mean cut at 1/2, stands beside a median filter, an Ising model solved
by a graph cut, and the flipped pixels themselves. Filter size, neighbourhood and coupling are those that turn out best
on the very bitmap, which no user could choose; the scale of the prior is the same for all.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import deque
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeAlias

import maxflow
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from shapely.geometry.base import BaseGeometry

from benchmarks import panels
from prf.model.coloring import Coloring
from prf.model.points import window_round
from prf.model.sensors import PointModel
from prf.model.window import Window
from prf.results import PosteriorImage
from prf.sampler import Ensemble, StopRule, drive
from prf.sampler.target import Execution, Target, point_data
from prf.shell.cli.storage import spawn_generators

SIZE = 96
FLIPS = 0.25
SCALE = 0.03
"""p of the prior in 1/pixel."""
STEPS, CHAINS = 2_000_000, 4
FILTERS = (3, 5, 7, 9)
COUPLINGS = np.round(np.geomspace(0.05, 2.0, 30), 3)
"""Cost in nats of a pair of unlike neighbours; a diagonal pair costs 1/sqrt(2) of it."""
FIRST_SEED = 101

Bits = NDArray[np.bool_]
Truth: TypeAlias = BaseGeometry


def shapes() -> Truth:
    """Return what is black, in pixels: a letter with a counter, a frame, a star of five points, a thin bar."""
    letter = shapely.Polygon([(8, 8), (16, 8), (20, 18), (32, 18), (36, 8), (44, 8), (30, 44), (22, 44)])
    letter -= shapely.Polygon([(22.5, 25), (29.5, 25), (26, 35)])
    frame = shapely.affinity.rotate(shapely.box(54, 10, 86, 34) - shapely.box(61, 16, 79, 28), 17)
    turn = np.pi / 2 + np.arange(10) * np.pi / 5
    reach = np.where(np.arange(10) % 2 == 0, 20.0, 9.0)
    star = shapely.Polygon(np.column_stack([26 + reach * np.cos(turn), 69 + reach * np.sin(turn)]))
    bar = shapely.affinity.rotate(shapely.box(52, 66, 92, 71), -31)
    return shapely.union_all([letter, frame, star, bar])


def centres() -> NDArray[np.float64]:
    """Return the middles of the pixels (SIZE^2, 2), row by row from the lowest."""
    middle = np.arange(SIZE) + 0.5
    return np.column_stack([np.tile(middle, SIZE), np.repeat(middle, SIZE)])


def bitmap(truth: Truth) -> Bits:
    """Return the colours of the pixels' middles (SIZE, SIZE), the lowest row first."""
    return np.asarray(shapely.contains_xy(truth, centres())).reshape(SIZE, SIZE)


def by_median(noisy: Bits, size: int) -> Bits:
    """Return the majority in the square of `size` pixels round each pixel, mirrored at the border."""
    return np.asarray(median_filter(noisy.astype(np.uint8), size, mode="reflect") != 0)


def by_ising(noisy: Bits, coupling: float, diagonal: bool) -> Bits:
    """Return the most probable bitmap of an Ising model with 4 or 8 neighbours a pixel, by a graph cut."""
    graph = maxflow.Graph[float]()
    nodes = graph.add_grid_nodes(noisy.shape)
    graph.add_grid_edges(nodes, coupling, maxflow.vonNeumann_structure(2), symmetric=False)
    if diagonal:
        corners = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]])
        graph.add_grid_edges(nodes, coupling / np.sqrt(2.0), corners, symmetric=False)
    odds = np.log((1.0 - FLIPS) / FLIPS)
    graph.add_grid_tedges(nodes, np.where(noisy, odds, 0.0), np.where(noisy, 0.0, odds))
    graph.maxflow()
    return ~np.asarray(graph.get_grid_segments(nodes))


def by_maps(noisy: Bits, seed: int, scale: float, steps: int, threads: int) -> tuple[PosteriorImage, Coloring, float]:
    """Return the mean of the posterior over polygonal maps, its best draw, and the worst R-hat."""
    data = point_data(centres(), noisy.ravel().astype(float), PointModel(kind="binary", flip_probability=FLIPS))
    target = Target(window_round(data.readings.xy), scale, points=data, execution=Execution(resolution=1.0))
    ensemble = Ensemble(target, spawn_generators(seed, CHAINS))
    with ThreadPoolExecutor(threads) as pool:
        deque(drive(ensemble, StopRule(steps), pool.map), maxlen=0)
    rhat = max(found.rhat for found in ensemble.diagnose().values() if found.state != "constant")
    mean, squares = ensemble.occupancy()
    best = ensemble.best()
    assert best is not None
    return PosteriorImage(mean, squares, np.zeros(2), 1.0, np.ones_like(mean, np.bool_)), best.coloring, rhat


def wrong(found: Bits, truth: Bits) -> float:
    """Return the share of pixels of the wrong colour."""
    return float((found != truth).mean())


def best_of(candidates: Iterable[tuple[str, Bits]], truth: Bits) -> tuple[float, str, Bits]:
    """Return share wrong, name and bitmap of the best candidate."""
    return min(((wrong(bits, truth), name, bits) for name, bits in candidates), key=lambda row: row[0])


def one_bitmap(truth: Bits, seed: int, options: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the figures of one noisy bitmap, and what to draw of it."""
    noisy = truth ^ (np.random.default_rng(seed).random(truth.shape) < FLIPS)
    filtered = best_of([(f"{n} x {n}", by_median(noisy, n)) for n in FILTERS], truth)
    cuts = [
        (f"{8 if diagonal else 4} neighbours, {coupling}", by_ising(noisy, coupling, diagonal))
        for diagonal in (False, True)
        for coupling in COUPLINGS
    ]
    cut = best_of(cuts, truth)
    start = time.process_time()
    image, best, rhat = by_maps(noisy, seed, options.scale, options.steps, options.threads)
    is_black = image.occupancy > 0.5
    given_true = np.where(truth, image.occupancy, 1.0 - image.occupancy)
    row = {
        "seed": seed,
        "flipped": wrong(noisy, truth),
        "median filter": filtered[0],
        "filter": filtered[1],
        "graph cut": cut[0],
        "coupling": cut[1],
        "polygonal maps": wrong(is_black, truth),
        "brier": float(((1.0 - given_true) ** 2).mean()),
        "rhat": rhat,
        "cpu_seconds": time.process_time() - start,
    }
    return row, {
        "noisy": noisy,
        "filtered": filtered[2],
        "cut": cut[2],
        "image": image,
        "best": best,
        "is_black": is_black,
    }


def written(value: Any) -> str:
    """Return a figure in words."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


METHODS = ("flipped", "median filter", "graph cut", "polygonal maps")


def table(rows: list[dict[str, Any]]) -> str:
    """Return mean and spread of the shares of wrong pixels."""
    lines = [f"{'share of wrong pixels':24} {'mean':>8} {'spread':>8} {'worst':>8}"]
    for name in METHODS:
        shares = np.array([row[name] for row in rows])
        spread = shares.std(ddof=1) if len(shares) > 1 else 0.0
        lines.append(f"{name:24} {shares.mean():8.2%} {spread:8.2%} {shares.max():8.2%}")
    return "\n".join(lines)


def picture(truth: Bits, row: dict[str, Any], drawn: dict[str, Any], target: Path) -> None:
    """Draw truth, flipped pixels and what each method makes of them."""

    def panel(bits: NDArray[Any], caption: str, outline: Coloring | None = None) -> panels.Panel:
        pixels = PosteriorImage(bits.astype(np.float32), bits.astype(np.float32), np.zeros(2), 1.0, np.ones_like(bits))
        return panels.image(pixels, caption, outline)

    share = {name: f"{row[name]:.1%} wrong" for name in METHODS}
    shown = [
        panel(truth, "truth"),
        panel(drawn["noisy"], f"flipped: {share['flipped']}"),
        panel(drawn["filtered"], f"median filter {row['filter']}: {share['median filter']}"),
        panel(drawn["cut"], f"Ising, {row['coupling']}: {share['graph cut']}"),
        panel(drawn["image"].occupancy, "posterior mean, best draw", drawn["best"]),
        panel(drawn["is_black"], f"posterior mean cut at 1/2: {share['polygonal maps']}"),
    ]
    panels.save_page(
        target,
        shown,
        Window(0.0, 0.0, SIZE, SIZE),
        columns=3,
        height=2.6,
        title="A bitmap of which a quarter is flipped",
        subtitle=f"{SIZE} x {SIZE} pixels of 1 m; filter and coupling the best in hindsight",
    )


def main() -> None:
    """Print the table, and leave a picture and the figures where asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="noisy bitmaps")
    parser.add_argument("--steps", type=int, default=STEPS, help="of each of four chains")
    parser.add_argument("--scale", type=float, default=SCALE, help="p of the prior, 1/pixel")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, help="picture of the first bitmap")
    parser.add_argument("--json", type=Path, help="figures of all bitmaps")
    options = parser.parse_args()
    truth = bitmap(shapes())
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + options.seeds):
        row, drawn = one_bitmap(truth, seed, options)
        rows.append(row)
        words = [
            f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}" for name, value in row.items()
        ]
        print(", ".join(words))
        if options.output is not None and len(rows) == 1:
            picture(truth, row, drawn, options.output)
    print(table(rows))
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
