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

from mapq.scale.workers import Dask, Processes, open_workers
from prf.shell.errors import InputError


def double(number: int) -> int:
    return 2 * number


def refuse(number: int) -> int:
    raise InputError(f"tile {number} is damaged.")


def stumble(path: str) -> str:
    """Fail the first time."""
    if not Path(path).exists():
        Path(path).write_text("")
        raise OSError("the disk was away")
    return path


def die_once(path: str) -> str:
    """Lose the process the first time."""
    if not Path(path).exists():
        Path(path).write_text("")
        os.kill(os.getpid(), signal.SIGKILL)
    return path


def die(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_one_worker_is_this_process():
    done: list[int] = []
    with open_workers(1, None) as workers:
        assert workers.each(double, [3, 1, 2], done.append) == [6, 2, 4]
    assert done == [0, 1, 2]


def test_what_the_system_refuses_once_is_tried_again(tmp_path):
    with open_workers(1, None) as workers:
        assert workers.each(stumble, [str(tmp_path / "a")], lambda _: None) == [str(tmp_path / "a")]


def test_a_process_that_is_lost_costs_its_task_only(tmp_path):
    done: list[int] = []
    tasks = [str(tmp_path / name) for name in "abc"]
    for name in "bc":
        (tmp_path / name).write_text("")
    with open_workers(2, None) as workers:
        assert workers.each(die_once, tasks, done.append) == tasks
        with pytest.raises(InputError, match="tile 5 is damaged"):
            workers.each(refuse, [5], done.append)
    assert sorted(done) == [0, 1, 2]


@pytest.mark.slow
def test_a_task_that_loses_every_process_ends_the_run_in_one_line():
    workers = Processes(1)
    with pytest.raises(InputError, match="--tile-points"):
        workers.each(die, [1], lambda _: None)
    workers.close()


def test_no_scheduler_is_said_in_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("prf.shell.scheduler.CONNECT_SECONDS", 0.2)
    with pytest.raises(InputError, match=r"no scheduler answers there\. Start one: dask scheduler"):
        Dask("tcp://127.0.0.1:9")


LEADER = """
import sys
from mapq.scale.workers import Processes
from tests.mapq.scale.test_workers import say_and_sleep

if __name__ == "__main__":
    Processes(2).each(say_and_sleep, [sys.argv[1] + "/a", sys.argv[1] + "/b"], print)
"""


def say_and_sleep(path: str) -> None:
    """Say which process this is, and work for longer than any test."""
    Path(f"{path}.tmp").write_text(str(os.getpid()))
    os.rename(f"{path}.tmp", path)
    time.sleep(600.0)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_their_leader_and_say_nothing(tmp_path, project_root, number):
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
