"""Who does the tasks: all of them, in order, whatever becomes of a worker."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from mapq.tiled.output import open_workers
from prf.shell.errors import InputError


def double(number: int) -> int:
    return 2 * number


def refuse(number: int) -> int:
    raise InputError(f"tile {number} is damaged.")


def die(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_results_are_in_the_order_of_tasks():
    for n_workers in (1, 2):
        with open_workers(n_workers, None) as workers:
            assert list(workers(double, [3, 1, 2])) == [6, 2, 4]


def test_an_error_of_a_task_and_the_loss_of_a_worker_are_errors_of_the_run():
    with pytest.raises(InputError, match="tile 5 is damaged"), open_workers(2, None) as workers:
        list(workers(refuse, [5]))
    with pytest.raises(InputError, match="--tile-points"), open_workers(2, None) as workers:
        list(workers(die, [1]))


def test_no_scheduler_is_an_error_in_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("prf.shell.scheduler.CONNECT_SECONDS", 0.2)
    with (
        pytest.raises(InputError, match=r"no scheduler answers there\. Start one: dask scheduler"),
        open_workers(1, "tcp://127.0.0.1:9"),
    ):
        pass


LEADER = """
import sys
from mapq.tiled.output import open_workers
from tests.mapq.tiled.test_workers import say_and_sleep

if __name__ == "__main__":
    with open_workers(2, None) as workers:
        list(workers(say_and_sleep, [sys.argv[1] + "/a", sys.argv[1] + "/b"]))
"""


def say_and_sleep(path: str) -> None:
    """Say which process this is, and work for longer than any test."""
    Path(f"{path}.tmp").write_text(str(os.getpid()))
    os.rename(f"{path}.tmp", path)
    time.sleep(600.0)


@pytest.mark.parametrize("number", [pytest.param(signal.SIGKILL, marks=pytest.mark.slow), signal.SIGINT])
def test_workers_end_silently_with_their_leader(tmp_path, project_root, number):
    """In the middle of their tasks; SIGINT goes to all of them, as Ctrl-C does."""
    (tmp_path / "leader.py").write_text(LEADER)
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "leader.py"), str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(project_root)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as leader:
        pids = [wait_for_pid(tmp_path / name) for name in "ab"]
        (os.killpg if number == signal.SIGINT else os.kill)(leader.pid, number)
        ended = wait_until(lambda: not any(is_alive(pid) for pid in pids))
        leader.kill()  # else a failure would be waited for without end
        _, err = leader.communicate()
    assert ended, "workers live on"
    assert "Spawn" not in err


def wait_for_pid(path: Path) -> int:
    assert wait_until(path.exists)
    return int(path.read_text())


def wait_until(holds: Callable[[], bool], seconds: float = 60.0) -> bool:
    until = time.monotonic() + seconds
    while not holds() and time.monotonic() < until:
        time.sleep(0.02)
    return holds()


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
