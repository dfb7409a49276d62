"""``python -m tests.statistical``: verify that the sampler is right; one line a check, plots and figures in a folder.

Exits with 1 if a check fails, or if a mistake made on purpose is not caught. docs/verification.md says what is done.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.statistical.check import Check, settled
from tests.statistical.controls import control_arms, rougher, run_mutant, sharper
from tests.statistical.images import by_loops, by_sampler, image_check, mixing_check
from tests.statistical.joint import ACCELERATED, PLAIN, QUANTITIES, Joint, Program, joint_check, run_joint
from tests.statistical.pictures import plot_images, plot_joint, plot_ranks
from tests.statistical.problems import NAMES, small_station
from tests.statistical.sbc import Calibration, control_check, run_arm, standard_arm, uniform_checks
from tests.statistical.ways import LADDER, LEVELS

ARMS = (("laser", "plain"), ("laser", "tempered"), ("laser", "tiles"), ("sonar", "plain"), ("sonar", "tempered"))
PARTS = (*(f"{kind}-{way}" for kind, way in ARMS), "joint", "images", "controls")
IMAGE_RESOLUTION = 0.25


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    found = argparse.ArgumentParser(prog="python -m tests.statistical", description=__doc__)
    found.add_argument("--worlds", type=int, default=200, help="with laser readings, for each way of sampling")
    found.add_argument("--sonar-worlds", type=int, default=100, help="with sonar readings")
    found.add_argument("--joint-chains", type=int, default=80, help="successive-conditional chains of the joint test")
    found.add_argument("--joint-turns", type=int, default=50, help="new readings in each of them")
    found.add_argument("--joint-pairs", type=int, default=3000, help="marginal-conditional draws")
    found.add_argument("--image-chains", type=int, default=8, help="chains of each of two samplers on one posterior")
    found.add_argument("--loops", type=int, default=12_000, help="steps of each chain of disagreement loops")
    found.add_argument("--image-steps", type=int, default=1_280_000, help="steps of each chain of the sampler")
    found.add_argument("--threads", type=int, default=2, help="they change no result")
    found.add_argument("--seed", type=int, default=1)
    found.add_argument("--part", action="append", choices=PARTS, help="only this one, repeatable")
    found.add_argument("--output", type=Path, default=Path("verify"), help="folder of plots and verify.json")
    return found


class Run:
    """What was asked for, and what was found so far."""

    def __init__(self, asked: argparse.Namespace) -> None:
        self.asked = asked
        self.figures: dict[str, Any] = {}

    def wants(self, part: str) -> bool:
        """Return whether a part is asked for."""
        return not self.asked.part or part in self.asked.part

    def parts(self) -> Iterator[list[Check]]:
        """Make the checks, part by part."""
        for kind, way in ARMS:
            if self.wants(f"{kind}-{way}"):
                yield settled(lambda seed, kind=kind, way=way: self.calibrate(kind, way, seed), self.asked.seed)
        if self.wants("joint"):
            for program in (PLAIN, ACCELERATED):
                yield settled(lambda seed, program=program: [self.joint(program, seed)], self.asked.seed)
        if self.wants("images"):
            yield settled(self.images, self.asked.seed)
        if self.wants("controls"):
            yield from self.controls()

    def n_worlds(self, kind: str) -> int:
        """Return the number of worlds with readings of a kind."""
        return self.asked.worlds if kind == "laser" else self.asked.sonar_worlds

    def calibrate(self, kind: str, way: str, seed: int) -> list[Check]:
        """Rank the truth in worlds of a kind, sampled in a way."""
        arm = standard_arm(kind, way)
        found = run_arm(arm, self.n_worlds(kind), seed, self.asked.threads)
        self.keep_ranks(f"ranks-{kind}-{way}-{seed}", arm.name, found)
        return uniform_checks(arm, found)

    def keep_ranks(self, key: str, name: str, found: Calibration) -> None:
        """Plot ranks, and keep them for verify.json."""
        plot_ranks(name, found, self.asked.output / f"{key}.png")
        counted = {name: found.ranks[:, k].tolist() for k, name in enumerate(NAMES)}
        rest = {name: [getattr(world, name) for world in found.worlds] for name in ("steps", "agreed")}
        self.figures[key] = {"ranks": counted, **rest}

    def joint(self, program: Program, seed: int, is_control: bool = False) -> Check:
        """Run both simulators of the joint test."""
        asked = self.asked
        sizes = (asked.joint_chains, asked.joint_turns, asked.joint_pairs)
        found = run_joint(small_station(), program, *sizes, seed)
        key = f"joint-{'control' if is_control else program.name.split(',')[0]}-{seed}"
        plot_joint({program.name: found}, asked.output / f"{key}.png")
        self.figures[key] = joint_figures(found)
        return joint_check(program, found, is_control)

    def images(self, seed: int) -> list[Check]:
        """Sample one posterior by disagreement loops and by the sampler: plain, with accelerators, with a mistake."""
        asked = self.asked
        station = small_station(IMAGE_RESOLUTION)
        rng = np.random.default_rng([seed, 3])
        target = station.read(station.draw_map(rng), rng)
        loops = by_loops(station, target, asked.image_chains, asked.loops, seed)
        checks = [mixing_check("images, disagreement loops", loops)]
        for name, given, plan in (
            ("the sampler, plain", target, None),
            ("the sampler, levels and tempering", target.with_execution(levels=LEVELS), LADDER),
            ("control, the sampler, noise taken for less than half", sharper(target), None),
        ):
            found = by_sampler(given, plan, asked.image_chains, asked.image_steps, seed, asked.threads)
            is_control = name.startswith("control")
            words = f"control, images, disagreement loops and {name.removeprefix('control, ')}"
            checks.append(
                image_check(words if is_control else words.removeprefix("control, "), loops, found, is_control)
            )
            if not is_control:
                checks.append(mixing_check(f"images, {name}", found))
            words = name.replace("control, ", "control-").replace("the sampler, ", "").replace(" ", "-")
            plot_images(name, station, loops, found, asked.output / f"images-{words}-{seed}.png")
            self.figures[f"images-{words}-{seed}"] = {"loops": loops.mean.tolist(), "sampler": found.mean.tolist()}
        return checks

    def controls(self) -> Iterator[list[Check]]:
        """Make mistakes."""
        asked = self.asked
        for number, arm in enumerate(control_arms()):
            found = run_arm(arm, asked.worlds, asked.seed, asked.threads)
            self.keep_ranks(f"control-{number}-{asked.seed}", f"control, {arm.name}", found)
            yield [control_check(arm.name, found)]
        found = run_mutant(asked.worlds, asked.seed)
        self.keep_ranks(f"control-mutant-{asked.seed}", "control, a wrong ratio", found)
        yield [control_check("laser, births in a ratio that is wrong", found)]
        yield [self.joint(PLAIN._replace(name="plain, scale of the prior doubled", spoil=rougher), asked.seed, True)]


def joint_figures(found: Joint) -> dict[str, Any]:
    """Return means, errors and z by quantity."""
    columns = (found.marginal.mean, found.marginal.error, found.successive.mean, found.successive.error, found.z)
    names = ("marginal", "marginal_error", "successive", "successive_error", "z")
    rows = np.column_stack(columns).tolist()
    return {name: dict(zip(names, row, strict=True)) for name, row in zip(QUANTITIES, rows, strict=True)}


def say_now(line: str) -> None:
    """Print a line at once, into a pipe too."""
    print(line, flush=True)


def main(arguments: list[str] | None = None, say: Callable[[str], None] = say_now) -> int:
    """Make the checks; return 1 if one fails."""
    asked = parser().parse_args(arguments)
    asked.output.mkdir(parents=True, exist_ok=True)
    start, run, checks = time.monotonic(), Run(asked), []
    for part in run.parts():
        for check in part:
            say(check.line())
        checks += part
        document = {
            "asked": {name: value for name, value in vars(asked).items() if name != "output"},
            "seconds": round(time.monotonic() - start),
            "checks": [check.document() for check in checks],
            "figures": run.figures,
        }
        (asked.output / "verify.json").write_text(json.dumps(document, indent=1) + "\n")
    failed = [check for check in checks if not check.passed]
    say(
        f"{len(checks) - len(failed)} of {len(checks)} checks passed, {time.monotonic() - start:.0f} s; {asked.output}/"
    )
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
