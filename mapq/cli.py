"""The command line `mapq`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from mapq import __version__
from prf.shell.cli.app import make_app
from prf.shell.cli.run import run_app

HELP = "How plausible a point cloud map is, plane patch by plane patch."

VERBS: dict[str, str] = {
    "segment": "Cut a cloud into plane patches by region growing.",
    "label": "Label patches plausible or suspicious: by hand on a page, or by the majority of a point field.",
    "train": "Train the random field on labelled patches of one or several maps.",
    "classify": "Label the patches of a map plausible or suspicious, with reasons.",
    "compare": "Compare two maps of one place: which is better, and where.",
    "evaluate": "Compare inferred labels with the truth: confusion matrix, scores, calibration.",
    "features": "Show the features of every patch and of every pair of neighbours.",
    "report": "Write a report on a result: one page of HTML that opens without a network.",
    "render": "Draw a map in plan view and in 3D, plausible blue and suspicious red.",
    "inspect": "Show the contents of a file: a cloud, PATCHES, a RESULT, or a model.",
    "config": "Show all settings as a settings file, or list presets.",
    "simulate": "Make a map with known errors: an urban world, driven through and rendered from odometry.",
    "perturb": "Make a labelled map from posed scans: merged as they are, or with known errors of their poses.",
    "warm": "Compile the kernels ahead: for container images, CI, and machines that must answer at once.",
}

app = make_app("mapq", __version__, HELP, "mapq.commands", VERBS)


def main(args: Sequence[str] | None = None) -> None:
    """Run `mapq` with `args` (default: the process's) and exit."""
    sys.exit(run_app(app, "mapq", args))
