"""Train the random field on labelled patches of one or several maps."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.configuration import Configuration, TrainSettings, sources_of
from prf.shell.cli.console import is_verbose
from prf.shell.cli.options import Force, Json, Output, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from mapq.model import Model

EXAMPLES = (
    "mapq train city.patches -o city.model.json",
    "mapq train north.patches south.patches -o both.model.json",
    "mapq train city.patches --set crf.edge_model=none --json -o nodes.model.json",
    "mapq train city.patches --max-false-alarms 2% -o careful.model.json",
)
N_IMPORTANT = 3
"""Columns of the trees that are listed without -v."""
SCORES = ("accuracy", "precision", "recall", "mcc", "auc", "ece")
MORE_SCORES = ("balanced_accuracy", "f1", "log_loss")


@with_settings(
    Configuration, "features", *(f"crf.{name}" for name in TrainSettings.model_fields if name != "tolerance")
)
def train(
    patches: Annotated[list[str], typer.Argument(metavar="PATCHES...", help="Labelled patches, from mapq label.")],
    *,
    settings: Loaded[Configuration],
    output: Output = None,
    conservative: Annotated[
        bool,
        typer.Option("--conservative", help="Patches without a label count as suspicious: not surely plausible."),
    ] = False,
    json: Json = False,
    force: Force = False,
) -> None:
    """Train the random field on labelled patches of one or several maps.

    Without crf.regularisation in the settings the strength is chosen by cross-validation over regions of the maps,
    which also calibrates the probabilities and counts false alarms. Nothing is random. Default output: model.json. -v
    prints all columns and scores.
    """
    from mapq.api import train as fit
    from mapq.io.models import SCHEMA, model_content, write_model
    from prf.shell.cli import storage
    from prf.shell.cli.console import say_beside
    from prf.shell.cli.outputs import claim_output

    target = output or "model.json"
    sources = {table: sources_of(settings, table) for table in ("features", "crf")}
    claim_output(target, force, inputs=[*patches, settings.file], suffixes=(".json",), json=json)
    model = fit(patches, settings.settings.crf, settings.settings.features, conservative=conservative)
    model = dataclasses.replace(model, training={**model.training, "sources": sources})
    write_model(target, model)
    if json:
        storage.emit_object(SCHEMA, {**model_content(model), "output": target})
        return
    say = say_beside(target)
    for name, value in (*_fitted(model), *_held_out(model), ("model", target)):
        say(f"{name:<24}{value}")


def _fitted(model: Model) -> Iterator[tuple[str, str]]:
    """Yield by how much the columns of the trees move log-odds on the training maps, and the weights of the field."""
    moved = sorted(model.training.get("importance", {}).items(), key=lambda row: -row[1])
    if moved:
        yield "measured", "moves log-odds by (mean, nats)"
    for name, nats in moved if is_verbose() else moved[:N_IMPORTANT]:
        yield f"  {name}", f"{nats:.3f}"
    yield (
        "weights",
        ", ".join(
            f"{name} {weight:+.4g}" for name, weight in zip(model.parameter_names, model.weights.tolist(), strict=True)
        ),
    )
    made = model.training
    if not is_verbose():
        return
    yield "regularisation", f"{made['regularisation']:g}, of the coupling {made['coupling_regularisation']:g}"


def _held_out(model: Model) -> Iterator[tuple[str, str]]:
    """Yield how well the model did on regions that it had not seen."""
    held_out = model.training["held_out"]
    losses = ", ".join(f"{kind} {loss:.4f}" for kind, loss in held_out["calibrations"].items())
    yield "calibration", model.calibration.kind + (f"; held-out log-loss: {losses}" if losses else "")
    if "n" not in held_out:
        yield "held out", "none: too few regions with labels of both kinds; p is not calibrated"
        return
    of = f"{held_out['n']} patches in {held_out['n_folds']} folds"
    yield "held out", f"{of}, {held_out['base_rate']:.1%} suspicious"
    for name in (*SCORES, *(MORE_SCORES if is_verbose() else ())):
        yield f"  {name.replace('_', ' ')}", f"{held_out[name]:.3f}"
    if model.threshold:
        yield "threshold", f"{model.threshold:.4g} nats, by --max-false-alarms"
