"""The command line `prf`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from prf import __version__
from prf.shell.cli.app import make_app
from prf.shell.cli.run import run_app

HELP = """Polygonal maps from range readings: posterior, best map, answers with probabilities.

Readings come as CARMEN or Player logs, ROS bags or tables; .gz is read as is and - is standard input.
"""

VERBS: dict[str, str] = {
    "sample": "Draw the posterior over polygonal maps from localized readings, or values at points.",
    "anneal": "Find the one best polygonal map of localized readings, or values at points.",
    "info": "Show what is in a log: scans, beams, extent, ranges, and what looks suspicious.",
    "prior": "Draw maps from the prior, exactly or by Markov chain.",
    "query": "Query how probably points, squares or a path are occupied or free.",
    "explore": "Find where to look next: places from which one scan is expected to settle most.",
    "inspect": "Show what a result is, how it was made, and the state of its files.",
    "config": "Show all settings as a settings file, or list presets.",
    "grid": "Build an occupancy grid, the baseline, from localized readings.",
    "score": "Score how well a map predicts held-out readings.",
    "calibrate": "Fit the parameters of sensors to readings in a known map.",
    "render": "Draw a picture of a run, of a grid, or of draws from the prior.",
    "report": "Write a report on a run: one page of HTML that opens without a network.",
    "simulate": "Simulate a robot in a world that is known: logs of laser and sonar, with their truth.",
    "export": "Write a map for other programs: GeoJSON, ROS map_server, SVG, DXF, netCDF; or its trajectory: TUM, g2o.",
    "warm": "Compile the kernels ahead: for container images, CI, and machines that must answer at once.",
}
"""Verb to its summary: the first line of the docstring of ``prf/commands/<verb>.py``, as a test compares."""

app = make_app("prf", __version__, HELP, "prf.commands", VERBS)


def main(args: Sequence[str] | None = None) -> None:
    """Run `prf` with `args` (default: the process's) and exit."""
    sys.exit(run_app(app, "prf", args))
