"""A picture of a simulation: the true map and the path of the robot in it."""

from __future__ import annotations

import numpy as np

from prf.render.layers import fill_map
from prf.shell import pictures as style
from prf.shell.pictures import Target
from prf.simulate.simulation import Simulation


def draw_plan(simulation: Simulation, target: Target) -> None:
    """Draw occupied area, walls that return nothing, and the places of the scans, the first one ringed.

    Parameters
    ----------
    simulation : Simulation
    target : path or binary file
    """
    from matplotlib.collections import LineCollection  # noqa: PLC0415 - half a second

    world, path = simulation.world, simulation.scans.pose[:, :2]
    length = float(np.hypot(*np.diff(path, axis=0).T).sum())
    window = world.window
    small = f"{style.counted(len(path), 'scan')} on {length:,.0f} m  ·  {style.counted(len(world.walls), 'wall')}"
    page, axes = style.map_page(
        window, style.margins_of(window), "Simulated world", f"{small}  ·  {style.window_words(window)}"
    )
    fill_map(axes, world.coloring())
    dark = world.walls[simulation.is_dark].reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(dark), colors=style.OUTLINE, linewidths=1.2, zorder=3), autolim=False)
    dots = 2.0 if len(path) < 400 else 1.0
    axes.plot(*path.T, color=style.PATH, linewidth=0.6, marker="o", markersize=dots, markeredgewidth=0.0, zorder=4)
    axes.plot(*path[:1].T, marker="o", markersize=6.0, color="white", markeredgecolor=style.PATH, zorder=4.1)
    style.save(page, target)
