"""Runs the commands of a page in a folder: our own tools within this process, others by a shell."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import mapq.cli
import prf.cli
from prf.shell.cli.run import run_app
from tests.conftest import ROOT
from tests.docs.blocks import Command, differences
from tests.docs.brought import bring

TOOLS = {"prf": prf.cli.app, "mapq": mapq.cli.app}
ADDED = {
    "prf sample --resume": "--steps 10000",
    "prf sample": "--steps 10000 --force",
    "prf anneal": "--steps 10000 --force",
    "prf simulate --sonar": "--size 12 8 --readings 320 --force",
    "prf simulate --seed": "--size 12 8 --force",
    "prf simulate --world office ": "--size 12 8 --force",
    "prf simulate": "--force",
    "prf render": "--force",
    "prf export": "--force",
    "mapq classify": "--force",
    "mapq label city.patches": "--from-field truth",
    "mapq perturb sequences/00": "--offset 0.8 --force",
    "mapq perturb": "--force",
}
"""Options that tests give besides, in place of the values in the page, so that commands end soon; the first counts.

Tutorials are run as they are."""
NOT_RUN = ("make", "pip", "dask", "python -m benchmarks", "python -m tests")
NOT_COMPARED = re.compile(r"^.*(?:elapsed \d+:\d\d:\d\d|compiling what).*\n", re.MULTILINE)
SHARE = 0.1
"""By which numbers may differ from those of a page: chains on another processor take another path."""
INTERRUPTED = 130
SCHEDULER = "tcp://10.0.0.1:8786"
"""The address in the pages; one of this machine is used instead."""


class Runner:
    """Runs commands one after the other and counts them.

    `as_is`: with the options of the page alone. `is_whole`: the page leaves out no command that writes what it uses.
    """

    def __init__(self, folder: Path, capsys, scheduler: Callable[[], str], as_is: bool, is_whole: bool) -> None:
        self.folder, self.capsys, self.scheduler, self.is_whole = folder, capsys, scheduler, is_whole
        self.added = {} if as_is else ADDED
        self.n_run = self.code = 0

    def run(self, command: Command, follower: Command | None) -> None:
        """Run one command and compare exit code and output with the page."""
        if command.text.startswith(NOT_RUN):
            return
        if command.text == "echo $?":
            assert str(self.code) == command.shown, command
            return
        printed = ""
        for part in map(str.strip, re.split(r"&&|;\s", command.text.partition(" #")[0])):
            printed += self._part(part)
            allowed = {0, INTERRUPTED} if _is_by_hand(part.split()) else {0, 1} if "--fail-over" in part else {0}
            is_shown = follower is not None and follower.text == "echo $?"
            assert is_shown or self.code in allowed, (command.place, part, self.code, printed)
        self.n_run += 1
        if command.shown is not None:
            wrong = differences(command.shown, NOT_COMPARED.sub("", printed), SHARE)
            assert wrong is None, f"{command.place}: {command.text}\n{wrong}"

    def _part(self, text: str) -> str:
        words = shlex.split(text.partition(" > ")[0])
        if words[0] not in TOOLS:
            with_python = re.sub(r"^python\b", shlex.quote(sys.executable), text)
            there = {**os.environ, "PYTHONPATH": str(ROOT)}
            done = subprocess.run(["sh", "-c", with_python], capture_output=True, text=True, check=False, env=there)
            self.code = done.returncode
            return done.stdout + done.stderr
        words = _with(
            words, next((options.split() for start, options in self.added.items() if text.startswith(start)), [])
        )
        if SCHEDULER in words:
            words[words.index(SCHEDULER)] = self.scheduler()
        bring(words, self.folder, not self.is_whole)
        if _is_by_hand(words):
            words.append("--no-browser")
            threading.Thread(target=_stop_serving, daemon=True).start()
        self.code = run_app(TOOLS[words[0]], words[0], words[1:])
        out, err = self.capsys.readouterr()
        if " > " in text:
            (self.folder / text.partition(" > ")[2].strip()).write_text(out)
            out = ""
        return err + out


def _stop_serving() -> None:
    """Interrupt this process, as Ctrl-C does, once the page for labels is served."""
    while "127.0.0.1" not in sys.stderr.getvalue():
        time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)


def _is_by_hand(words: list[str]) -> bool:
    """Return whether a command waits for labels on a page; Ctrl-C ends it as soon as that is served."""
    return words[:2] == ["mapq", "label"] and "--from-field" not in words


def _with(words: list[str], options: list[str]) -> list[str]:
    """Return the words of a command with `options`, in place of their values in the page."""
    replaced = {option for option in options if option.startswith("--")}
    if "--steps" in replaced:
        replaced.add("--time-budget")
    kept, dropping = [], False
    for word in words:
        if word.startswith("-"):
            dropping = word in replaced
        if not dropping:
            kept.append(word)
    return kept + options
