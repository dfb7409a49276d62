"""The readings that a run used: beams, impacts, path of the sensor (figure 4 (d) of Paskin & Thrun 2005)."""

from __future__ import annotations

import numpy as np

from prf.logs import Readings
from prf.render import layers
from prf.run import Run, names
from prf.shell import pictures as style
from prf.shell.pictures import Target


def render_beams(
    run: Run, target: Target, *, outline: bool = False, path: bool = True, title: str | None = None
) -> None:
    """Draw beams and impacts of the laser, arcs of the sonar, the sensor's path, and points with their values.

    `run`: with readings. `outline`: draw the edges of the best map over them. `path`: draw the sensor's path. `title`:
    instead of the default one.
    """
    if run.sensors is None and run.points is None:
        raise run.missing(names.READINGS)
    window = run.draws.window
    words = [_words(part) for part in (run.laser, run.sonar) if part is not None]
    words += [style.counted(len(run.points.value), "point")] if run.points is not None else []
    small = "  ·  ".join([run.name, *words])
    page, axes = style.map_page(window, style.margins_of(window), title or "Readings", small)
    if run.laser is not None:
        layers.draw_beams(axes, run.laser)
    if run.sonar is not None:
        layers.draw_cones(axes, run.sonar)
    if outline and run.best is not None:
        layers.draw_outline(axes, run.best)
    if run.laser is not None:
        layers.draw_impacts(axes, run.laser)
    if run.points is not None:
        layers.draw_points(axes, run.points)
    if path and run.sensors is not None:
        layers.draw_path(axes, run.sensors)
    style.save(page, target)


def _words(readings: Readings) -> str:
    """Return how many readings of a sensor there are, and how many are not drawn."""
    n, n_scans = len(readings.angle), style.counted(len(readings.sensor_path()), "scan")
    n_silent = int(np.count_nonzero(~readings.returned))
    what = style.counted(n, "sonar reading" if readings.cone.any() else "beam")
    return f"{what} in {n_scans}  ·  {n_silent:,} without return below {readings.max_range:.4g} m (not drawn)"
