"""The part of a report that holds the plan of a run of walls: a drawing of it, and its doors."""

from __future__ import annotations

import math

import numpy as np

from prf.model.window import Window
from prf.results import RunData
from prf.results.plan import Plan, plan_of
from prf.shell.cli.page import escape, table
from prf.shell.cli.pictures import counted, number


def plan_section(run: RunData) -> str:
    """Return the part as markup; empty where maps are polygons."""
    if run.walls is None:
        return ""
    plan = plan_of(run)
    spread = np.array([wall.thickness_sd for wall in plan.walls])
    certain = (
        f"; half of the thicknesses are known to {number(100.0 * float(np.median(spread)), 1)} cm"
        if len(spread)
        else ""
    )
    sizes = f"{counted(len(plan.walls), 'wall')} of {number(plan.length, 0)} m in all"
    words = f"{sizes}, {counted(len(plan.doors), 'door')}{certain}."
    rows = [
        ("", (f"({x:.2f}, {y:.2f})", f"{door.width:.2f} ± {door.width_sd:.2f} m", f"{door.probability:.2f}"))
        for door in plan.doors
        for x, y in [door.ends.mean(axis=0).tolist()]
    ]
    doors = table(('<i class="door"></i>door at', "width", "probability"), rows, "list") if rows else ""
    note = (
        "Of the draw of highest posterior density: walls and doors that half of the draws have, fainter the fewer do. "
        "A thickness that no reading showed is that of the prior. As a drawing: prf export --layer walls."
    )
    return (
        f'<section class="panel wide" id="plan"><h2>Plan</h2><p>{escape(words)}</p><div class="sheet">'
        f'{_drawing(plan, run.draws.window)}<div>{doors}<p class="note">{note}</p></div></div></section>'
    )


def _drawing(plan: Plan, window: Window) -> str:
    """Return the walls as thick lines, and the doors as thin ones."""
    lines = [
        f'<path d="M{_place(wall.ends)}" stroke-width="{wall.thickness:.3f}" opacity="{wall.probability:.2f}"/>'
        for wall in plan.walls
    ]
    lines += [
        f'<path class="door" d="M{_place(door.ends)}" stroke-width="0.04" stroke-dasharray="0.1"/>'
        for door in plan.doors
    ]
    box = f"{window.x_min:.2f} {-window.y_max:.2f} {window.width:.2f} {window.height:.2f}"
    return (
        f'<svg viewBox="{box}" role="img" aria-label="Plan of the walls"><g transform="scale(1 -1)" fill="none" '
        f'stroke="currentColor">{"".join(lines)}</g>{_scale_bar(window)}</svg>'
    )


def _scale_bar(window: Window) -> str:
    """Return a bar of a round length at the lower right."""
    tenth = 0.1 * window.width
    power = 10.0 ** math.floor(math.log10(tenth))
    length = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= tenth)
    right, y = window.x_max - 0.02 * window.width, -window.y_min - 0.02 * window.width
    bar = (
        f'<path d="M{right - length:.3f} {y:.3f}H{right:.3f}" stroke="currentColor" stroke-width="{0.05 * tenth:.3f}"/>'
    )
    size = f'font-size="{0.25 * tenth:.3f}" text-anchor="end" fill="currentColor"'
    return f'{bar}<text x="{right:.3f}" y="{y - 0.1 * tenth:.3f}" {size}>{length:g} m</text>'


def _place(ends: np.ndarray) -> str:
    (ax, ay), (bx, by) = ends.tolist()
    return f"{ax:.3f} {ay:.3f}L{bx:.3f} {by:.3f}"
