"""Train the random field on labelled patches of one or several maps."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.commands._options import Config, MaxFalseAlarms, is_verbose
from prf.shell.options import Assignments, Force, Json, Output, Presets

if TYPE_CHECKING:
    from mapq.model import Model

EXAMPLES = (
    "mapq train city.patches -o city.model.json",
    "mapq train north.patches south.patches -o both.model.json",
    "mapq train city.patches --set crf.edge_model=none --json -o nodes.model.json",
    "mapq train city.patches --max-false-alarms 2% -o careful.model.json",
)
N_IMPORTANT = 4
"""Columns of the trees that are listed without -v."""
SCORES = ("accuracy", "precision", "recall", "mcc", "auc", "ece")
MORE_SCORES = ("balanced_accuracy", "f1", "log_loss")
SHOWN = (0.001, 0.01, 0.02, 0.05, 0.1, 0.2)
"""False alarms of the operating points that the table shows."""


class Objective(StrEnum):
    """Objective of training."""

    pl = "pl"
    max_margin = "max-margin"


def train(
    patches: Annotated[
        list[str], typer.Argument(metavar="PATCHES...", help="Labelled patches, as mapq label leaves them.")
    ],
    output: Output = None,
    config: Config = None,
    preset: Presets = None,
    assignments: Assignments = None,
    objective: Annotated[
        Objective | None,
        typer.Option(
            "--objective", help="pl: maximum pseudo-likelihood; max-margin: structured support vector machine.  [pl]"
        ),
    ] = None,
    conservative: Annotated[
        bool,
        typer.Option("--conservative", help="Patches without a label count as suspicious: not surely plausible."),
    ] = False,
    max_false_alarms: MaxFalseAlarms = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Train the random field on labelled patches of one or several maps.

    Without crf.regularisation in the settings the strength is chosen by cross-validation over regions of the maps,
    which also calibrates the probabilities and counts false alarms. Nothing is random. Default output: model.json. -v
    prints all weights, columns and operating points.
    """
    from mapq.api import train as fit
    from mapq.configuration import load_configuration, sources_of
    from mapq.crf.calibration import with_false_alarms
    from mapq.io.models import SCHEMA, model_content, write_model
    from prf.shell import jsonout
    from prf.shell.files import refuse_inputs
    from prf.shell.lock import claim_output
    from prf.shell.output_names import refuse_other_format
    from prf.shell.streams import refuse_json_beside

    target = output or "model.json"
    refuse_json_beside(target, json)
    given = {"objective": objective, "max_false_alarms": max_false_alarms}
    chosen = load_configuration({"config": config, "preset": preset, "assignments": assignments, **given}, "crf")
    sources = {table: sources_of(chosen, table) for table in ("features", "crf")}
    reading, settings = chosen.settings.features.settings(), chosen.settings.crf.settings()
    if reading.reading == "literal" and "potential" not in sources["crf"]:
        settings = dataclasses.replace(settings, potential="linear")
    claim_output(target, force)
    refuse_other_format(target, (), "a model is written as JSON. Name a .json.")
    refuse_inputs([target], [*patches, config])
    model = fit(patches, settings, reading, conservative=conservative)
    model = dataclasses.replace(model, training={**model.training, "sources": sources})
    share = chosen.settings.crf.max_false_alarms
    if share is not None:
        model = with_false_alarms(model, share, target)
    write_model(target, model)
    if json:
        jsonout.emit_object(SCHEMA, {**model_content(model), "output": target})
        return
    _show(model, target)


def _show(model: Model, target: str) -> None:
    from prf.shell.streams import say_beside

    say = say_beside(target)
    for line in (*_trees(model), *_weights(model), *_held_out(model)):
        say(line)


def _trees(model: Model) -> Iterator[str]:
    """Yield the columns of the trees, by how far they move log-odds on the training maps."""
    rows = model.training.get("importance", {})
    if rows:
        yield f"{'measured':<24}{'moves log-odds by (mean, nats)':>31}"
    ordered = sorted(rows.items(), key=lambda row: -row[1])
    for name, moved in ordered if is_verbose() else ordered[:N_IMPORTANT]:
        yield f"  {name:<22}{moved:>31.3f}"


def _weights(model: Model) -> Iterator[str]:
    """Return the table of weights for a person."""
    if not is_verbose():
        weights = zip(model.parameter_names, model.weights.tolist(), strict=True)
        yield f"{'weights':<24}" + ", ".join(f"{name} {weight:+.4g}" for name, weight in weights)
        return
    scales = {f"node.{name}": row for name, *row in _scaling_rows(model.node)}
    yield f"{'weight':<24}{'standardised':>12}{'median':>12}{'scale':>12}"
    for name, weight in zip(model.parameter_names, model.weights.tolist(), strict=True):
        row = "".join(f"{number:>12.4g}" for number in scales.get(name, ()))
        yield f"{name:<24}{weight:>+12.4f}{row}"
    yield f"{'x_ij':<24}from {model.x_range[0]:.4g} to {model.x_range[1]:.4g}; the coupling is linear between"


def _scaling_rows(scaling: object) -> Iterator[tuple[str, float, float]]:
    names, median, scale = (getattr(scaling, name) for name in ("names", "median", "scale"))
    yield from zip(names, median.tolist(), scale.tolist(), strict=True)


def _held_out(model: Model) -> Iterator[str]:
    """Return how well the model did on regions that it had not seen."""
    made = model.training
    held_out = made["held_out"]
    yield f"{'regularisation':<24}{made['regularisation']:g}, of the coupling {made['coupling_regularisation']:g}"
    yield f"{'calibration':<24}{_calibration(model)}"
    if "n" not in held_out:
        yield "held out                none: too few regions with labels of both kinds; p is not calibrated"
        return
    of = f"{held_out['n']} patches in {held_out['n_folds']} folds"
    yield f"{'held out':<24}{of}, {held_out['base_rate']:.1%} suspicious"
    for name in (*SCORES, *(MORE_SCORES if is_verbose() else ())):
        yield f"  {name.replace('_', ' '):<22}{held_out[name]:.3f}"
    if is_verbose() or model.threshold:
        yield from _operating(model)


def _calibration(model: Model) -> str:
    """Return how p follows from differences of min-marginals, and what the kinds were chosen by."""
    found = model.calibration
    numbers = f"{len(found.knots)} knots" if len(found.knots) else f"slope {found.slope:.4g}"
    shift = f", intercept {found.intercept:+.4g}" if found.kind == "platt" else ""
    tried = model.training["held_out"]["calibrations"]
    losses = ", ".join(f"{kind} {loss:.4f}" for kind, loss in tried.items())
    return f"{found.kind}, {numbers}{shift}" + (f"; held-out log-loss: {losses}" if losses else "")


def _operating(model: Model) -> Iterator[str]:
    """Return a few operating points: what a threshold costs, and what it finds."""
    yield f"{'--max-false-alarms':<24}{'found':>8}{'difference from':>18}"
    for share, threshold, recall in model.operating.tolist():
        if share in SHOWN:
            yield f"  {share:<22.1%}{recall:>8.1%}{threshold:>18.3f}"
    if model.threshold:
        yield f"{'threshold':<24}{model.threshold:.4g} nats, by --max-false-alarms"
