"""The one loop over chains, and a run under way: begun or resumed, driven, and written as a RUN directory.

The loop makes rounds of all chains until a stop rule holds, with checks of agreement on the way.
"""

from __future__ import annotations

import dataclasses
import logging
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from types import MappingProxyType
from typing import Any

from prf.configuration import Configuration
from prf.output.run import Run, read_run
from prf.readings import log_stem
from prf.readings.counts import BeamCounts
from prf.results import Progress, Status, names, read_manifest, write_run
from prf.results.convergence import Diagnosis, verdict
from prf.results.write import (
    make_folder,
    remove_half_written,
    remove_stale_outputs,
    remove_unfinished,
    write_manifest,
)
from prf.sampler.chain import ChainRun
from prf.sampler.checkpoint import (
    PROCESS_KEYS,
    describe_start,
    diagnostics_of,
    identity_of,
    load_checkpoint,
    load_pose_model,
    refuse_changes,
    refuse_other_log,
    save_checkpoint,
    stored_config,
)
from prf.sampler.continued import Earlier
from prf.sampler.ensemble import Ensemble
from prf.sampler.prepare import Prepared, describe_readings, ladder_plan, make_target
from prf.sampler.target import Target, Tuning
from prf.shell.cli.outputs import beside
from prf.shell.cli.pictures import counted
from prf.shell.cli.settings import Loaded
from prf.shell.cli.storage import spawn_generators, versions
from prf.shell.errors import InputError, OutputError
from prf.shell.scheduler import Workers

LONGEST = 1800.0
"""Seconds after which a run without a goal of its own gives up on agreement."""
CHECK_GROWTH = 1.1
"""Agreement is checked at steps that grow by this factor: the cost stays a small share, and the steps at which a run
can stop do not depend on the clock or on the number of threads."""
START_SHARE = 0.3
"""Share of the time that the search for starts may take at most."""


@dataclasses.dataclass(frozen=True)
class StopRule:
    """The goal of a run: `steps` a chain, or `seconds` of sampling, or agreement if both are None."""

    steps: int | None = None
    seconds: float | None = None
    limit: float = LONGEST

    @property
    def longest(self) -> float:
        """Seconds that a run may take; inf where steps are the goal."""
        return math.inf if self.steps is not None else self.limit if self.seconds is None else self.seconds

    def share(self, step: int, seconds: float, checked: dict[str, Diagnosis] | None = None) -> float:
        """Return the share of the goal that is reached; of agreement, by what the worst diagnosis falls short."""
        done = step / max(self.steps, 1) if self.steps is not None else seconds / max(self.longest, 1e-9)
        if checked and self.steps is None and self.seconds is None:
            done = max(done, min(0.99, 1.0 / max(1.0, *(found.shortfall() for found in checked.values()))))
        return min(1.0, done)

    def status(self, step: int, seconds: float, checked: dict[str, Diagnosis] | None) -> Status:
        """Return "running", or how the run ends here, given the diagnoses if agreement is checked here."""
        if self.steps is not None:
            return "finished" if step >= self.steps else "running"
        if self.seconds is not None:
            return "finished" if seconds >= self.seconds else "running"
        if checked is not None and verdict(checked).converged:
            return "converged"
        return "not converged" if seconds >= self.limit else "running"


def drive(
    ensemble: Ensemble,
    rule: StopRule,
    workers: Workers = map,
    stop_requested: Callable[[], bool] = lambda: False,
    reserve: Callable[[], float] = lambda: 0.0,
) -> Iterator[Progress]:
    """Advance the chains round by round until the goal is reached; yield after every round.

    Each round of a chain is a task of `workers`, in threads or on a Dask scheduler; :func:`map` does one by one.

    Chains that have made no step find their starts first; `stop_requested` cuts that short, and so does the clock where
    time is the goal. A run of a number of steps does not look at the clock. Where the clock decides, `reserve` seconds
    are left at the end, and the last round is the one whose end is nearest to that. Steps are rounded up to whole
    rounds. The caller may leave at any time: after a round the chains are in a state that a checkpoint can hold.
    """
    ensemble.compile()
    start, first_step = time.monotonic(), ensemble.step
    if first_step == 0:
        latest = time.time() + START_SHARE * rule.longest
        starts = workers(ChainRun.find_start, ensemble.chains, repeat(latest), repeat(stop_requested))
        ensemble.chains = list(starts)
    diagnoses: dict[str, Diagnosis] | None = None
    share = 0.0
    status = rule.status(first_step, 0.0, None)
    while status == "running":
        begun, steps = time.monotonic(), ensemble.next_steps
        ensemble.begin_round()
        ensemble.end_round(list(workers(ChainRun.advance, ensemble.chains)))
        is_checked = is_check(ensemble)
        diagnoses = ensemble.diagnose() if is_checked else diagnoses
        now = time.monotonic()
        seconds = now - start
        planned = seconds + 0.5 * (now - begun) * ensemble.next_steps / steps + reserve()
        status = rule.status(ensemble.step, planned, diagnoses if is_checked else None)
        speed = (ensemble.step - first_step) * len(ensemble.chains) / max(seconds, 1e-9)
        share = max(share, rule.share(ensemble.step, planned, diagnoses))  # chains that part again do not take it back
        yield Progress(ensemble.step, seconds, speed, share, diagnoses, status)


def is_check(ensemble: Ensemble) -> bool:
    """Return whether agreement is checked after the present round."""
    block, check = ensemble.step // ensemble.block, 1
    while check < block:
        check = max(check + 1, int(check * CHECK_GROWTH))
    return check == block


CHECKPOINT_SECONDS = 60.0
"""Sampling between two checkpoints: what a killed run loses at most."""
PICTURE_SECONDS = 1.5
"""What drawing the picture of a run takes."""
FIRST_SECONDS = 1.0
"""What writing a RUN without it is taken to cost until it was measured."""
MOST_SLOWED = 4.0
"""Beside other processes both take longer, as the chains do; at most so many times as long."""

UNMOVED = Progress(0, 0.0, 0.0, 1.0, None, "finished")
"""Of a run without a round."""

logger = logging.getLogger(__name__)


@dataclasses.dataclass
class Session:
    """A run under way. Without a folder it stays in memory.

    Attributes
    ----------
    progress : Progress
        Step, seconds, share of the goal, latest check of agreement.
    """

    ensemble: Ensemble
    config: Configuration  # resolved
    seed: int
    process: dict[str, Any]  # versions, platform, command, inputs (:func:`prf.shell.cli.storage.describe_process`)
    folder: Path | None = None
    counts: BeamCounts | None = None  # of the beams, thinned away or not
    seconds_before: float = 0.0  # sampling in earlier processes of a resumed run
    is_resumed: bool = False  # whether the folder holds the run already
    progress: Progress = UNMOVED
    written: float = dataclasses.field(default_factory=time.monotonic)  # when the run was written last
    seconds_to_write: float | None = None  # the last time; None: not yet
    threads: int = 1
    opened: tuple[float, float] = (0.0, 0.0)  # by the clock, and in seconds of the processor

    @classmethod
    def start(
        cls,
        logs: list[str],
        prepared: Prepared,
        folder: Path | None,
        seed: int,
        threads: int,
        sources: Mapping[str, str] = MappingProxyType({}),
    ) -> Session:
        """Return a run of fresh chains; the manifest keeps `sources`: what has set each value of the configuration."""
        ensemble = make_ensemble(prepared.config, prepared.target, seed, threads, prepared.earlier)
        return cls(
            ensemble,
            prepared.config,
            seed,
            describe_start(logs, prepared, sources),
            folder,
            prepared.counts,
            threads=threads,
        )

    @classmethod
    def resume(
        cls,
        folder: Path,
        logs: Mapping[str, Sequence[str]],
        requested: Loaded[Configuration],
        seed: int | None,
        threads: int,
    ) -> Session:
        """Return the run in `folder` as its checkpoint has it; refuse to if it was made otherwise than requested."""
        run = read_run(folder, parts=(names.READINGS, names.POSTERIOR))
        if run.sensors is None and run.points is None:
            raise InputError(f"{folder}: readings.npz is missing. Sample anew with --force.")
        config, stored_seed = stored_config(run, folder)
        refuse_changes(config, requested, stored_seed, seed)
        for flag, given in logs.items():
            for log in given:
                refuse_other_log(run, flag, log)
        if run.manifest.get("versions") != versions():
            logger.warning("this run was begun with other versions of the packages: bit for bit may not hold")
        seen = None if run.image is None else run.image.seen
        model, laser, sonar = None, run.laser, run.sonar
        if config.trajectory.is_uncertain:
            model = load_pose_model(folder)
            laser, sonar = model.placed(laser, sonar, model.start)
        target = make_target(config, laser, sonar, run.points)
        tuning = Tuning(first_new_log=int(run.manifest.get("extends", {}).get("n_laser_logs", 0)))
        target = dataclasses.replace(target, seen=seen, way=run.way, poses=model, tuning=tuning)
        process = {key: run.manifest[key] for key in PROCESS_KEYS if key in run.manifest}
        seconds = float(run.manifest.get("seconds", 0.0))
        ensemble = make_ensemble(config, target, stored_seed, threads)
        session = cls(
            ensemble,
            config,
            stored_seed,
            process,
            folder,
            run.counts,
            seconds_before=seconds,
            is_resumed=True,
            threads=threads,
        )
        load_checkpoint(folder, ensemble, session.identity())
        return session

    def describe(self) -> str:
        """Return in a line what the run is about."""
        readings = describe_readings(self.ensemble.target, int(self.process.get("n_beams_thinned", 0)))
        return f"{readings}, {counted(len(self.ensemble.chains), 'chain')}, seed {self.seed}"

    def open(self) -> None:
        """Remove what an older run left in the folder, or what a killed process left half written of this one."""
        self.written = time.monotonic()
        self.opened = time.monotonic(), time.process_time()
        self.progress = self.progress._replace(step=self.ensemble.step)
        if self.folder is not None:
            (remove_half_written if self.is_resumed else remove_stale_outputs)(self.folder)
        if self.ensemble.step == 0 and self.ensemble.chains[0].starts_from != "empty":
            logger.info("finding maps to start from ...")

    def write_if_due(self) -> None:
        """Write a checkpoint and the run so far, after so many seconds without one."""
        if self.folder is not None and time.monotonic() - self.written > CHECKPOINT_SECONDS:
            self.write(picture=False)

    def finish(self) -> Run:
        """Write the run and return it; one that its folder holds already, whole and at this step, is read."""
        finished = self._read_finished()
        return self.write(picture=True) if finished is None else finished

    def write(self, picture: bool) -> Run:
        """Write checkpoint and RUN as the chains are now; `picture` draws posterior.png too.

        The manifest is written last: what is killed before can be resumed from a checkpoint, or is no run yet; and one
        whose status is not "running" is beside files that are all of its step. If one cannot be written, what is no run
        yet is removed.
        """
        begun = time.monotonic()
        run = self.run()
        if self.folder is None:
            return run
        try:
            make_folder(self.folder)
            save_checkpoint(self.folder, self.ensemble, self.identity())
            if not picture:
                write_run(self.folder, run)
            else:  # a picture that fails must not cost the draws, nor be taken for drawn
                write_run(self.folder, dataclasses.replace(run, manifest={**run.manifest, "status": "running"}))
                run.draw(self.folder / names.PICTURE)
                write_manifest(self.folder, run.manifest)
        except OutputError:
            remove_unfinished(self.folder)
            raise
        self.written = time.monotonic()
        self.seconds_to_write = self.written - begun
        return run

    def seconds_to_finish(self) -> float:
        """Return the seconds that the end of the run will take on the machine as it is."""
        if self.folder is None:
            return 0.0
        slowed = self._slowed()
        writing = slowed * FIRST_SECONDS if self.seconds_to_write is None else self.seconds_to_write
        return writing + slowed * PICTURE_SECONDS

    def _slowed(self) -> float:
        """Return how many times as long as on a quiet machine the chains have taken since the run was opened."""
        wall, cpu = time.monotonic() - self.opened[0], time.process_time() - self.opened[1]
        n_at_once = min(self.threads, len(self.ensemble.chains))
        return min(max(1.0, n_at_once * wall / max(cpu, 1e-9)), MOST_SLOWED)

    def _read_finished(self) -> Run | None:
        """Return the run to resume if its folder holds all of it at the present step, else None."""
        if self.folder is None or not self.is_resumed:
            return None
        manifest = read_manifest(self.folder)
        is_whole = manifest.get("steps") == self.ensemble.step and manifest.get("status") != "running"
        return dataclasses.replace(read_run(self.folder), progress=self.progress) if is_whole else None

    def identity(self) -> str:
        """Return what a checkpoint of another run is refused by."""
        return identity_of(self.config, self.seed, self.ensemble.target)

    def run(self) -> Run:
        """Return the run so far: its draws and its image."""
        ensemble, target = self.ensemble, self.ensemble.target
        best, image = ensemble.best(), ensemble.image()
        laser, sonar = (None if part is None else part.readings for part in (target.laser, target.sonar))
        if target.poses is not None:
            laser, sonar = target.poses.placed(laser, sonar, target.poses.prior.given)
        return Run(
            manifest=self._manifest(),
            **ensemble.sample()._asdict(),
            probe_xy=ensemble.probe_xy,
            image=image,
            laser=laser,
            sonar=sonar,
            points=None if target.points is None else target.points.readings,
            way=target.way,
            counts=self.counts,
            trajectory=ensemble.trajectory(),
            best=None if best is None else best.coloring if target.walls is None else best.region,
            best_log_posterior=float("nan") if best is None else float(best.functionals[-1]),
            diagnostics=diagnostics_of(ensemble, image, self._seconds, self.progress.steps_per_second),
            path=self.folder,
            progress=self.progress,
        )

    @property
    def _seconds(self) -> float:
        """Sampling in all processes of the run."""
        return self.seconds_before + self.progress.seconds

    def _manifest(self) -> dict[str, Any]:
        swaps = self.ensemble.swaps()
        return {
            **self.process,
            "status": self.progress.status,
            "configuration": self.config.flat(),
            "seed": self.seed,
            "steps": self.ensemble.step,
            "burn_in": self.ensemble.burn_in,
            **({"tempered_from": swaps[0]["first_step"]} if swaps else {}),
            "seconds": round(self._seconds, 3),
        }


def make_ensemble(
    config: Configuration, target: Target, seed: int, threads: int, earlier: Sequence[Earlier] = ()
) -> Ensemble:
    """Return fresh chains of a resolved configuration, which may go on from an `earlier` run."""
    generators, start = spawn_generators(seed, config.sampler.chains), config.sampler.start or "empty"
    return Ensemble(target, generators, ladder_plan(config), start, threads, earlier=earlier)


def default_output(log: str | os.PathLike[str]) -> Path:
    """Return the RUN directory for a log whose output was not named: its stem, beside it."""
    return Path(beside(log, (log_stem(os.fspath(log)) or "laser") + ".run"))
