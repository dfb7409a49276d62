"""`write_report`: one file of HTML that needs nothing else."""

from __future__ import annotations

from typing import Any, NamedTuple

from prf.output.export.cells import cut_to_known
from prf.output.export.source import Map
from prf.output.report.embedded import Numbers, fitting, pack_image, pack_scene, step_of
from prf.output.report.words import (
    agreement_line,
    functional_table,
    headline,
    origin_table,
    settings_table,
    title_of,
    trajectory_line,
)
from prf.results import RunData, map_text, names
from prf.shell.cli.files import encoded, open_output
from prf.shell.cli.page import escape, packed_json, page
from prf.shell.errors import InputError

SCRIPTS = ("draws.js", "estimate.js", "map.js", "report.js")


class Written(NamedTuple):
    """Size of a report: bytes, draws in it, and those of the run."""

    n_bytes: int
    n_embedded: int
    n_draws: int


def write_report(path: str, run: RunData, title: str | None = None) -> Written:
    """Write the report on a run, whole or not at all; ``-`` is standard output.

    `title` instead of the names of the logs. InputError if the run has no draws, or no image yet.
    """
    if len(run.draws) == 0:
        raise InputError(f"{run.name}: no draws yet, so there is nothing to report. Resume with prf sample --resume.")
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    kept, draws = fitting(run)
    cells, scene = pack_image(run.image), pack_scene(run)
    content = {
        "title": escape(title or title_of(run)),
        "run": escape(run.name),
        "headline": headline(run),
        "agreement": f"{agreement_line(run)} {trajectory_line(run)}".strip(),
        "functionals": functional_table(run),
        "made": origin_table(run),
        "settings": settings_table(run),
        "aspect": f"{run.draws.window.height / run.draws.window.width:.3f}",
        "share": _share(len(kept.draws), len(run.draws)),
        "data": packed_json(_data(run, draws, cells, scene)),
        "draws": draws.text,
        "cells": cells.text,
        "scene": scene.text,
    }
    text = page("prf.output.report", "report", content, [("prf.output.report", script) for script in SCRIPTS])[0]
    with open_output(path) as stream:
        stream.write(text)
    return Written(len(encoded(text)), len(kept.draws), len(run.draws))


def _data(run: RunData, draws: Numbers, cells: Numbers, scene: Numbers) -> dict[str, Any]:
    window = run.draws.window
    return {
        "name": run.name,
        "window": list(window),
        "step": step_of(window),
        "draws": draws.head,
        "cells": cells.head,
        "scene": scene.head,
        "map": _best_map(run),
    }


def _best_map(run: RunData) -> str | None:
    """Return the best map as `prf export --format geojson` writes it: it ends where readings do."""
    if run.best is None:
        return None
    best = cut_to_known(Map(run.best, {"log_posterior": run.best_log_posterior}, run.name), run.image, 0.0)
    return map_text(best.coloring, best.properties)


def _share(n_embedded: int, n_draws: int) -> str:
    if n_embedded == n_draws:
        return f"all {n_draws:,} draws of the run, as prf query"
    return f"{n_embedded:,} of the {n_draws:,} draws, evenly thinned to keep the page small; prf query uses all"
