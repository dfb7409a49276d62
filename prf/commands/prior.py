"""Draw maps from the prior, exactly or by Markov chain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from prf.configuration import Configuration, Prior
from prf.shell.cli.options import Force, Json, Output, Seed, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from prf.model.coloring import Draws
    from prf.model.orientation import Orientation

EXAMPLES = (
    "prf prior --scale 1 --window 0 0 1 1 --draws 1000 --method exact --seed 1 -o draws.geojsonl",
    "prf prior --scale 0.4 --window -5 -5 5 5 --draws 500 --method mcmc --seed 1 --json",
    "prf prior --scale 0.1 --window 0 0 40 30 --set prior.orientation=4 --draws 1 -o - | head -c 300",
)


Method = Literal["exact", "mcmc"]
"""How to draw."""


@with_settings(Configuration, "prior", shown={"prior.window": "must be given"})
def prior(
    *,
    draws: Annotated[int, typer.Option("--draws", metavar="N", min=1, help="How many draws.")],
    method: Annotated[
        Method,
        typer.Option("--method", help="Independent draws by the particle system, or the sampler without readings."),
    ] = "exact",
    thin: Annotated[
        int | None,
        typer.Option("--thin", metavar="STEPS", min=1, help="Steps of the chain from draw to draw; chosen if absent."),
    ] = None,
    settings: Loaded[Configuration],
    seed: Seed = None,
    output: Output = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Draw maps from the prior, exactly or by Markov chain.

    The output has one GeoJSON Feature a line: a MultiLineString with one two-point line an edge, and the property
    anchor_black, the colour of the window's centre. The chain starts all white and discards a burn-in.
    """
    from prf.model.arak import compare
    from prf.model.coloring import feature_lines
    from prf.model.orientation import Orientation
    from prf.shell.cli import storage
    from prf.shell.cli.console import say_beside
    from prf.shell.cli.files import open_output
    from prf.shell.cli.outputs import claim_output
    from prf.shell.cli.storage import resolve_seed
    from prf.shell.errors import UsageError

    known = settings.settings.prior
    if known.window is None:
        raise UsageError("prf prior has no readings to choose a window by: give --window X0 Y0 X1 Y1.")
    if thin is not None and method == "exact":
        raise UsageError("--thin is for --method mcmc: exact draws are independent.")
    if output is not None:
        claim_output(output, force, suffixes=(".geojsonl", ".geojson", ".txt"), json=json)
    used_seed = resolve_seed(seed)
    orientation = Orientation.of(known.orientation, known.orientation_angle)
    drawn, used_thin = _draw(method, known, orientation, draws, thin, used_seed)
    if output is not None:
        with open_output(output) as stream:
            stream.writelines(f"{line}\n" for line in feature_lines(drawn))
    comparison = compare(drawn, known.scale, orientation, known.free_space)
    if json:
        made = {"method": method, **known.model_dump(), "seed": used_seed, "thin": used_thin}
        storage.emit_object("prf.prior/1", {**made, **comparison, "output": output})
        return
    say = say_beside(output)
    for line in (*_lines(comparison, used_seed, used_thin), *([f"wrote       {output}"] if output else ())):
        say(line)


def _draw(
    method: Method, known: Prior, orientation: Orientation, n_draws: int, thin: int | None, seed: int
) -> tuple[Draws, int | None]:
    """Return the draws, and the steps between two draws of the chain (None for exact draws)."""
    from prf.model.window import Window

    assert known.window is not None
    scale, window = known.scale, Window(*known.window)
    if method == "exact":
        from prf.model.arak import exact_draws
        from prf.shell.cli.storage import spawn_generators

        rng = spawn_generators(seed, 1)[0]
        return exact_draws(scale, window, n_draws, rng, orientation, known.free_space), None
    from prf.sampler.prior import mcmc_draws

    return mcmc_draws(scale, window, n_draws, thin, seed, orientation, known.free_space)


def _lines(comparison: Mapping[str, float | None], seed: int, thin: int | None) -> list[str]:
    """Return the table for a person."""

    def law(name: str, unit: str) -> str:
        expected = comparison[f"expected_{name}"]
        known = "no exact law" if expected is None else f"by the exact law {expected:.4f}{unit}"
        return f"mean {comparison[f'mean_{name}']:.4f}{unit}, {known}"

    return [
        f"draws       {comparison['n_draws']}",
        f"edges       {law('edges', '')}",
        f"length      {law('length', ' m')}",
        f"seed        {seed}",
        f"thin        {'independent draws' if thin is None else f'{thin} steps from draw to draw'}",
    ]
