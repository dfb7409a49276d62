"""Draw the posterior over polygonal maps from localized readings, or values at points."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.commands import _options as o
from prf.configuration import IN_MANIFEST, Configuration
from prf.shell.cli.options import Force, Json, Output, Seed, Threads, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from prf.api.sampling import Watch
    from prf.api.science import ReadingKind, Source
    from prf.output.run import Run
    from prf.results.disputes import Dispute

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf sample --laser data/demo-office.log.gz -o office --time-budget 30",
    "prf sample --laser drive.bag --topic /scan --preset hokuyo-utm-30lx --sonar ring.csv --config site.toml",
    "prf sample --point-data bitmap.csv --scale 0.05 --config flips.toml --seed 1",
    "prf sample --extend office --laser evening.log.gz -o office-2 --forget",
)

Resume = Annotated[str | None, typer.Option("--resume", metavar="RUN", help="Continue this run from its checkpoint.")]
Extend = Annotated[
    str | None, typer.Option("--extend", metavar="RUN", help="Go on from this run's chains with more readings.")
]
Forget = Annotated[
    bool, typer.Option("--forget", help="Let readings of that run go where its draws agree; what remains stands in.")
]
View = Annotated[
    bool, typer.Option("--view", help="Show the report in a browser while the run goes; RUN.html keeps it.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Advance chains on the workers of this Dask scheduler, not in threads.",
    ),
]

SOURCES: dict[ReadingKind, str] = {"laser": "--laser", "sonar": "--sonar", "points": "--point-data"}
"""Kind of readings to the option that names its log."""
OUTPUT = {"--output", "-o"}


@with_settings(Configuration, *IN_MANIFEST)
def sample(
    *,
    laser: o.Laser = None,
    sonar: o.Sonar = None,
    point_data: o.PointData = None,
    output: Output = None,
    settings: Loaded[Configuration],
    steps: o.Steps = None,
    time_budget: o.TimeBudget = None,
    resume: Resume = None,
    extend: Extend = None,
    forget: Forget = False,
    seed: Seed = None,
    threads: Threads = 0,
    scheduler: Scheduler = None,
    view: View = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Draw the posterior over polygonal maps from localized readings, or values at points.

    Without --steps and --time-budget it stops when the chains agree (R-hat < 1.05 and ESS > 100 for every functional of
    what was seen, R-hat < 1.2 for the rest), or after 30 minutes, saying that they do not. Ctrl-C keeps what was
    sampled; --resume continues from there, and gives the same draws as a run that was never stopped. --extend goes on
    with more readings, in a run of its own whose law is that of one on all of them.

    --view serves the page of prf report on this machine alone, with the draws and the agreement so far, and opens it in
    a browser; the address is on standard error. When the run ends, the page is RUN.html beside the run.
    """
    from prf.api.sampling import resume as continue_run
    from prf.api.sampling import sample as draw
    from prf.shell.errors import UsageError

    if steps is not None and time_budget is not None:
        raise UsageError("--steps and --time-budget: give one of them.")
    given = (("--laser", laser), ("--sonar", sonar), ("--point-data", None if point_data is None else [point_data]))
    logs = {flag: own for flag, own in given if own}
    folder = _folder(logs, output, resume)
    how: dict[str, Any] = {"steps": steps, "seconds": time_budget, "threads": threads, "scheduler": scheduler}
    how |= {"seed": seed, "on_interrupt": "raise"}
    _check_extension(extend, forget, resume, folder)
    with _viewed(folder, view, force or resume is not None) as (watch, page):
        how["watch"] = watch
        if resume is not None:
            run = continue_run(folder, requested=settings, logs=logs, **how)
        else:
            sources: dict[ReadingKind, Sequence[Source]] = {
                name: logs[flag] for name, flag in SOURCES.items() if flag in logs
            }
            run = draw(sources, config=settings, output=folder, force=force, extend=extend, forget=forget, **how)
    _report(run, folder, page, json, steps if resume is None else None)


@contextmanager
def _viewed(folder: Path, wanted: bool, replace: bool) -> Iterator[tuple[Watch | None, str | None]]:
    """Show the run that the block makes in a browser, and leave its page; give what watches it and where that will be.

    A run that Ctrl-C ends leaves its page too; one without draws leaves none.
    """
    if not wanted:
        yield None, None
        return
    from prf.output.report import LiveReport, page_beside, write_report
    from prf.output.run import read_run
    from prf.shell.cli.outputs import claim_output
    from prf.shell.errors import Interrupted

    path = page_beside(folder)
    claim_output(path, replace)

    def leave() -> None:
        run = read_run(folder)
        if len(run.draws) and run.image is not None:
            logger.info("making the whole page ...")
            write_report(path, run)
            report.finish(path)

    with LiveReport() as report:
        try:
            yield lambda session: report.update(session.run), path
        except Interrupted:
            leave()
            raise
        leave()


def _check_extension(extend: str | None, forget: bool, resume: str | None, folder: Path) -> None:
    """Refuse options that do not go with --extend, or without it."""
    from pathlib import Path

    from prf.shell.errors import UsageError

    if forget and extend is None:
        raise UsageError("--forget: readings are let go of a run that is gone on from. Give --extend RUN.")
    if extend is None:
        return
    if resume is not None:
        raise UsageError("--extend and --resume: give one of them; an extended run is resumed by --resume alone.")
    if folder.resolve() == Path(extend).resolve():
        raise UsageError(f"-o {folder}: is the run to extend. Name another one.")


def _folder(logs: dict[str, list[str]], output: str | None, resume: str | None) -> Path:
    """Return the RUN directory."""
    from pathlib import Path

    from prf.results import is_run
    from prf.sampler.session import default_output
    from prf.shell.cli.files import STREAM
    from prf.shell.errors import InputError, UsageError

    if resume is not None:
        if output is not None:
            raise UsageError("--resume continues in the run's own directory: leave -o out.")
        if not is_run(resume):
            raise InputError(f"{resume}: no run to resume is there.")
        return Path(resume)
    if not logs:
        raise UsageError("Nothing to sample: give --laser LOG, --sonar LOG or --point-data FILE.csv, or --resume RUN.")
    if output == STREAM:
        raise UsageError("-o -: a run is a directory. Name one.")
    return Path(output) if output is not None else default_output(next(iter(logs.values()))[0])


def _report(run: Run, folder: Path, page: str | None, json: bool, asked_steps: int | None) -> None:
    """Print what came of it; `asked_steps` may be fewer than whole rounds have. `page`: that was left beside it."""
    from prf.shell.cli import console, storage

    assert run.diagnostics is not None
    assert run.progress is not None
    progress, configuration = run.progress, run.manifest["configuration"]
    result = {
        "run": str(folder),
        "status": progress.status,
        "steps": progress.step,
        "draws": len(run.draws),
        "chains": configuration["chains"],
        "seconds": progress.seconds,
        "steps_per_second": progress.steps_per_second,
        "seed": run.manifest["seed"],
        "n_beams": 0 if run.laser is None else len(run.laser.range),
        "n_beams_thinned": int(run.manifest.get("n_beams_thinned", 0)),
        "log_posterior": run.best_log_posterior,
    }
    judged = ("converged", "converged_seen", "reason", "agreement", "suggested_seconds")
    result |= {name: run.diagnostics[name] for name in judged}
    if run.trajectory is not None:
        found = run.trajectory
        result["trajectory"] = found.figures() | {"slips": found.slip_rows(), "disputed": found.closure_rows()}
    if run.building is not None:
        result["building"] = run.building
    disputes = run.disputes()
    result["disputes"] = [each._asdict() for each in disputes]
    if "forgotten" in run.manifest:
        result["forgotten"] = run.manifest["forgotten"]
    if json:
        storage.emit_object("prf.sample/1", result)
        return
    for line in _summary(run, folder, page, asked_steps, disputes):
        console.summarize(line)


def _summary(
    run: Run, folder: Path, page: str | None, asked_steps: int | None, disputes: list[Dispute]
) -> Iterator[str]:
    """Yield for a person what was mapped, whether the chains agree, what to do about it, and what to open."""
    import shlex

    from prf.results.run import Agreement
    from prf.shell.cli import console
    from prf.shell.cli.console import wrapped_lines
    from prf.shell.cli.pictures import counted

    assert run.diagnostics is not None
    assert run.progress is not None
    steps, diagnostics, window = run.progress.step, run.diagnostics, run.draws.window
    rounded = f" (rounded up from {asked_steps:,})" if asked_steps is not None and steps > asked_steps else ""
    yield (
        f"Mapped {_readings(run)} in {window.width:.1f} x {window.height:.1f} m: {len(run.draws):,} draws of "
        f"{counted(run.manifest['configuration']['chains'], 'chain')}, {steps:,} steps each{rounded}."
    )
    yield _verdict(run, run.progress.status)
    ground = Agreement.of_document(diagnostics["agreement"]).words()
    if ground and not _is_short(diagnostics):
        yield "The run is too short to say where chains agree." if run.is_early else f"Place by place, {ground}."
    if diagnostics.get("tempering") and console.is_verbose():
        yield _ladders(diagnostics["tempering"])
    if not diagnostics["converged"] and (advice := _advice(run, folder)):
        yield advice
    if run.trajectory is not None and len(run.trajectory.draws):
        yield from wrapped_lines(f"Trajectory: {run.trajectory.words()}; {folder}/trajectory.csv")
    if run.building is not None:
        yield _building(run.building)
    for dispute in disputes:
        yield f"Dispute: {dispute.words()}."
    yield f"picture   {folder}/posterior.png"
    if run.best:
        yield f"best map  {folder}/map.geojson"
    yield f"run       {folder}/" + ("" if page else f"; as one page: prf report {shlex.quote(str(folder))}")
    if page:
        yield f"page      {page}"


def _building(building: dict[str, float]) -> str:
    """Return in words which directions the walls have."""
    import math

    angle, error = math.degrees(building["angle"]), math.degrees(building["angle_sd"])
    strength = f"{building['orientation']:.1f}" + (
        f" (standard deviation {building['orientation_sd']:.1f})" if building["orientation_sd"] > 0.0 else ""
    )
    return (
        f"Building: walls run at {angle:.2f} and {(angle + 90.0) % 180.0:.2f} degrees "
        f"(standard deviation {error:.2f}); orientation {strength}."
    )


def _readings(run: Run) -> str:
    """Return how many readings of each kind the map was made from."""
    parts = []
    if run.laser is not None:
        n, thinned = len(run.laser.range), int(run.manifest.get("n_beams_thinned", 0))
        parts.append(f"{n:,} of {n + thinned:,} beams (thinned)" if thinned else f"{n:,} beams")
    if run.sonar is not None:
        parts.append(f"{len(run.sonar.range):,} sonar readings")
    if run.points is not None:
        parts.append(f"{len(run.points.value):,} points")
    return " and ".join(parts)


def _is_short(diagnostics: dict[str, Any]) -> bool:
    """Return whether draws are missing, so that nothing is known of agreement."""
    return bool(diagnostics["functionals"].get(diagnostics["worst"], {"state": "short"})["state"] == "short")


def _verdict(run: Run, status: str) -> str:
    """Return in words whether the chains agree, on what was seen and on the rest."""
    assert run.diagnostics is not None
    diagnostics, alone = run.diagnostics, run.manifest["configuration"]["chains"] == 1
    if diagnostics["converged"]:
        judged = "The parts of the one chain agree" if alone else "The chains agree"
    elif _is_short(diagnostics):
        judged = "Too few draws to judge whether the map is settled"
    elif alone:
        judged = "The one chain is not settled yet, and has no other to agree with"
    elif diagnostics["converged_seen"]:
        judged = "The chains agree on what was seen, and not yet on the rest"
    else:
        judged = "The chains do not agree yet"
    return f"{judged} ({'not converged; ' if status == 'not converged' else ''}{diagnostics['reason']})."


def _advice(run: Run, folder: Path) -> str:
    """Return in words what to do about chains that do not agree; empty if there is none."""
    import shlex

    from prf.results.convergence import range_words

    assert run.diagnostics is not None
    configuration, diagnostics = run.manifest["configuration"], run.diagnostics
    seconds, is_flat = diagnostics["suggested_seconds"], diagnostics["trend"] == "flat"
    waits = configuration.get("temperatures") == "auto" and "tempering" not in diagnostics
    again = f"prf sample --resume {shlex.quote(str(folder))}"
    if seconds is not None:
        words = range_words(diagnostics["suggested_least"], seconds)
        return f"{words.capitalize()} more at this speed: {again} --time-budget {seconds:.0f}"
    if _is_short(diagnostics) or configuration["chains"] == 1:
        return f"Run longer, to agreement or for 30 minutes: {again}"
    if diagnostics["converged_seen"]:
        return ""
    if run.trajectory is not None or run.walls is not None:
        return f"Run longer: {again}"
    if waits:
        return "Tempering: none so far, the chains were not found to disagree; run longer (docs/convergence.md)."
    anew = _tempered_command(run, folder)
    other = f"sample anew with parallel tempering: {anew}" if anew else "see docs/convergence.md."
    if is_flat:
        return f"The chains do not approach each other, and more time alone will not help: {other}"
    return f"Run longer ({again}), or {other}"


def _tempered_command(run: Run, folder: Path) -> str:
    """Return the command that samples the same anew on temperature ladders; empty where there is none to give.

    A run cannot be given ladders: resumed or extended it keeps its settings. Tiles that were asked for exclude them.
    """
    import shlex

    command, made = list(map(str, run.manifest["command"])), run.manifest
    is_typed = command[:1] == ["prf"] or command[:3] == ["python", "-m", "prf"]
    if "tempering" in (run.diagnostics or {}) or "tiles" in made["sources"] or "extends" in made or not is_typed:
        return ""
    words = [word for word in command if word not in ("--force", "-f")]
    kept = [word for before, word in zip(["", *words], words, strict=False) if not {before, word} & OUTPUT]
    return shlex.join([*kept, "--set", "sampler.temperatures=auto", "-o", f"{folder}-tempered"])


def _ladders(reports: list[dict[str, Any]]) -> str:
    """Return in words what the ladders of all chains came to."""
    rates = [rate for report in reports for rate in report["swap_rates"] if rate is not None]
    lowest = min(report["powers"][-1] for report in reports)
    worst = f"swaps accepted {min(rates):.0%} to {max(rates):.0%}" if rates else "no swap tried"
    trips = sum(report["round_trips"] for report in reports)
    first_step = reports[0]["first_step"]
    since = f"from step {first_step:,} on " if first_step else ""
    temperatures = len(reports[0]["powers"])
    return f"Tempering: {temperatures} temperatures {since}down to power {lowest:.3g}, {worst}, {trips} round trips."
