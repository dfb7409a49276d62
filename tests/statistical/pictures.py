"""Plots of what was verified: ranks with their band, two samplers' images with the difference, tables of z-scores."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tests.statistical.images import N_CELLS, Estimate, compare
from tests.statistical.joint import QUANTITIES, Joint
from tests.statistical.problems import NAMES, Station
from tests.statistical.ranks import counts_below, make_band
from tests.statistical.sbc import CONFIDENCE, Calibration
from tests.statistical.ways import N_DRAWS

INSIDE, OUTSIDE, SHADE = "#1f4e79", "#c0392b", "#c9d6e2"
DPI = 90
STYLE = {"font.size": 8, "axes.titlesize": 8, "axes.spines.top": False, "axes.spines.right": False}


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG."""
    figure.savefig(path, dpi=DPI)


def plot_ranks(name: str, found: Calibration, path: Path) -> None:
    """Plot, for each quantity, the distribution of the ranks less the uniform one with its band, and a histogram."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.0), layout="constrained")
        figure.suptitle(
            f"{name}: ranks of the truth among {N_DRAWS} draws, {len(found.worlds)} worlds; band {CONFIDENCE:.0%}"
        )
        panels = figure.subplots(6, 3, gridspec_kw={"height_ratios": [2, 1] * 3})
        for k, quantity in enumerate(NAMES):
            row, column = divmod(k, 3)
            difference(panels[2 * row, column], found.ranks[:, k], quantity)
            histogram(panels[2 * row + 1, column], found.ranks[:, k])
        save(figure, path)


def difference(axes: Axes, ranks: np.ndarray, title: str) -> None:
    """Draw the share of ranks below k less k / (L + 1)."""
    band = make_band(len(ranks), N_DRAWS, CONFIDENCE)
    verdict = band.judge(ranks)
    place = np.arange(1, N_DRAWS + 1) / (N_DRAWS + 1)
    axes.fill_between(place, band.low / band.n - place, band.high / band.n - place, color=SHADE, lw=0)
    below = counts_below(ranks[None, :], N_DRAWS)[0] / band.n
    axes.plot(place, below - place, color=OUTSIDE if verdict.outside else INSIDE, lw=1.2)
    axes.axhline(0.0, color="0.6", lw=0.5)
    axes.set_title(f"{title}: p {verdict.p:.2f}", loc="left")
    axes.set_xlim(0.0, 1.0)


def histogram(axes: Axes, ranks: np.ndarray) -> None:
    """Draw the ranks in ten bins, those on a border shared out by chance, and the 99 % of one bin."""
    place = (ranks + np.random.default_rng(0).random(len(ranks))) / (N_DRAWS + 1)
    counts, edges = np.histogram(place, 10, (0.0, 1.0))
    mean = len(ranks) / 10
    reach = 2.58 * np.sqrt(mean * 0.9)
    axes.stairs(counts, edges, color=SHADE, fill=True)
    for level in (mean - reach, mean + reach):
        axes.axhline(level, color=INSIDE, lw=0.8, ls="--")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, None)


def plot_images(name: str, station: Station, loops: Estimate, sampler: Estimate, path: Path) -> None:
    """Plot both occupancy images, the z-scores of their difference, and these beside the normal law."""
    found = compare(loops, sampler)
    z = found.z[: N_CELLS**2].reshape(N_CELLS, N_CELLS)
    window = station.window
    extent = (window.x_min, window.x_max, window.y_min, window.y_max)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.0, 3.5), layout="constrained")
        panels = figure.subplots(1, 4)
        pictures = (
            ("disagreement loops", loops.image, {"cmap": "gray_r", "vmin": 0.0, "vmax": 1.0}),
            (name, sampler.image, {"cmap": "gray_r", "vmin": 0.0, "vmax": 1.0}),
            (f"z of the difference, largest {np.abs(z).max():.2f}", z, {"cmap": "RdBu", "vmin": -4.0, "vmax": 4.0}),
        )
        for axes, (title, picture, options) in zip(panels, pictures, strict=False):
            drawn = axes.imshow(picture, origin="lower", extent=extent, **options)
            figure.colorbar(drawn, ax=axes, shrink=0.8)
            axes.set_title(title, loc="left")
            axes.plot(*station.sensors.T, "^", color="#1b9e77", ms=6)
            axes.plot(*station.xy.T, "+", color="#d95f02", ms=7)
        ordered(panels[3], found.z, found.limit)
        save(figure, path)


def ordered(axes: Axes, z: np.ndarray, limit: float) -> None:
    """Draw sorted z-scores against the quantiles of the normal law; neighbours in an image hang together."""
    from scipy import stats

    expected = stats.norm.ppf((np.arange(len(z)) + 0.5) / len(z))
    axes.plot(expected, np.sort(z), ".", color=INSIDE, ms=3)
    axes.plot([-4, 4], [-4, 4], color="0.6", lw=0.5)
    for side in (-limit, limit):
        axes.axhline(side, color=OUTSIDE, lw=0.8, ls="--")
    axes.set_title("sorted z against normal quantiles", loc="left")


def plot_joint(tests: dict[str, Joint], path: Path) -> None:
    """Plot the z-scores of the joint tests, one column a program, the limit dashed."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.2 * len(tests) + 2.0, 4.2), layout="constrained")
        panels = figure.subplots(1, len(tests), sharey=True, squeeze=False)[0]
        place = np.arange(len(QUANTITIES))
        for axes, (name, found) in zip(panels, tests.items(), strict=True):
            outside = np.abs(found.z) >= found.limit
            axes.barh(place, found.z, color=np.where(outside, OUTSIDE, INSIDE), height=0.6)
            for side in (-found.limit, found.limit):
                axes.axvline(side, color=OUTSIDE, lw=0.8, ls="--")
            for k, (one, other) in enumerate(zip(found.marginal.mean, found.successive.mean, strict=True)):
                axes.text(
                    1.0, k, f"{one:.2f} / {other:.2f}", transform=axes.get_yaxis_transform(), va="center", fontsize=6
                )
            axes.set_title(f"{name}: z", loc="left")
            axes.set_yticks(place, QUANTITIES)
            axes.set_ylim(len(place) - 0.4, -0.6)
        save(figure, path)
