"""Draw the posterior over polygonal maps from localized readings, or values at points."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.commands._readings_options import (
    SCIENCE,
    BeamDensity,
    Config,
    EveryBeam,
    EveryScan,
    Frame,
    Laser,
    MaxRange,
    MissProbability,
    Noise,
    NoiseRelative,
    NoThinning,
    OutlierProbability,
    PointData,
    Scale,
    Scans,
    SkipScans,
    Sonar,
    SonarCone,
    SonarMaxRange,
    SonarTopic,
    Topic,
    WindowOption,
    chosen_density,
    refuse_shared_stream,
    warn_of_dropped,
    words_for_beams,
)
from prf.shell.options import Force, Json, Output, Seed, Threads

if TYPE_CHECKING:
    from pathlib import Path

    from prf.run import Run
    from prf.sampler.asked import Asked
    from prf.sampler.drive import Progress
    from prf.sampler.session import Session
    from prf.sampler.tempering_ladder import SwapReport

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf sample --laser data/demo-office.log.gz -o office --time-budget 30",
    "prf sample --laser drive.bag --topic /scan --frame odom --sonar ring.csv --config site.toml",
    "prf sample --point-data bitmap.csv --scale 0.05 --config flips.toml --seed 1",
    "prf sample --resume office --steps 5000000",
)

Chains = Annotated[int | None, typer.Option("--chains", metavar="N", min=1, help="Chains.  [4]")]
Resolution = Annotated[
    float | None,
    typer.Option("--resolution", metavar="METRES", help="Side of a pixel of the image.  [fits the window]"),
]
Tiles = Annotated[
    str | None,
    typer.Option(
        "--tiles", metavar="auto|N|off", help="Tiles in which a chain is updated at once, for large windows.  [auto]"
    ),
]
Steps = Annotated[
    int | None,
    typer.Option("--steps", metavar="N", min=1, help="Steps a chain in total, burn-in included; whole rounds."),
]
TimeBudget = Annotated[
    float | None, typer.Option("--time-budget", metavar="SECONDS", min=0.0, help="Sampling in this call.")
]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Step on the workers of this Dask scheduler."),
]
Start = Annotated[
    str | None,
    typer.Option(
        "--start", metavar="MAP", help="Where chains start: empty, grid or prior.  [grid with a laser, else empty]"
    ),
]
Rungs = Annotated[
    str | None,
    typer.Option(
        "--rungs",
        metavar="N|auto",
        help="Parallel tempering: chains that help each chain, itself included; auto: once chains stay apart.  [1]",
    ),
]
Hottest = Annotated[
    float | None,
    typer.Option(
        "--hottest",
        metavar="POWER",
        help="Of the likelihood on the last rung; 0: the prior.  [half of the swaps succeed]",
    ),
]
Resume = Annotated[str | None, typer.Option("--resume", metavar="RUN", help="Go on with this run from its checkpoint.")]

RUN_SCIENCE = (*SCIENCE, "chains", "resolution", "start", "rungs", "hottest")
MOST_TILES = 1024


def sample(
    laser: Laser = None,
    sonar: Sonar = None,
    point_data: PointData = None,
    topic: Topic = None,
    sonar_topic: SonarTopic = None,
    frame: Frame = None,
    output: Output = None,
    config: Config = None,
    scale: Scale = None,
    window: WindowOption = None,
    max_range: MaxRange = None,
    every_scan: EveryScan = None,
    every_beam: EveryBeam = None,
    scans: Scans = None,
    skip_scans: SkipScans = None,
    beam_density: BeamDensity = None,
    no_thinning: NoThinning = False,
    noise: Noise = None,
    noise_relative: NoiseRelative = None,
    outlier_probability: OutlierProbability = None,
    miss_probability: MissProbability = None,
    sonar_max_range: SonarMaxRange = None,
    sonar_cone: SonarCone = None,
    chains: Chains = None,
    resolution: Resolution = None,
    tiles: Tiles = None,
    start: Start = None,
    rungs: Rungs = None,
    hottest: Hottest = None,
    steps: Steps = None,
    time_budget: TimeBudget = None,
    resume: Resume = None,
    scheduler: Scheduler = None,
    seed: Seed = None,
    threads: Threads = 0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Draw the posterior over polygonal maps from localized readings, or values at points.

    Without --steps and --time-budget it stops when the chains agree (R-hat < 1.05 and ESS > 100 for every functional),
    or after 30 minutes, saying that they do not. Ctrl-C keeps what was sampled; --resume goes on from there, and gives
    the same draws as a run that was never stopped.
    """
    beam_density = chosen_density(beam_density, no_thinning)
    options = {name: value for name, value in locals().items() if name in RUN_SCIENCE}
    options["tiles"] = _number_of_tiles(tiles)
    options["rungs"] = _number_of_rungs(rungs)

    from prf.sampler.asked import ask
    from prf.sampler.drive import StopRule
    from prf.shell.errors import UsageError
    from prf.shell.lock import exclusive

    if steps is not None and time_budget is not None:
        raise UsageError("--steps and --time-budget: give one of them.")
    given = (("--laser", laser), ("--sonar", sonar), ("--point-data", point_data))
    logs = {flag: log for flag, log in given if log is not None}
    refuse_shared_stream({**logs, "--config": config})
    asked = ask(options, config)
    folder = _folder(logs, output, resume, force)
    with exclusive(folder):
        session = _open(logs, folder, resume is not None, asked, seed, (threads, scheduler))
        with session.sampler:
            run, progress = _carry_out(session, StopRule(steps, time_budget))
    _report(run, progress, folder, session, json)


def _number_of_tiles(tiles: str | None) -> int | None:
    """Return the number that is asked for, 0 for none; None: chosen from the window and the readings."""
    from prf.shell.errors import UsageError

    if tiles is None or tiles == "auto":
        return None
    number = 0 if tiles == "off" else int(tiles) if tiles.isdecimal() else 1
    if number == 1 or number > MOST_TILES:
        raise UsageError(f"--tiles {tiles}: give auto, off, or a number from 2 to {MOST_TILES}.")
    return number


def _number_of_rungs(rungs: str | None) -> int | str | None:
    """Return the number that is asked for, or "auto"; None: the default."""
    from prf.shell.errors import UsageError

    if rungs is None or rungs == "auto":
        return rungs
    if not rungs.isdecimal():
        raise UsageError(f"--rungs {rungs}: give a number from 1 on, or auto.")
    return int(rungs)


def _folder(logs: dict[str, str], output: str | None, resume: str | None, force: bool) -> Path:
    """Return the RUN directory, refused where it would overwrite one."""
    from pathlib import Path

    from prf.run import is_run
    from prf.sampler.output import default_output, is_unfinished
    from prf.shell.errors import InputError, UsageError
    from prf.shell.files import STREAM, refuse_standing

    if resume is not None:
        if output is not None:
            raise UsageError("--resume goes on in the run's own directory: leave -o out.")
        if not is_run(resume):
            raise InputError(f"{resume}: no run to resume is there.")
        return Path(resume)
    if not logs:
        raise UsageError("Nothing to sample: give --laser LOG, --sonar LOG or --point-data FILE.csv, or --resume RUN.")
    if output == STREAM:
        raise UsageError("-o -: a run is a directory. Name one.")
    folder = Path(output) if output is not None else default_output(next(iter(logs.values())))
    if not is_unfinished(folder):
        refuse_standing(folder, force)
    return folder


def _open(
    logs: dict[str, str], folder: Path, resumed: bool, asked: Asked, seed: int | None, means: tuple[int, str | None]
) -> Session:
    """Return the session, which steps by `means` of threads or of a scheduler, and say what it is about."""
    import os

    from prf.sampler import session as sessions
    from prf.sampler.config import SampleConfig
    from prf.shell.seeds import resolve_seed

    threads, scheduler = means[0] or len(os.sched_getaffinity(0)), means[1]
    if resumed:
        session = sessions.resume(folder, logs, asked, seed, threads, scheduler)
        logger.info(f"resuming at step {session.sampler.step}")
    else:
        used_seed = resolve_seed(seed)
        others = (logs.get(flag) for flag in ("--sonar", "--point-data"))
        prepared = sessions.read_prepared(logs.get("--laser"), SampleConfig(**asked.values), *others)
        warn_of_dropped(prepared.n_outside, prepared.n_points_outside)
        if sessions.needs_compiling():
            logger.info("compiling kernels (once; about half a minute) ...")
        session = sessions.start(list(logs.values()), prepared, folder, used_seed, threads, scheduler)
        session.sampler.compile()
    window = session.sampler.settings.window
    logger.info(
        f"{_readings(session)}, window {window.width:.1f} x {window.height:.1f} m, "
        f"{len(session.sampler.chains)} chains, seed {session.output.seed}"
    )
    return session


def _readings(session: Session) -> str:
    """Return how many readings of each sensor the run uses, in words."""
    used = session.output
    thinned = int(used.process.get("n_beams_thinned", 0))
    parts = [words_for_beams(len(used.beams.range), thinned)] if used.beams is not None else []
    parts += [f"{len(used.cones.range)} sonar readings"] if used.cones is not None else []
    return " and ".join(parts + ([f"{len(used.points.value)} points"] if used.points is not None else []))


def _carry_out(session: Session, rule: Any) -> tuple[Run, Progress]:
    """Sample with progress; Ctrl-C ends it in good order."""
    from prf.shell.progress import progress as show_progress
    from prf.shell.signals import graceful_stop

    with graceful_stop() as stop, show_progress(1.0, "sampling") as reporter:
        run, end = session.carry_out(
            rule,
            lambda progress: reporter.update(progress.share, **_fields(session, progress)),
            lambda: stop.requested,
        )
    if end.status == "interrupted":
        stop.raise_if_requested(
            f"interrupted after {end.step} steps; {session.output.folder} is valid. "
            f"Continue with: prf sample --resume {session.output.folder}"
        )
    return run, end


def _fields(session: Session, progress: Progress) -> dict[str, str]:
    """Return what the progress bar shows beside the share."""
    fields = {
        "step": f"{progress.step:,}",
        "steps/s": f"{progress.steps_per_second:,.0f}",
        "log posterior": f"{session.sampler.log_posterior():,.0f}",
    }
    if session.sampler.chains[0].rungs > 1:
        fields["rungs"] = f"{session.sampler.chains[0].rungs}"
    if progress.diagnoses:
        from prf.diagnostics import converged

        fields["worst"] = converged(progress.diagnoses).reason
    return fields


def _report(run: Run, progress: Progress, folder: Path, session: Session, json: bool) -> None:
    """Print what came of it."""
    from prf.shell import console, jsonout

    assert run.diagnostics is not None
    result = {
        "run": str(folder),
        "status": progress.status,
        "steps": progress.step,
        "draws": len(run.draws),
        "chains": len(session.sampler.chains),
        "seconds": progress.seconds,
        "steps_per_second": progress.steps_per_second,
        "seed": session.output.seed,
        "n_beams": 0 if session.output.beams is None else len(session.output.beams.range),
        "n_beams_thinned": int(session.output.process.get("n_beams_thinned", 0)),
        "converged": run.diagnostics["converged"],
        "reason": run.diagnostics["reason"],
        "log_posterior": run.best_log_posterior,
    }
    if json:
        jsonout.emit_object("prf.sample/1", result)
        return
    agree = "the chains agree" if result["converged"] else f"the chains do not agree yet ({result['reason']})"
    console.emit(f"{progress.status}: {agree}")
    swaps = session.sampler.swaps()
    if swaps:
        console.emit(_ladders(swaps))
    elif not result["converged"] and progress.status != "running":
        console.emit(_advice(session.output.config.rungs == "auto"))
    console.emit(f"{result['draws']} draws of {result['chains']} chains, {progress.step:,} steps each, {folder}/")
    console.emit(f"picture {folder}/posterior.png" + (f", best map {folder}/map.geojson" if run.best else ""))


def _advice(waits: bool) -> str:
    """Return what to do about chains that do not agree; `waits`: parallel tempering would come by itself."""
    if waits:
        return "tempering: none so far, the chains were not seen to stay apart; run longer (docs/tempering.md)"
    return "chains that stay apart: run longer, or with parallel tempering (--rungs auto; docs/tempering.md)"


def _ladders(reports: list[SwapReport]) -> str:
    """Return in words what the ladders of all chains came to."""
    rates = [rate for report in reports for rate in report.swap_rates if rate is not None]
    lowest = min(report.powers[-1] for report in reports)
    worst = f"swaps accepted {min(rates):.0%} to {max(rates):.0%}" if rates else "no swap tried"
    trips = sum(report.round_trips for report in reports)
    since = f"from step {reports[0].first_step:,} on " if reports[0].first_step else ""
    rungs = len(reports[0].powers)
    return f"tempering: {rungs} rungs {since}down to power {lowest:.3g}, {worst}, {trips} round trips"
