"""Every way in which a tool can end, seen from a process of its own (streams, signals and pipes are the process's)."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from prf.shell.cli.options import parse_duration
from prf.shell.cli.storage import resolve_seed, spawn_generators
from prf.shell.errors import LONGEST_MESSAGE, InputError

VERB = '''
"""A verb that ends in the way given."""
from typing import Annotated
import typer
from prf.shell import errors
from prf.shell.cli.options import Seed

EXAMPLES = ("tool finish well",)

def finish(how: Annotated[str, typer.Argument(metavar="HOW", help="How.")], seed: Seed = None) -> None:
    """End."""
    if how in vars(errors):
        raise vars(errors)[how]("scan.log:118: range -4.2 < 0.\\nRemove it.")
    if how == "bug":
        raise ZeroDivisionError("x / 0")
    if how == "interrupt":
        raise KeyboardInterrupt
    if how == "wait":
        import time
        print("waiting", flush=True)
        time.sleep(60)
    if how == "warned":
        import warnings
        warnings.warn("overflow\\nin a library", RuntimeWarning)
    if how == "seed":
        print(seed)
    if how == "flood":
        while True:
            print("row " * 1000)
    print("well")
'''
TOOL = """
import sys
from prf.shell.cli.app import make_app
from prf.shell.cli.run import run_app
app = make_app("tool", "1.2", "A tool.", "verbs", {"finish": "End.", "ros-map": "Other."})
sys.exit(run_app(app, "tool"))
"""


@pytest.fixture(scope="module")
def tool(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Path:
    folder = tmp_path_factory.mktemp("tool")
    (folder / "verbs").mkdir()
    (folder / "verbs" / "__init__.py").touch()
    (folder / "verbs" / "finish.py").write_text(VERB)
    (folder / "tool.py").write_text(f"import sys; sys.path.insert(0, {str(project_root)!r})\n{TOOL}")
    return folder / "tool.py"


def call(tool: Path, *args: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in ("FORCE_COLOR", "NO_COLOR")}
    environment |= variables
    return subprocess.run([sys.executable, str(tool), *args], capture_output=True, text=True, env=environment)


def test_success_prints_only_the_result(tool: Path) -> None:
    done = call(tool, "finish", "well")
    assert (done.returncode, done.stdout, done.stderr) == (0, "well\n", "")


def test_what_a_library_warns_of_is_a_detail(tool: Path) -> None:
    done = call(tool, "finish", "warned")
    assert (done.returncode, done.stdout, done.stderr) == (0, "well\n", "")
    assert call(tool, "finish", "warned", "-v").stderr == "RuntimeWarning: overflow in a library\n"


@pytest.mark.parametrize(
    ("error", "code"),
    [
        ("CheckFailed", 1),
        ("UsageError", 2),
        ("ConfigError", 2),
        ("InputError", 3),
        ("OutputError", 4),
        ("OutputExists", 4),
        ("Interrupted", 130),
    ],
)
def test_each_error_has_its_code_and_one_line(tool: Path, error: str, code: int) -> None:
    done = call(tool, "finish", error)
    assert done.returncode == code
    assert done.stdout == ""
    assert done.stderr == "error: scan.log:118: range -4.2 < 0. Remove it.\n"


def test_a_bug_is_one_line_and_a_hint(tool: Path) -> None:
    done = call(tool, "finish", "bug")
    assert done.returncode == 70
    assert done.stderr.count("\n") == 1
    assert "ZeroDivisionError" in done.stderr
    assert "-vv" in done.stderr


@pytest.mark.parametrize("args", [("-vv", "finish", "bug"), ("finish", "-vv", "bug"), ("-v", "finish", "-v", "bug")])
def test_the_traceback_is_shown_with_vv_anywhere(tool: Path, args: tuple[str, ...]) -> None:
    done = call(tool, *args)
    assert done.returncode == 70
    assert "Traceback (most recent call last)" in done.stderr


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("finsh",), "Did you mean 'finish'? See 'tool --help'."),
        (("finish",), "Missing argument 'HOW'. See 'tool finish --help'."),
        (("finish", "well", "--seed"), "requires an argument. See 'tool finish --help'."),
        (("finish", "well", "--sed", "1"), "--seed"),
        (("finish", "well", "--seed", "-1"), "--seed"),
        (("finish", "well", "--color", "alwys"), "'always'"),
    ],
)
def test_usage_errors_are_one_line_that_helps(tool: Path, args: tuple[str, ...], words: str) -> None:
    done = call(tool, *args)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert words in done.stderr


def test_no_verb_prints_the_help_as_a_usage_error(tool: Path) -> None:
    done = call(tool)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "finish" in done.stderr


def test_help_lists_verbs_that_are_not_even_there(tool: Path) -> None:
    done = call(tool, "--help")
    assert done.returncode == 0
    assert "ros-map" in done.stdout, "verbs come from the table; nothing is imported for the list"


def test_the_environment_sets_an_option_and_a_flag_wins(tool: Path) -> None:
    assert call(tool, "finish", "seed", TOOL_FINISH_SEED="7").stdout == "7\nwell\n"
    assert call(tool, "finish", "seed", "--seed", "8", TOOL_FINISH_SEED="7").stdout == "8\nwell\n"
    assert "TOOL_VERB_MAX_RANGE" in call(tool, "--help").stdout


def test_keyboard_interrupt_is_quiet(tool: Path) -> None:
    done = call(tool, "finish", "interrupt")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_signals_from_outside(tool: Path, number: signal.Signals, code: int) -> None:
    with subprocess.Popen(
        [sys.executable, str(tool), "finish", "wait"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "waiting\n"
        time.sleep(0.05)
        process.send_signal(number)
        assert process.wait(timeout=30) == code
        assert process.stderr.read() == ""


def test_a_closed_pipe_is_no_reason_to_complain(tool: Path) -> None:
    with subprocess.Popen(
        [sys.executable, str(tool), "finish", "flood"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.read(10)
        process.stdout.close()
        assert process.wait(timeout=30) == 141
        assert process.stderr.read() == b""


def test_a_full_disk_is_an_output_error(tool: Path) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, str(tool), "finish", "well"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 4
    assert done.stderr == "error: the result cannot be written: no space left on device.\n"


def test_a_message_is_one_line_that_a_terminal_only_shows():
    error = InputError("a\nb.log:3: \x1b[2J\tis no number \u2028 \x00. Ünï \U0001f600 stays.")
    assert str(error) == "a b.log:3: \\x1b[2J is no number   \\x00. Ünï \U0001f600 stays."
    assert str(error).isprintable()


def test_a_long_message_keeps_its_beginning_and_its_remedy():
    message = str(InputError("a.ply: " + "x" * 100_000 + ". Mend it."))
    assert len(message) < LONGEST_MESSAGE + 10
    assert message.startswith("a.ply: xx")
    assert message.endswith("xx. Mend it.")


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", 90.0),
        ("0", 0.0),
        ("90s", 90.0),
        ("5m", 300.0),
        ("1.5h", 5400.0),
        (" 2M ", 120.0),
        ("1m30s", 90.0),
        ("1h30m", 5400.0),
        ("1e2", 100.0),
    ],
)
def test_durations(text: str, seconds: float) -> None:
    assert parse_duration(text) == seconds


@pytest.mark.parametrize("text", ["", "m", "5d", "-1", "-1m", "inf", "nan", "1h30", "30m1h", "soon"])
def test_what_is_no_duration(text: str) -> None:
    with pytest.raises(ValueError, match="must be seconds, or minutes"):
        parse_duration(text)


def test_a_given_seed_stays_and_an_absent_one_is_drawn() -> None:
    assert resolve_seed(7) == 7
    drawn = {resolve_seed(None) for _ in range(20)}
    assert len(drawn) > 1
    assert all(0 <= seed < 2**32 for seed in drawn)


def test_more_generators_leave_the_first_ones_as_they_were() -> None:
    few = [rng.random(4) for rng in spawn_generators(5, 2)]
    many = [rng.random(4) for rng in spawn_generators(5, 6)]
    np.testing.assert_array_equal(few, many[:2])
    assert len({tuple(draws) for draws in many}) == 6
