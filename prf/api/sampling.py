"""`sample` and `resume`: the posterior over polygonal maps, in memory or in a RUN directory."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

from prf import __version__
from prf.api.science import (
    Given,
    Sensor,
    Sources,
    by_kind,
    paths_of,
    prepared_for,
    read_sources,
    requested_by,
    settled,
)
from prf.configuration import Configuration, Prior, Start, named_sources
from prf.output.run import Run, read_run
from prf.results import Progress, names
from prf.results.convergence import verdict
from prf.results.write import is_unfinished
from prf.sampler.checkpoint import stored_config
from prf.sampler.extend import extended_configuration, prepare_extension
from prf.sampler.prepare import Prepared, with_poses
from prf.sampler.session import Session, StopRule, drive
from prf.shell.cli.console import ProgressCallback, progress_if, reported
from prf.shell.cli.outputs import exclusive, refuse_existing, refuse_inputs
from prf.shell.cli.run import graceful_stop
from prf.shell.cli.settings import Loaded
from prf.shell.cli.storage import resolve_seed
from prf.shell.errors import ArgumentError
from prf.shell.scheduler import open_pool

logger = logging.getLogger(__name__)

NOTHING_REQUESTED = Loaded(Configuration(), {})

OnInterrupt = Literal["return", "raise"]

Watch = Callable[[Session], None]


def sample(
    readings: Given,
    prior: Prior | None = None,
    sensors: Sensor | Sequence[Sensor] = (),
    *,
    steps: int | None = None,
    seconds: float | None = None,
    chains: int | None = None,
    seed: int | None = None,
    output: str | os.PathLike[str] | None = None,
    force: bool = False,
    extend: str | os.PathLike[str] | Run | None = None,
    forget: bool = False,
    config: str | os.PathLike[str] | Configuration | Loaded[Configuration] | None = None,
    beam_density: float | None = None,
    driven_radius: float | None = None,
    pose_noise: tuple[float, float] | None = None,
    odometry: str | None = None,
    resolution: float | None = None,
    start: Start | None = None,
    temperatures: int | Literal["auto"] | None = None,
    lowest_inverse_temperature: float | None = None,
    tiles: int | None = None,
    threads: int = 0,
    scheduler: str | None = None,
    progress: bool | ProgressCallback = True,
    watch: Watch | None = None,
    on_interrupt: OnInterrupt = "return",
) -> Run:
    """Draw the posterior over polygonal maps from localized readings, or values at points.

    Without `steps` and `seconds` it stops when the chains agree (R-hat < 1.05 and ESS > 100 for every functional of
    what was seen, R-hat < 1.2 for the rest), or after 30 minutes; ``run.manifest["status"]`` has which. The seed
    decides the draws, whatever the threads.

    Parameters
    ----------
    readings : Readings, PointTable, path, a sequence of these, or a mapping
        What :func:`prf.laser`, :func:`prf.sonar`, :func:`prf.points` or :func:`prf.read_readings` made, several kinds
        together as a list, and several logs of a kind that are in one frame; or a log of a laser; or a mapping of
        "laser", "sonar" and "points" to such.
    prior : Prior, optional
    sensors : LaserModel, SonarModel, PointModel, or a sequence of these
        Parameters of the sensors; defaults for those that are not given.
    steps : int, optional
        Steps a chain, burn-in included; rounded up to whole rounds of 10,000 or more.
    seconds : float, optional
        Of sampling and of writing the output, instead.
    chains : int, optional
        4 unless given.
    seed : int, optional
        Drawn if absent; ``run.manifest["seed"]`` has it.
    output : path, optional
        RUN directory, with checkpoints on the way, that every verb reads and :func:`prf.resume` continues. None:
        all stays in memory.
    force : bool
        Replace an existing run.
    extend : path or Run, optional
        Go on from the chains of this run with these readings beside its own (docs/sessions.md). Prior, sensors and
        frame are its own.
    forget : bool
        Let readings of that run go where its draws agree; what remains of them stands for them.
    config : path, Configuration, or Configuration with its sources, optional
        A settings file (docs/configuration.md); what is given here wins.
    beam_density : float, optional
        Beams of a laser a square metre of seen ground to which a dense log is thinned (16); 0 keeps all.
    driven_radius : float, optional
        Of the disc round the sensor that was free all along the way driven, metres (0.1; 0 where poses are uncertain);
        0 takes nothing from the way.
    pose_noise : (float, float), optional
        Sample the poses with the map (``run.trajectory``): the given ones have independent errors with these standard
        deviations, metres and radians (docs/poses.md).
    odometry : {"precise", "wheels", "poor"}, optional
        Sample the poses with the map: the given ones are odometry of this kind, whose errors add up along the way.
    resolution, start, temperatures, lowest_inverse_temperature, tiles, threads
        As the options of `prf sample`; tiles: 0 for none, None to choose; threads: 0 for one a core.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers advance the chains instead of threads (docs/large-jobs.md).
    progress : bool or callable
        Show a bar, in notebooks too. A callable is given the share that is done, and a mapping of words beside it.
    watch : callable, optional
        Given the :class:`Session` after every round, whose ``run()`` is the run so far: for pictures that move.
    on_interrupt : {"return", "raise"}
        What Ctrl-C, or a notebook's stop button, does after the round: return the run so far, with status
        "interrupted"; or raise :class:`prf.shell.errors.Interrupted`, after writing it if there is an `output` (then
        SIGTERM does so too). A second Ctrl-C raises KeyboardInterrupt at once, and so does one before the first round.

    Returns
    -------
    Run

    Raises
    ------
    ArgumentError
        If an argument cannot be used, by its name; it is a ValueError too.
    ConfigError
        If a settings file cannot be used.
    InputError
        If a log cannot be read, or no reading is left.
    OutputError
        If the output exists already, is being written by another process, or cannot be written.
    """
    rule = _rule(steps, seconds)
    if on_interrupt not in get_args(OnInterrupt):
        raise ArgumentError(f"on_interrupt {on_interrupt!r}: must be one of {', '.join(get_args(OnInterrupt))}.")
    options = {
        "chains": chains,
        "beam_density": beam_density,
        "driven_radius": driven_radius,
        "pose_noise": pose_noise,
        "odometry": odometry,
        "resolution": resolution,
        "start": start,
        "temperatures": temperatures,
        "lowest_inverse_temperature": lowest_inverse_temperature,
        "tiles": tiles,
    }
    sources = by_kind(readings, sensors)
    loaded = settled(requested_by(config), prior, sensors, options)
    folder = None if output is None else Path(output)
    logs = paths_of(chain.from_iterable(sources.values()))
    if folder is not None:
        refuse_inputs([str(folder)], logs)
    with _held(folder, force), progress_if(progress):
        used_seed = resolve_seed(seed)
        prepared, set_by = _prepared(sources, loaded, extend, forget)
        prepared.announce()
        files = with_poses(logs, loaded.settings)
        session = Session.start(files, prepared, folder, used_seed, _threads(threads), set_by)
        return _run_to_goal(session, rule, scheduler, (progress, watch, on_interrupt))


def resume(
    run: str | os.PathLike[str],
    *,
    steps: int | None = None,
    seconds: float | None = None,
    threads: int = 0,
    scheduler: str | None = None,
    progress: bool | ProgressCallback = True,
    watch: Watch | None = None,
    on_interrupt: OnInterrupt = "return",
    requested: Loaded[Configuration] = NOTHING_REQUESTED,
    logs: Mapping[str, Sequence[str]] = MappingProxyType({}),
    seed: int | None = None,
) -> Run:
    """Go on with a run from its checkpoint; the draws are those of a run that was never stopped.

    Parameters
    ----------
    run : path
        RUN directory that :func:`sample` wrote by its `output`, or `prf sample`.
    steps : int, optional
        A chain, in total.
    seconds, threads, scheduler, progress, watch, on_interrupt
        As :func:`sample`.
    requested, logs, seed
        What the run must have been made with, if anything: values, option to logs, seed.

    Raises
    ------
    ConfigError, InputError, OutputError
        If the run was made otherwise, cannot be read, or is being written by another process.
    """
    rule = _rule(steps, seconds)
    with exclusive(run), progress_if(progress):
        session = Session.resume(Path(run), dict(logs), requested, seed, _threads(threads))
        logger.info(f"resuming at step {session.ensemble.step}")
        return _run_to_goal(session, rule, scheduler, (progress, watch, on_interrupt))


def _prepared(
    sources: Sources, requested: Loaded[Configuration], extend: str | os.PathLike[str] | Run | None, forget: bool
) -> tuple[Prepared, dict[str, str]]:
    """Return the readings made ready, beside those of a run to extend, and what has set the settings, by name."""
    if extend is None:
        if forget:
            raise ArgumentError("forget: readings are let go of a run that is gone on from. Give extend too.")
        return prepared_for(sources, requested.settings), named_sources(requested)
    run = extend if isinstance(extend, Run) else read_run(extend, parts=(names.READINGS, names.POSTERIOR, names.POSES))
    config = extended_configuration(run, stored_config(run, run.name)[0], requested)
    set_by = {**run.manifest.get("sources", {}), **named_sources(requested)}
    return prepare_extension(run, config, *read_sources(sources, config), forget=forget), set_by


def _run_to_goal(
    session: Session,
    rule: StopRule,
    scheduler: str | None,
    watched: tuple[bool | ProgressCallback, Watch | None, OnInterrupt],
) -> Run:
    """Drive a run to its goal and return it."""
    # A scheduler that does not answer must be known before files of an earlier run are removed.
    with (
        open_pool(session.threads, scheduler, "prf", _version) as workers,
        _supervised(session, *watched) as (stop_requested, after_round),
    ):
        for found in drive(session.ensemble, rule, workers, stop_requested, session.seconds_to_finish):
            if after_round(found):
                break
        return session.finish()


@contextmanager
def _supervised(
    session: Session, progress: bool | ProgressCallback, watch: Watch | None, on_interrupt: OnInterrupt
) -> Iterator[tuple[Callable[[], bool], Callable[[Progress], bool]]]:
    """Show progress, keep what a killed process would lose, and let Ctrl-C end the run in good order.

    Gives what returns whether a stop is requested, and what is called after every round and returns whether it was the
    last for that.
    """
    logger.info(session.describe())
    session.open()
    signals = (signal.SIGINT, signal.SIGTERM) if on_interrupt == "raise" else (signal.SIGINT,)
    with graceful_stop(signals, has_result=False) as stop, reported(progress, 1.0, "sampling") as reporter:

        def after_round(found: Progress) -> bool:
            stop.has_result = True
            session.progress = found
            reporter(found.share, **_shown(session))
            if watch is not None:
                watch(session)
            if found.status == "running" and stop.requested:
                session.progress = found._replace(status="interrupted")
            elif found.status == "running":
                session.write_if_due()
            return session.progress.status == "interrupted"

        yield lambda: stop.requested, after_round
    if session.progress.status == "interrupted":
        words = f"interrupted after {session.progress.step} steps"
        if session.folder is not None:
            words += f"; {session.folder} is valid. Continue with: prf sample --resume {session.folder}"
        if on_interrupt == "raise":
            stop.raise_if_requested(words)
        logger.warning(words)


def _shown(session: Session) -> dict[str, str]:
    """Return what a progress bar shows beside the share."""
    progress, ensemble = session.progress, session.ensemble
    fields = {
        "step": f"{progress.step:,}",
        "steps/s": f"{progress.steps_per_second:,.0f}",
        "log posterior": f"{ensemble.log_posterior():,.0f}",
    }
    if ensemble.n_temperatures > 1:
        fields["temperatures"] = f"{ensemble.n_temperatures}"
    if progress.diagnoses:
        fields["least_converged"] = verdict(progress.diagnoses).reason
    return fields


@contextmanager
def _held(folder: Path | None, force: bool) -> Iterator[None]:
    """Refuse to overwrite a RUN directory, or hold it for this process."""
    if folder is None:
        yield
        return
    if not is_unfinished(folder):
        refuse_existing(folder, force, is_folder=True)
    with exclusive(folder):
        yield


def _rule(steps: int | None, seconds: float | None) -> StopRule:
    if steps is not None and seconds is not None:
        raise ArgumentError("steps and seconds: give one of them.")
    if seconds is not None and not seconds >= 0.0:
        raise ArgumentError(f"seconds {seconds}: must not be negative.")
    if steps is not None and steps < 1:
        raise ArgumentError(f"steps {steps}: must be at least 1.")
    return StopRule(steps, seconds)


def _version() -> str:
    return __version__


def _threads(threads: int) -> int:
    if threads < 0:
        raise ArgumentError(f"threads {threads}: must be at least 0.")
    return threads or len(os.sched_getaffinity(0))
