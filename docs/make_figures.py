"""Makes the pictures of README and tutorials anew: `make figures`, a quarter of an hour.

The same seeds as in the tutorials. Screenshots of reports need chromium, those of real places (`intel.png`, `park.png`)
the public data beside the project as well. The labelling page (`label-town.png`) and figures of benchmarks
(`bitmap.png`, `two-doors.png`) are made elsewhere.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

import mapq.cli
import prf.cli
from prf.model.coloring import count_black, read_geojsonl
from prf.model.layout import image_grid
from prf.model.window import Window
from prf.shell.cli.run import run_app

ROOT = Path(__file__).parent.parent
IMAGES = Path(__file__).parent / "images"
LOG = ROOT / "data" / "demo-office.log.gz"
ROOMS = ROOT / "data" / "demo-rooms.log.gz"
TOWN = ROOT / "data" / "demo-town.ply.gz"

PUBLIC = ROOT.parent / "shared" / "data"
INTEL = PUBLIC / "prf" / "carmen" / "intel-corrected.log.gz"
PARK = PUBLIC / "mapq" / "dxmcu_map"

MOST_BYTES = 200_000
STEPS = "600000"
"""As many as the tutorial has."""

ROUTES = {
    "desk: free with 1.00": ([(6.6, 6.6), (6.6, 3.0), (8.2, 2.0)], "#0a7d4f"),
    "corner: 0.79": ([(12.4, 6.6), (12.6, 5.4), (10.6, 5.2)], "#c77700"),
    "hall: 0.00": ([(10.4, 7.0), (10.4, 9.0), (12.0, 11.2), (13.6, 12.6)], "#c2185b"),
}
ROUTE_ASKED = """document.querySelector("[data-tool=path]").click();
const where = document.getElementById("where");
where.value = "12.4, 6.6; 12.6, 5.4; 10.6, 5.2";
where.dispatchEvent(new Event("change"));"""
"""On the page of the office: may the cart go into that corner?"""
RADIUS = 0.3
"""Of the cart that takes those routes, in metres."""


def call(tool: Any, *words: object) -> None:
    """Run a command in this process; stop if it fails."""
    name = tool.__name__.partition(".")[0]
    code = run_app(tool.app, name, [str(word) for word in words])
    if code:
        sys.exit(code)


def save(figure: Any, path: Path) -> None:
    """Write a figure with as few colours as its size asks for."""
    figure.savefig(path, dpi=110)
    plt.close(figure)
    shrink(path)


def shrink(path: Path) -> None:
    """Reduce a picture to 256 colours, and its size until it has at most `MOST_BYTES`."""
    picture = Image.open(path).convert("RGB")
    while True:
        picture.quantize(256, kmeans=3, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= MOST_BYTES:
            return
        picture = picture.resize((picture.width * 9 // 10, picture.height * 9 // 10), Image.Resampling.LANCZOS)


def show_cells(axes: Any, file: Path, title: str) -> None:
    """Draw the array `occupancy` of posterior.npz or of a GRID, white where free."""
    with np.load(file) as content:
        cells, (x, y), side = content["occupancy"], content["origin"], float(content["resolution"])
    rows, columns = cells.shape
    extent = (x, x + columns * side, y, y + rows * side)
    axes.imshow(cells, origin="lower", extent=extent, cmap="gray_r", vmin=0, vmax=1, interpolation="nearest")
    axes.set_title(title, loc="left", fontsize=11)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def beside_a_grid(run: Path, grid: Path, path: Path) -> None:
    """Draw the posterior beside an occupancy grid of the same readings."""
    figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained", sharex=True, sharey=True)
    show_cells(axes[0], run / "posterior.npz", "prf sample: probability of being occupied")
    show_cells(axes[1], grid, "prf grid: the same 5,580 beams, cell by cell")
    axes[0].set_xlim(-0.7, 22.7)
    axes[0].set_ylim(-0.7, 14.7)
    save(figure, path)


def with_routes(run: Path, path: Path) -> None:
    """Draw the posterior with the routes of the tutorial, as wide as the cart."""
    figure, axes = plt.subplots(figsize=(9.5, 6.4), layout="constrained")
    show_cells(axes, run / "posterior.npz", "Three routes for a cart of 0.3 m radius")
    figure.canvas.draw()
    points = axes.transData.transform([(0.0, 0.0), (2 * RADIUS, 0.0)])
    width = (points[1, 0] - points[0, 0]) * 72 / figure.dpi
    for label, (corners, colour) in ROUTES.items():
        x, y = zip(*corners, strict=True)
        axes.plot(x, y, color=colour, alpha=0.35, lw=width, solid_capstyle="round", solid_joinstyle="round")
        axes.plot(x, y, color=colour, lw=1.5, label=label)
    axes.legend(loc="lower right", framealpha=0.95)
    save(figure, path)


def draw_office(folder: Path) -> None:
    """Make the two pictures of the office."""
    run, grid = folder / "office", folder / "office.grid.npz"
    call(prf.cli, "sample", "--laser", LOG, "--steps", STEPS, "--seed", 1, "-o", run, "-q")
    call(prf.cli, "grid", "--laser", LOG, "-o", grid, "-q")
    beside_a_grid(run, grid, IMAGES / "posterior-and-grid.png")
    with_routes(run, IMAGES / "tutorial-office.png")
    call(prf.cli, "report", run, "-q")
    photograph(folder / "office.html", IMAGES / "report-office.png", ROUTE_ASKED)


def draw_rooms(folder: Path) -> None:
    """Make the picture of where to look next in the demo rooms."""
    run = folder / "rooms"
    call(prf.cli, "sample", "--laser", ROOMS, "--steps", "4000000", "--seed", 1, "-o", run, "-q")
    call(prf.cli, "explore", run, "--picture", IMAGES / "explore-rooms.png", "-o", folder / "x.csv", "--force", "-q")
    shrink(IMAGES / "explore-rooms.png")


def draw_town(folder: Path) -> None:
    """Make the picture of the classified town, and that of its report."""
    result, report = folder / "demo-town.ply", folder / "report.html"
    call(mapq.cli, "classify", TOWN, "-o", result, "--tolerance", 0.1, "-q")
    call(mapq.cli, "render", result, "-o", IMAGES / "demo-town.png", "--force", "-q")
    shrink(IMAGES / "demo-town.png")
    call(mapq.cli, "report", result, "-o", report, "-q")
    photograph(report, IMAGES / "report-town.png")


def draw_real_places(folder: Path) -> None:
    """Take pictures of the pages of real logs and of real maps, by the commands of docs/gallery.md."""
    if not PUBLIC.exists():
        print(f"pictures of real places are left as they are: they need {PUBLIC}", file=sys.stderr)
        return
    laser, clouds = PUBLIC / "prf", PUBLIC / "mapq"
    corrected = ("--every-scan", 10, "--noise", 0.05, "--noise-relative", 0.02)
    poses = ("--poses", PARK / "derived" / "poses_chain.txt")
    quad = ("--set", "scans.pattern=planes_*", "--set", "cloud.bin_columns=3")
    for name, tool, words in (
        ("intel", prf.cli, (INTEL, *corrected, "--time-budget", 120)),
        ("hall", prf.cli, (laser / "carmen" / "freiburg-101-corrected.log.gz", "--time-budget", 120)),
        ("pioneer", prf.cli, (laser / "ros1" / "trace0.bag", "--pose-noise", 0.073, 0.039, "--time-budget", 180)),
        ("park", mapq.cli, (PARK / "pcd", *poses)),
        ("quad", mapq.cli, (clouds / "newer_college_01", "--poses", clouds / "newer_college_01" / "graph.txt", *quad)),
    ):
        verb, result = ("sample", folder / name) if tool is prf.cli else ("classify", folder / f"{name}.ply")
        call(tool, verb, *(("--laser",) if tool is prf.cli else ()), *words, "-o", result, "-q")
        call(tool, "report", result, "-o", folder / f"{name}.html", "-q")
        photograph(folder / f"{name}.html", IMAGES / f"{name}.png")


Priors = dict[str, tuple[object, ...]]
"""Settings by what they are called."""
DIRECTED = ("--set", "prior.orientation=4", "--set", "prior.orientation_angle=0.2")
FREE = ("--set", "prior.free_space=0.03")


def draw_priors(folder: Path) -> None:
    """Make the pictures of a prior that knows buildings: draws, a room seen through its door, a tenth of Intel."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
    priors: Priors = {
        "the plain process": (),
        "orientation 4, angle 0.2": DIRECTED,
        "and free space 0.03 /m²": (*DIRECTED, *FREE),
    }
    for each, (title, settings) in zip(axes, priors.items(), strict=True):
        file = folder / "draw.geojsonl"
        size = ("--scale", 0.25, "--window", 0, 0, 24, 16, "--draws", 1, "--seed", 4, "--method", "mcmc")
        call(prf.cli, "prior", *size, *settings, "-o", file, "--force", "-q")
        cells = image_grid(Window(0.0, 0.0, 24.0, 16.0), 0.02)
        black = count_black(read_geojsonl(file), cells).reshape(cells.ny, cells.nx)
        each.imshow(black, origin="lower", extent=(0, 24, 0, 16), cmap="gray_r", vmin=0, vmax=1)
        each.set_title(title, loc="left", fontsize=11)
    save(figure, IMAGES / "prior-building.png")
    room = ("--laser", LOG, "--skip-scans", "12:16", "--window", -0.7, -0.7, 22.7, 14.7, "--steps", STEPS, "--seed", 1)
    shown: Priors = {
        "plain": (),
        "building": ("--preset", "building"),
        "with free space 0.03 /m²": ("--preset", "building", *FREE),
    }
    compare_priors(folder, room, shown, IMAGES / "room-building.png")
    if PUBLIC.exists():
        corrected = ("--laser", INTEL, "--every-scan", 10, "--noise", 0.05, "--max-range", 40, "--seed", 1)
        del shown["with free space 0.03 /m²"]
        compare_priors(folder, (*corrected, "--time-budget", 60), shown, IMAGES / "intel-building.png")


def compare_priors(folder: Path, log: tuple[object, ...], priors: Priors, path: Path) -> None:
    """Draw the posteriors of one log under some priors side by side."""
    figure, axes = plt.subplots(1, len(priors), figsize=(13, 4.2), layout="constrained", sharex=True, sharey=True)
    for each, (title, settings) in zip(axes, priors.items(), strict=True):
        run = folder / "run"
        call(prf.cli, "sample", *log, *settings, "-o", run, "--force", "-q")
        show_cells(each, run / "posterior.npz", title)
    save(figure, path)


def photograph(report: Path, path: Path, script: str = "") -> None:
    """Take a screenshot of a report after a script; the picture stays as it is where there is no browser."""
    program = shutil.which("chromium")
    if program is None:
        print(f"{path.name} is left as it is: it needs chromium", file=sys.stderr)
        return
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=program, args=["--no-sandbox"]) as browser,
    ):
        page = browser.new_page(viewport={"width": 1420, "height": 1000})
        page.set_default_timeout(120_000)
        page.goto(report.as_uri())
        page.wait_for_selector("body[data-ready]")
        page.evaluate(script)
        page.screenshot(path=path)
    shrink(path)


def main() -> None:
    """Make every picture."""
    drawings: tuple[Callable[[Path], None], ...] = (draw_office, draw_rooms, draw_town, draw_priors, draw_real_places)
    for draw in drawings:
        with TemporaryDirectory() as folder:
            draw(Path(folder))


if __name__ == "__main__":
    main()
