"""A command in a process of its own, at the head of its own group, that can be killed at any moment."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Self

ROOT = Path(__file__).resolve().parents[2]
GRACE = 10.0
"""Seconds in which the workers of a killed leader must end."""


class Child:
    """A running command; leaving the block ends all that is left of its group.

    Parameters
    ----------
    command : list of str
    """

    def __init__(self, command: list[str]) -> None:
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
            environment[name] = "1"
        self.begun = time.monotonic()
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            cwd=ROOT,
            env=environment,
        )

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the whole group: it was started here."""
        if self.members():
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.communicate()

    def signal_after(self, seconds: float, number: int) -> bool:
        """Send a signal so long after the start; return whether the leader was still running.

        SIGINT goes to the whole group, as Ctrl-C does, the others to the leader alone.
        """
        try:
            self.process.wait(max(0.0, self.begun + seconds - time.monotonic()))
        except subprocess.TimeoutExpired:
            if number == signal.SIGINT:
                os.killpg(self.process.pid, number)
            else:
                self.process.send_signal(number)
            return True
        return False

    def end(self) -> tuple[int, str, str]:
        """Wait for the end; return exit code, standard output and standard error."""
        out, err = self.process.communicate(timeout=300)
        return self.process.returncode, out, err

    def members(self) -> list[int]:
        """Return the processes of the group that are alive."""
        return [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit() and self._is_member(entry)]

    def _is_member(self, entry: Path) -> bool:
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            return False
        return int(fields[2]) == self.process.pid and fields[0] != "Z"

    def orphans(self) -> list[int]:
        """Return the processes that still live a while after the leader was killed."""
        until = time.monotonic() + GRACE
        while (alive := self.members()) and time.monotonic() < until:
            time.sleep(0.05)
        return alive


def complete(command: list[str]) -> tuple[int, str, float]:
    """Run a command to its end; return exit code, standard error and seconds."""
    with Child(command) as child:
        code, _, err = child.end()
        return code, err, time.monotonic() - child.begun
