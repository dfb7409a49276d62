"""Stand-ins for terminals: a text stream that says it is one, and a program run on a real pseudo-terminal."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path

ESCAPE = re.compile(r"\x1b(?:\[[0-9;?]*[A-Za-z]|[()][AB0]|[=>])")
"""Control sequences; what is left when they are taken out was to be seen."""

OVERRIDES = ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES")


class Stream(io.TextIOWrapper):
    """Text in memory, with an encoding, that may call itself a terminal."""

    def __init__(self, is_terminal: bool, encoding: str = "utf-8") -> None:
        super().__init__(io.BytesIO(), encoding=encoding, newline="")
        self._is_terminal = is_terminal

    def isatty(self) -> bool:
        return self._is_terminal

    def text(self) -> str:
        self.flush()
        buffer = self.buffer
        assert isinstance(buffer, io.BytesIO)
        return buffer.getvalue().decode(self.encoding)


def run_on_terminal(
    tool: str,
    *args: object,
    size: tuple[int, int] = (24, 80),
    environment: dict[str, str] | None = None,
    act: Callable[[subprocess.Popen[bytes], str], None] | None = None,
    stdout: Path | None = None,
    seconds: float = 300.0,
) -> tuple[int, str]:
    """Run a tool on a pseudo-terminal of so many rows and columns; return its exit code and all that it wrote there.

    `act` is called with the process and all it has written, whenever it writes; `stdout` takes standard output instead.
    """
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", *size, 0, 0))
    root = str(Path(__file__).resolve().parents[2])
    kept = {
        name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES")
    }
    env = {**kept, "PYTHONPATH": root, "TERM": "xterm-256color", "COLORTERM": "truecolor", **(environment or {})}
    with open(stdout or os.devnull, "wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", tool, *map(str, args)],
            stdin=theirs,
            stdout=file if stdout is not None else theirs,
            stderr=theirs,
            env=env,
        )
    os.close(theirs)
    written, end = b"", time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            if select.select([ours], [], [], 0.2)[0]:
                try:
                    piece = os.read(ours, 65536)
                except OSError:  # the other side has gone
                    break
                if not piece:
                    break
                written += piece
                if act is not None:
                    act(process, written.decode(errors="replace"))
            elif process.poll() is not None:
                break
        return process.wait(timeout=max(1.0, end - time.monotonic())), written.decode(errors="replace")
    finally:
        process.kill()
        os.close(ours)
