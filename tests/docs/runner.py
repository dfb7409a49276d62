"""Runs the commands of a page in a folder: our own tools within this process, what shells have by a shell."""

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
from prf.shell.run import run_app
from tests.conftest import ROOT
from tests.docs.blocks import Command, Rules, differences
from tests.docs.brought import bring

TOOLS = {"prf": prf.cli.app, "mapq": mapq.cli.app}
NEVER_SHOWN = re.compile(r"^.*(?:elapsed \d+:\d\d:\d\d|compiling kernels).*\n", re.MULTILINE)
"""Lines of progress, which come where a machine is slow, and what a first run says."""

SHARE = 0.1
"""How far numbers may be from those of a page: chains of another processor go another way."""

UNENDING = ("sample", "anneal")
"""Verbs that run for minutes unless they are given steps."""

INTERRUPTED = 130

SCHEDULER = "tcp://10.0.0.1:8786"
"""The address of the pages; one of this machine stands in for it."""

SERVING = 60.0
"""Seconds after which a page that does not serve is given up."""


class Runner:
    """Runs commands one after the other and keeps count.

    Attributes
    ----------
    n_run, n_compared, n_left_out : int
    """

    def __init__(self, folder: Path, rules: Rules, capsys, scheduler: Callable[[], str]) -> None:
        self.folder, self.rules, self.capsys, self.scheduler = folder, rules, capsys, scheduler
        self.n_run = self.n_compared = self.n_left_out = self.code = 0

    def run(self, command: Command, follower: Command | None) -> None:
        """Run one command and hold exit code and output to what the page says."""
        if self.rules.is_left_out(command.text):
            self.n_left_out += 1
            return
        if command.text == "echo $?":
            assert str(self.code) == command.shown, command
            return
        printed = ""
        asks_code = follower is not None and follower.text == "echo $?"
        for part in re.split(r"&&|;\s", command.text.partition(" #")[0]):
            printed += self._part(part.strip())
            by_hand = _is_by_hand([*part.split(), *self.rules.options_of(part.strip())])
            expected = INTERRUPTED if by_hand else self.rules.code_of(part.strip())
            assert asks_code or self.code == expected, (command.place, part, self.code, printed)
        self.n_run += 1
        if command.shown is not None:
            wrong = differences(command.shown, NEVER_SHOWN.sub("", printed), SHARE)
            assert wrong is None, f"{command.place}: {command.text}\n{wrong}"
            self.n_compared += 1

    def _part(self, text: str) -> str:
        words = shlex.split(text.partition(" > ")[0])
        if words[0] not in TOOLS:
            with_python = re.sub(r"^python\b", shlex.quote(sys.executable), text)
            there = {**os.environ, "PYTHONPATH": str(ROOT)}
            done = subprocess.run(["sh", "-c", with_python], capture_output=True, text=True, check=False, env=there)
            self.code = done.returncode
            return done.stdout + done.stderr
        words = _with(words, self.rules.options_of(text))
        if SCHEDULER in words:
            words[words.index(SCHEDULER)] = self.scheduler()
        assert words[1] not in UNENDING or "--steps" in words, f"{text}: its page should say how tests end it"
        bring(words, self.folder)
        if _is_by_hand(words):
            words.append("--no-browser")
            threading.Thread(target=self._stop_serving, daemon=True).start()
        self.code = run_app(TOOLS[words[0]], words[0], words[1:])
        out, err = self.capsys.readouterr()
        if " > " in text:
            (self.folder / text.partition(" > ")[2].strip()).write_text(out)
            out = ""
        return err + out

    def _stop_serving(self) -> None:
        """Interrupt this process, as Ctrl-C does, once the page for labels is served."""
        end = time.monotonic() + SERVING
        while "127.0.0.1" not in sys.stderr.getvalue() and time.monotonic() < end:
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)


def _is_by_hand(words: list[str]) -> bool:
    """Tell whether a command waits for a person's labels on a page; here Ctrl-C ends it as soon as that is served."""
    return words[:2] == ["mapq", "label"] and not {"--from-field", "--agreement"} & set(words)


def _with(words: list[str], options: list[str]) -> list[str]:
    """Return the words of a command with options that the page's rules add, in place of their values."""
    if not options:
        return words
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
