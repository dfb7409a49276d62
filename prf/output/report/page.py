"""`write_report`: one file of HTML that needs nothing else, its words and its tables."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from prf.output.export.cells import cut_to_known, returned
from prf.output.export.source import Map
from prf.output.report.embedded import Numbers, fitting, pack_image, pack_scene, step_of
from prf.output.report.plan import plan_section
from prf.output.report.truth import truth_section
from prf.poses.truth import TrueErrors
from prf.readings import log_stem
from prf.results import RunData, map_text, names
from prf.results.convergence import Diagnosis, range_words, time_words
from prf.results.disputes import disputes
from prf.results.explore import explore
from prf.shell.cli.console import reported
from prf.shell.cli.files import encoded, open_output
from prf.shell.cli.outputs import beside
from prf.shell.cli.page import escape, packed_json, page, table
from prf.shell.cli.pictures import counted, number, window_words
from prf.shell.errors import InputError

SCRIPTS = ("draws.js", "estimate.js", "map.js", "report.js")


def write_report(path: str, run: RunData, title: str | None = None, truth: TrueErrors | None = None) -> tuple[int, int]:
    """Write the report on a run, whole or not at all; ``-`` is standard output.

    `title` instead of the names of the logs. `truth`: errors of its trajectory by a file of true poses. InputError if
    the run has no draws, or no image yet.
    Returns its size in bytes, and how many draws are in it.
    """
    text, n_embedded, _ = report_document(run, title, truth)
    with open_output(path) as stream:
        stream.write(text)
    return len(encoded(text)), n_embedded


def report_document(
    run: RunData, title: str | None = None, truth: TrueErrors | None = None, edition: int = 0
) -> tuple[str, int, str]:
    """Return the report as :func:`write_report` writes it, how many draws are in it, and its content security policy.

    `edition`: number of a page of a run under way, which asks for the next one (:mod:`prf.output.report.live`), and
    has neither returns nor places to look from.
    """
    if len(run.draws) == 0:
        raise InputError(f"{run.name}: no draws yet, so there is nothing to report. Resume with prf sample --resume.")
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    with reported(not edition, 3, "making the page") as report:
        kept, draws = fitting(run)
        report(1)
        returns = None if edition else returned(run, run.image.resolution)
        report(2)
        places = [] if edition else places_of(run)
        report(3)
    cells, scene = pack_image(run.image, returns), pack_scene(run)
    content = {
        "title": escape(title or title_of(run)),
        "run": escape(run.name),
        "of_run": "" if run.path is None or run.name == (title or title_of(run)) else f", run {escape(run.name)}",
        "state": _state(run) if edition else "",
        "headline": headline(run),
        "agreement": "<br>".join(filter(None, (agreement_line(run), trajectory_line(run), dispute_line(run)))),
        "plan": plan_section(run),
        "truth": truth_section(truth),
        "functionals": functional_table(run),
        "made": origin_table(run),
        "settings": settings_table(run),
        "aspect": f"{run.draws.window.height / run.draws.window.width:.3f}",
        "share": _share(len(kept.draws), len(run.draws)),
        "data": packed_json({"edition": edition, **_data(run, draws, cells, scene), "places": places}),
        "draws": draws.text,
        "cells": cells.text,
        "scene": scene.text,
    }
    scripts = [("prf.output.report", script) for script in SCRIPTS]
    text, policy = page("prf.output.report", "report", content, scripts, "; connect-src 'self'" if edition else "")
    return text, len(kept.draws), policy


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


def page_beside(run: str | os.PathLike[str]) -> str:
    """Return where the report on the run in a directory goes when nobody says."""
    folder = Path(run) if Path(run).name.strip(".") else Path(run).resolve()
    return beside(folder, f"{folder.name}.html")


def places_of(run: RunData) -> list[dict[str, float]]:
    """Return the best places to look from, in brief; none where `prf explore` finds nothing to say."""
    try:
        found = explore(run, is_brief=True)
    except InputError:  # no readings, or no free ground where the sensor was last: the page has all else to show
        return []
    columns = {"x": found.xy[:, 0], "y": found.xy[:, 1], "theta": found.theta, "gain": found.gain}
    rows = [column[found.shown()].round(3).tolist() for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*rows, strict=True)]


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


def _state(run: RunData) -> str:
    """Return how far a run under way is."""
    made = run.manifest
    done = f"{made.get('steps') or 0:,} steps a chain in {time_words(made.get('seconds') or 0.0)}"
    return f"Under way: {done}; this page follows. Returns and where to look next come at the end."


def title_of(run: RunData) -> str:
    """Return what was mapped: the names of the logs, not that of their poses; else that of the run."""
    poses = (run.manifest.get("configuration") or {}).get("poses") or ()
    logs = [name for own in (run.manifest.get("logs") or {}).values() for name in own]
    inputs = [str(row.get("path")) for row in run.manifest.get("inputs") or ()]
    wanted = [path for path in inputs if (path in logs if logs else path not in poses)]
    stems = dict.fromkeys(filter(None, map(log_stem, wanted)))
    return ", ".join(list(stems)[:2]) or run.name


def headline(run: RunData) -> str:
    """Return what was mapped from what."""
    parts = [
        counted(run.laser.n_beams, "laser beam") if run.laser is not None else "",
        counted(run.sonar.n_beams, "sonar reading") if run.sonar is not None else "",
        counted(len(run.points.value), "point observation") if run.points is not None else "",
    ]
    readings = " and ".join(part for part in parts if part) or "no reading"
    draws = f"{counted(len(run.draws), 'map')} drawn by {counted(run.n_chains, 'chain')}"
    return f"{draws} from {readings}, over a window of {window_words(run.draws.window)}."


def agreement_line(run: RunData) -> str:
    """Return whether the chains agree, as markup; each place where they differ is a button."""
    found, diagnosed = None if run.image is None else run.image.agreement(), run.diagnostics or {}
    state = {True: "converged", False: "not converged", None: "agreement unknown"}[diagnosed.get("converged")]
    tag = f'<span class="tag {state.split()[0]}">{state}</span> '
    if found is None or math.isnan(found.seen):
        return f"{tag}Where the chains agree is not known: that takes two of them."
    if run.is_early:
        return f"{tag}The run is too short to say where the chains agree{_outlook(diagnosed)}."
    line = f"{tag}The chains agree on {math.floor(100.0 * found.seen)} % of the seen ground"
    if found.places:
        last = len(found.places) - 1
        places = [_place_button(place, "," if i < last else "") for i, place in enumerate(found.places)]
        line += f", and differ most at {' '.join(places)}"
    return f"{line}{_outlook(diagnosed)}."


def _place_button(place: tuple[float, float, float, float], after: str) -> str:
    at = f"{place[0]:.2f},{place[1]:.2f},{math.sqrt(place[2]):.2f}"
    x, y = (number(round(value, 1) + 0.0, 1) for value in place[:2])  # never a negative zero
    return f'<span class="keep"><button type="button" class="link" data-place="{at}">({x}, {y})</button>{after}</span>'


def _outlook(diagnosed: Mapping[str, Any]) -> str:
    if diagnosed.get("converged") is False and diagnosed.get("trend") == "flat":
        return "; more time alone will not help"
    seconds = diagnosed.get("suggested_seconds")
    least = diagnosed.get("suggested_least", seconds)
    return f"; {range_words(least, seconds)} more may bring agreement" if seconds else ""


def trajectory_line(run: RunData) -> str:
    """Return how far poses that were sampled are from the given ones, and how well they are known."""
    if run.trajectory is None:
        return ""
    farthest = float(np.hypot(*run.trajectory.correction[:, :2].T).max())
    length = f"{number(100.0 * farthest, 1)} cm" if farthest < 1.0 else f"{number(farthest, 2)} m"
    return f"{run.trajectory.words()}. The farthest pose moved {length}."


def dispute_line(run: RunData) -> str:
    """Return where logs of the run contradict each other, as markup; each place is a button."""
    found = [
        f"{escape(each.log)} at {_place_button((each.x, each.y, 1.0, 0.0), f', {each.n_readings} readings')}"
        for each in disputes(run)
    ]
    return f"Logs contradict each other, as if something had moved: {'; '.join(found)}." if found else ""


def functional_table(run: RunData) -> str:
    """Return R-hat and effective sample size of every functional, those that do not agree first."""
    rows = (run.diagnostics or {}).get("functionals") or {}
    found = {name: _diagnosis(row) for name, row in rows.items()}
    order = sorted(found, key=lambda name: (found[name].agrees(), -found[name].shortfall()))
    head = ("quantity", "R-hat", "ESS", "ground", "")
    return table(head, [("", (escape(name), *_cells(found[name]))) for name in order], "list")


def _diagnosis(row: Mapping[str, Any]) -> Diagnosis:
    rhat, ess = (math.nan if row.get(name) is None else float(row[name]) for name in ("rhat", "ess"))
    return Diagnosis(rhat, ess, row.get("state", "short"), bool(row.get("seen", True)))


def _cells(found: Diagnosis) -> tuple[str, ...]:
    varies = found.state == "varies"
    state = f'<span class="{"good" if found.agrees() else "bad"}">{"agrees" if found.agrees() else "disagrees"}</span>'
    if not varies:
        state += f" <small>{escape(found.describe())}</small>"
    figures = (f"{found.rhat:.3f}", number(found.ess, 0)) if varies else ("–", "–")
    return *figures, "seen" if found.seen else "not seen", state


def origin_table(run: RunData) -> str:
    """Return how the run was made: command, inputs, seed, steps, versions."""
    made = run.manifest
    rows = [
        ("run", run.name),
        ("created", made.get("created")),
        ("command", " ".join(map(str, made.get("command") or ()))),
        *(("input", f"{row.get('path')}, sha256 {row.get('sha256')}") for row in made.get("inputs") or ()),
        ("status", made.get("status")),
        ("steps a chain", f"{counted(made.get('steps') or 0, 'step')}, {made.get('burn_in') or 0:,} of them burn-in"),
        ("sampling time", time_words(made["seconds"]) if made.get("seconds") else None),
        ("seed", made.get("seed")),
        ("versions", ", ".join(f"{name} {version}" for name, version in (made.get("versions") or {}).items())),
    ]
    return _plain(rows)


def settings_table(run: RunData) -> str:
    """Return the settings of the run, those that were given first."""
    given: Mapping[str, Any] = run.manifest.get("sources") or {}
    settings = run.manifest.get("configuration") or {}
    order = sorted(settings, key=lambda name: (name not in given, name))
    shown = {name: _setting(settings[name]) for name in order}
    return _plain([(name, f"{text}  ({given[name]})" if name in given else text) for name, text in shown.items()])


def _setting(value: Any) -> str:
    """Return a setting in a few digits: the manifest of the run has all."""
    if isinstance(value, list | tuple):
        return ", ".join(map(_setting, value))
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _plain(rows: list[tuple[str, Any]]) -> str:
    shown = [(name, str(value)) for name, value in rows if value not in (None, "")]
    return table(("", ""), [("", (escape(name), escape(value))) for name, value in shown], "plain")
