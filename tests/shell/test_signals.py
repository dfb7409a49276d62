from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from prf.shell.cli.run import graceful_stop
from prf.shell.errors import Interrupted


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_first_signal_sets_the_flag(number: signal.Signals, code: int) -> None:
    with graceful_stop() as stop:
        assert not stop.requested
        os.kill(os.getpid(), number)
        assert stop.requested
        with pytest.raises(Interrupted, match="kept") as caught:
            stop.raise_if_requested("kept in demo/office")
    assert caught.value.exit_code == code


def test_second_signal_acts_at_once() -> None:
    with graceful_stop() as stop:
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.requested
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_second_signal_goes_to_the_handler_that_was_there_before() -> None:
    seen: list[int] = []
    old = signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    try:
        with graceful_stop() as stop:
            os.kill(os.getpid(), signal.SIGINT)
            assert (stop.requested, seen) == (True, [])
            os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, old)
    assert seen == [signal.SIGINT]


def test_the_first_signal_ends_at_once_what_has_no_result(caplog: pytest.LogCaptureFixture) -> None:
    before = signal.getsignal(signal.SIGINT)
    with graceful_stop(has_result=False) as stop, pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
    assert stop.requested
    assert caplog.messages == ["interrupted before the first step; nothing new was saved"]
    assert signal.getsignal(signal.SIGINT) is before
    with graceful_stop(has_result=False) as stop:
        stop.has_result = True
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.requested


TOOL = """
import threading, time
from prf.shell.cli import console
from prf.shell.cli.files import open_output
from prf.shell.cli.run import ending_the_tool, graceful_stop
console.reset()
with ending_the_tool(), graceful_stop(has_result=False), open_output("result"):
    threading.Thread(target=time.sleep, args=(60.0,)).start()  # as one that compiles
    print("begun", flush=True)
    time.sleep(60.0)
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_tool_without_result_leaves_nothing_and_waits_for_no_thread(
    number: signal.Signals, code: int, tmp_path: Path
) -> None:
    tool = subprocess.Popen(
        [sys.executable, "-c", TOOL], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert tool.stdout is not None
    assert tool.stdout.readline() == "begun\n"
    tool.send_signal(number)
    _, said = tool.communicate(timeout=50.0)
    assert (tool.returncode, said) == (code, "error: interrupted before the first step; nothing new was saved\n")
    assert list(tmp_path.iterdir()) == []


def test_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    with graceful_stop():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_outside_the_main_thread_the_flag_stays_unset() -> None:
    seen: list[bool] = []

    def work() -> None:
        with graceful_stop() as stop:
            seen.append(stop.requested)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [False]
