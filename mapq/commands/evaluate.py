"""Compare inferred labels with the truth: confusion matrix, scores, calibration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.commands._options import ModelFile, load_model
from mapq.configuration import Configuration
from prf.shell.cli.console import is_verbose
from prf.shell.cli.options import Json, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from mapq.results.evaluate import Scores

EXAMPLES = (
    "mapq evaluate city.classified.ply --truth-field truth",
    "mapq evaluate city.patches --model city.model.json --json",
    "mapq evaluate city.patches --max-false-alarms 2%",
)
DETAILS = ("balanced_accuracy", "base_rate", "log_loss", "brier")
"""Scores that only -v prints."""


@with_settings(Configuration, "crf.tolerance", "crf.max_false_alarms")
def evaluate(
    file: Annotated[
        str, typer.Argument(metavar="RESULT|PATCHES", help="What mapq classify wrote, or patches to be classified.")
    ],
    *,
    settings: Loaded[Configuration],
    model: ModelFile = None,
    truth_field: Annotated[
        str | None,
        typer.Option(
            "--truth-field",
            metavar="NAME",
            help="Point field with the truth: 1 suspicious, 0 plausible, 255 unknown, or metres apart.  [labels of "
            "PATCHES, else truth]",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Compare inferred labels with the truth: confusion matrix, scores, calibration.

    The truth of a patch is that of most of its points (a tie is suspicious). Suspicious is the positive label: recall
    is the share of suspicious patches found, specificity the share of plausible ones called plausible. --json
    has the reliability too: of patches with p near 0.7 seven in ten should be suspicious.
    """
    from mapq.results.evaluate import read_labelled, reliability, score_labels
    from prf.shell.cli import console, storage

    chosen = settings.settings.crf
    labelled = read_labelled(file, load_model(model, chosen.max_false_alarms), truth_field, chosen.tolerance)
    scores = score_labels(labelled.label, labelled.truth, labelled.probability)
    bins = reliability(labelled.truth, labelled.probability)
    if json:
        content = {"file": file, "truth": labelled.truth_from, **scores._asdict(), "reliability": bins}
        storage.emit_object("mapq.evaluate/1", content)
        return
    for line in _lines(scores, labelled.truth_from):
        console.emit(line)


def _lines(scores: Scores, truth_from: str) -> Iterator[str]:
    """Return the table for a person."""
    (pp, ps), (sp, ss) = scores.confusion
    yield f"{'truth':<20}{truth_from}"
    without = f", {scores.n_without_truth} more have no truth" if scores.n_without_truth else ""
    yield f"{'patches':<20}{scores.n}{without}"
    yield f"{'inferred':<20}{'plausible':>11}{'suspicious':>12}   in truth"
    yield f"{'  plausible':<20}{pp:>11}{ps:>12}"
    yield f"{'  suspicious':<20}{sp:>11}{ss:>12}"
    for name, value in scores._asdict().items():
        if isinstance(value, float) and (is_verbose() or name not in DETAILS):
            shown = "undefined" if value != value else f"{value:.4f}"
            yield f"{name.replace('_', ' '):<20}{shown}"
    commoner = max(scores.base_rate, 1.0 - scores.base_rate)
    yield f"{'verdict':<20}right for {scores.accuracy:.0%} of the patches; the commoner label for all: {commoner:.0%}"
    yield f"{'':<20}{ss} of the {ps + ss} suspicious ones found; {sp} of the {pp + sp} plausible ones are false alarms"
