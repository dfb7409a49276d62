"""Find the one best polygonal map of localized readings, or values at points."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.commands import _options as o
from prf.configuration import Configuration, named_sources
from prf.shell.cli.options import Force, Json, Output, Seed, Threads, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prf.sampler.anneal import Annealed
    from prf.sampler.session import StopRule
    from prf.shell.cli.console import Report
    from prf.shell.cli.run import StopFlag

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf anneal --laser data/demo-office.log.gz -o office.geojson",
    "prf anneal --laser intel.log.gz --every-scan 10 --steps 5000000 --seed 1",
    "prf anneal --sonar ring.csv --config site.toml --time-budget 60",
)

READ = (
    *("prior", "laser", "sonar", "points", "thinning", "readings", "driven"),
    *("sampler.chains", "sampler.start", "anneal"),
)
"""What annealing reads of the settings: its chains have neither tiles nor a ladder, and poses as they are given."""
DEFAULT_STEPS = 3_000_000
FAR_APART = 10.0
"""Nats between the two best chains above which the search was too short, or hard: one would do what the other did."""


@with_settings(Configuration, *READ, shown={"driven.radius": "0.1"})
def anneal(
    *,
    laser: o.Laser = None,
    sonar: o.Sonar = None,
    point_data: o.PointData = None,
    output: Output = None,
    settings: Loaded[Configuration],
    steps: Annotated[
        int | None, typer.Option("--steps", metavar="N", min=1, help=f"Steps a chain in all.  [{DEFAULT_STEPS:,}]")
    ] = None,
    time_budget: o.TimeBudget = None,
    simplify: Annotated[
        float | None,
        typer.Option("--simplify", metavar="NATS", min=0.0, help="Then fewer vertices, losing at most so much."),
    ] = None,
    seed: Seed = None,
    threads: Threads = 0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find the one best polygonal map of localized readings, or values at points.

    Chains are cooled from the posterior to its mode, and end by taking only what is better; the best map that any saw
    is written, its occupied area as a GeoJSON MultiPolygon. What is maximised is the density over the lines of the map,
    |E| log p - 2 p length + log likelihood. Ctrl-C writes the best map so far.
    """
    options = locals()

    from prf.sampler.prepare import with_poses
    from prf.sampler.session import StopRule, default_output
    from prf.shell.cli.outputs import claim_output
    from prf.shell.cli.storage import resolve_seed
    from prf.shell.errors import UsageError

    logs = [*(laser or ()), *(sonar or ()), *filter(None, (point_data,))]
    if not logs:
        raise UsageError("Nothing to map: give --laser LOG, --sonar LOG or --point-data FILE.csv.")
    if steps is not None and time_budget is not None:
        raise UsageError("--steps and --time-budget: give one of them.")
    config = settings.settings
    if simplify is not None and config.prior.is_walls:
        raise UsageError("--simplify: walls have no vertices to give up. Leave it out beside --prior walls.")
    target = output or str(default_output(logs[0]).with_suffix(".geojson"))
    logs = with_poses(logs, config)
    claim_output(target, force, inputs=[*logs, settings.file], suffixes=(".geojson",), json=json)
    used_seed = resolve_seed(seed)
    rule = StopRule(None if time_budget is not None else steps or DEFAULT_STEPS, time_budget)
    inputs = (laser or (), sonar or (), point_data)
    found, made, stop = _cool(inputs, config, rule, used_seed, threads, simplify)
    text = _write(target, found, {**made, "sources": named_sources(settings)}, logs)
    _report(found, text, target, made, json)
    stop.raise_if_requested(f"interrupted after {found.steps} steps; {target} has the best map so far")


def _shown_by(reporter: Report, stop: StopFlag) -> Callable[[Annealed], None]:
    """Return what shows the best map so far, and from then on keeps it where a signal comes."""

    def show(now: Annealed) -> None:
        stop.has_result = True
        reporter(now.share, T=f"{now.temperature:.2g}", best=f"{now.score:,.1f}")

    return show


def _cool(
    inputs: tuple[Sequence[str], Sequence[str], str | None],
    config: Configuration,
    rule: StopRule,
    seed: int,
    threads: int,
    budget: float | None,
) -> tuple[Annealed, dict[str, Any], Any]:
    """Return what annealing found, how it was made, and whether it was interrupted."""
    import os
    from concurrent.futures import ThreadPoolExecutor

    from prf.sampler.anneal import anneal as cool
    from prf.sampler.anneal import simplified
    from prf.sampler.prepare import describe_readings, read_prepared
    from prf.shell.cli.console import progress
    from prf.shell.cli.pictures import counted
    from prf.shell.cli.run import graceful_stop
    from prf.shell.cli.storage import spawn_generators

    laser, sonar, point_data = inputs
    prepared = read_prepared(laser, config, sonar, point_data)
    prepared.announce()
    n_beams = 0 if prepared.target.laser is None else prepared.target.laser.readings.n_beams
    readings = describe_readings(prepared.target, prepared.n_beams_thinned)
    logger.info(f"{readings}, {counted(config.sampler.chains, 'chain')}, seed {seed}")
    pool = ThreadPoolExecutor(threads or len(os.sched_getaffinity(0)))
    with pool, graceful_stop(has_result=False) as stop, progress(1.0, "annealing") as reporter:
        found = cool(
            prepared.target,
            spawn_generators(seed, config.sampler.chains),
            rule,
            pool.map,
            config.anneal,
            starts_from=prepared.config.sampler.start or "empty",
            on_progress=_shown_by(reporter, stop),
            stop_requested=lambda: stop.requested,
        )
    if budget is not None and not stop.requested:
        rng = spawn_generators(seed, config.sampler.chains + 1)[-1]
        with graceful_stop() as stop, progress(1.0, "simplifying") as reporter:
            found = simplified(
                found,
                prepared.target,
                budget,
                rng,
                on_progress=lambda share, now: reporter(share, vertices=now.best.n_vertices),
                stop_requested=lambda: stop.requested,
            )
    made = {
        "score": found.score,
        "steps": found.steps,
        "seed": seed,
        "configuration": prepared.config.flat(READ),
        "n_beams": n_beams,
        "n_beams_thinned": prepared.n_beams_thinned,
    }
    if found.walls is not None:
        made["walls"] = found.walls.tolist()
    return found, made, stop


def _write(target: str, found: Annealed, made: dict[str, Any], logs: list[str]) -> str:
    """Write the map file; return its text."""
    from prf.results.geojson import map_text
    from prf.shell.cli.files import open_output
    from prf.shell.cli.storage import describe_process

    text = map_text(found.best, {**made, **describe_process(logs)})
    with open_output(target) as stream:
        stream.write(text)
    return text


def _report(found: Annealed, text: str, target: str, made: dict[str, Any], json: bool) -> None:
    """Print what came of it."""
    from prf.shell.cli import storage
    from prf.shell.cli.console import say_beside
    from prf.shell.cli.files import encoded

    # Two coordinates of 16 bits a vertex: a window of 65 m to the millimetre.
    packed = 4 * found.best.n_vertices
    result = {
        "map": target,
        "score": found.score,
        "score_by_chain": list(found.by_chain),
        "given_up": found.given_up,
        "n_vertices": found.best.n_vertices,
        "n_edges": found.best.n_edges,
        "geojson_bytes": len(encoded(text)),
        "packed_bytes": packed,
        "steps": found.steps,
        "complete": found.share >= 1.0,
        "seed": made["seed"],
        "n_beams": made["n_beams"],
        "n_beams_thinned": made["n_beams_thinned"],
    }
    if json:
        storage.emit_object("prf.anneal/1", result)
        return
    say = say_beside(target)
    best, *others = sorted(found.by_chain, reverse=True)
    apart = f"; the next best chain ended {best - others[0]:,.1f} nats below the best" if others else ""
    say(f"score  {found.score:,.1f} nats{apart}")
    if others and best - others[0] > FAR_APART:
        say("       No two chains found the same map: more --steps may find a better one.")
    if found.given_up > 0.0:
        say(f"       {found.given_up:,.1f} nats were given up to leave out vertices")
    say(f"size   {result['geojson_bytes']:,} bytes of GeoJSON, {packed:,} bytes of packed coordinates")
    say(f"map    {target}: {found.best.n_vertices:,} vertices, {found.best.n_edges:,} edges")
