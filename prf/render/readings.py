"""The readings that a run used: beams, impacts, path of the sensor (figure 4 (d) of Paskin & Thrun 2005)."""

from __future__ import annotations

import numpy as np

from prf.render import layers
from prf.run import Run, names
from prf.shell import pictures as style
from prf.shell.pictures import Target


def render_beams(
    run: Run, target: Target, *, outline: bool = False, path: bool = True, title: str | None = None
) -> None:
    """Draw beams, impacts and the sensor's path.

    Parameters
    ----------
    run : Run
        With beams.
    target : path or binary file
    outline : bool
        Draw the edges of the best map over them.
    path : bool
        Draw the sensor's path.
    title : str, optional
        Instead of the default one.

    Raises
    ------
    InputError
        If the run has no beams.
    """
    if run.beams is None:
        raise run.missing(names.READINGS)
    beams = run.beams
    window = run.draws.window
    n_silent = int(np.count_nonzero(~(beams.range < beams.max_range)))
    small = "  ·  ".join(
        [
            run.name,
            f"{style.counted(len(beams.angle), 'beam')} in {style.counted(len(beams.sensor_path()), 'scan')}",
            f"{n_silent:,} without return below {beams.max_range:.4g} m (not drawn)",
        ]
    )
    page, axes = style.map_page(window, style.margins_of(window), title or "Readings", small)
    layers.draw_beams(axes, beams)
    if outline and run.best is not None:
        layers.draw_outline(axes, run.best)
    layers.draw_impacts(axes, beams)
    if path:
        layers.draw_path(axes, beams)
    style.save(page, target)
