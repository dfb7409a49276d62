"""Many mistakes in one source: a process imports it and collects its tests once, and each mistake is made in a fork."""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from tests.mutation.guards import Guard
from tests.mutation.mistakes import Mistake
from tests.mutation.patch import exchange_code

if TYPE_CHECKING:
    import pytest

ROOT = Path(__file__).resolve().parents[2]
MEMORY = 6 * 2**30
"""Bytes that an altered source may ask for."""
FIXED, FACTOR = 2.0, 5.0
"""CPU seconds, and times its time on the intact source, that a check may take before it counts as hung."""

SURVIVED, KILLED, ELSEWHERE = "survived", "killed", "elsewhere"
"""`ELSEWHERE`: the mistake is not in the code of a function, and has to be tried in a process of its own."""


class Verdict(NamedTuple):
    """What came of a mistake.

    Attributes
    ----------
    mistake : str
    outcome : str
        `SURVIVED`, `KILLED` or `ELSEWHERE`.
    by : str
        The check that noticed it.
    """

    mistake: str
    outcome: str
    by: str


class Check(NamedTuple):
    """One of a guard's checks: the ratios of its moves, or a test."""

    name: str
    passes: Callable[[], bool]


class Report(NamedTuple):
    """What a fork has to say: the check that failed, or how long each took; `ELSEWHERE` if it made no mistake."""

    failed: str
    seconds: dict[str, float]


class Host:
    """Plugin of pytest: instead of running the tests once it runs them once a mistake, each time in a fork."""

    def __init__(
        self, guard: Guard, source: str, mistakes: list[Mistake], states: Path, say: Callable[[Verdict], None]
    ) -> None:
        self.guard, self.source, self.mistakes, self.states, self.say = guard, source, mistakes, states, say
        self.failed = "collection"

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Try the mistakes on what was collected."""
        self.try_all(session.items)
        return True

    def try_all(self, items: list[pytest.Item]) -> None:
        """Try each mistake; what noticed the last one is asked first about the next."""
        checks = list(self._checks(items))
        intact = _in_fork(checks, lambda: True, {check.name: 600.0 for check in checks})
        self.failed = intact.failed
        if self.failed:
            return
        limits = {name: FIXED + FACTOR * seconds for name, seconds in intact.seconds.items()}
        for mistake in self.mistakes:
            found = _in_fork(checks, lambda one=mistake: exchange_code(self.guard.module, self.source, one), limits)
            outcome = found.failed if found.failed == ELSEWHERE else KILLED if found.failed else SURVIVED
            self.say(Verdict(str(mistake), outcome, found.failed))
            checks.sort(key=lambda check, last=found.failed: check.name != last)

    def _checks(self, items: list[pytest.Item]) -> Iterator[Check]:
        if self.guard.moves:
            from tests.mutation.ratios import draw_faults, faults, load_states

            worlds = load_states(self.states)
            for move in self.guard.moves:
                yield Check(f"ratio of {move}", lambda one=move: not faults(worlds, (one,)))
            for move in self.guard.moves:
                yield Check(f"draws of {move}", lambda one=move: not draw_faults(worlds, one))
        for item in items:
            yield Check(item.nodeid, lambda one=item: _passes(one))


def _passes(item: pytest.Item) -> bool:
    item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
    return not item.session.testsfailed


def _in_fork(checks: list[Check], prepare: Callable[[], bool], limits: dict[str, float]) -> Report:
    """Run the checks up to the first failure in a fork; a fork that dies says which check it died in."""
    reader, writer = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _answer(checks, prepare, limits, writer)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as stream:
        lines = stream.read().splitlines()
    os.waitpid(child, 0)
    begun, seconds, failed = "start", {}, "died"
    for line in lines:
        kind, name, value = json.loads(line)
        if kind == "begun":
            begun = name
        elif kind == "passed":
            seconds[name] = value
        else:
            failed = name
    return Report(begun if failed == "died" else failed, seconds)


def _answer(checks: list[Check], prepare: Callable[[], bool], limits: dict[str, float], writer: int) -> None:
    """Write down each check begun and passed, and at last what failed, or "" if nothing did."""

    def say(kind: str, name: str, value: float = 0.0) -> None:
        os.write(writer, (json.dumps([kind, name, value]) + "\n").encode())

    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    if not prepare():
        return say("ended", ELSEWHERE)
    for check in checks:
        say("begun", check.name)
        begin = time.process_time()
        _, hard = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (int(begin + limits[check.name]) + 1, hard))
        signal.alarm(int(60.0 + 20.0 * limits[check.name]))
        try:
            passed = check.passes()
        except BaseException:
            traceback.print_exc()
            passed = False
        if not passed:
            return say("ended", check.name)
        say("passed", check.name, time.process_time() - begin)
    return say("ended", "")


def run_host(guard: Guard, source: str, mistakes: list[Mistake], states: Path, say: Callable[[Verdict], None]) -> str:
    """Collect the guard's tests in this process, which comes to import the project, and try the mistakes.

    Returns the check that fails on the intact source, or "". `say` hears of each mistake.
    """
    import importlib

    import pytest

    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    importlib.import_module(guard.module)
    host = Host(guard, source, mistakes, states, say)
    if not guard.tests:
        host.try_all([])
        return host.failed
    options = ["-q", "-s", "-p", "no:cacheprovider", "-m", "not slow", "--tb=line", "--rootdir", str(ROOT)]
    pytest.main([*options, *(str(ROOT / one) for one in guard.tests)], plugins=[host])
    return host.failed
